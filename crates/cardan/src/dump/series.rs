//! Signals by cycle: one row per instant at which one of them has a value.
//!
//! The time base is the hold instant of conversions, in cycles since reset: a node's value stands at
//! that of the conversion that caused it, beside its code and the voltages. A pin has a row at each
//! edge. Where a node takes several values in one solution they have a row each.

use std::collections::BTreeMap;
use std::io;

use cardan_bench::App;
use cardan_compare::Comparison;
use cardan_spec::timing::CPU_HZ;

use super::signal::Signal;
use super::solutions::{node_cells, node_columns};
use super::table::{Cell, Columns, Kind, Table};
use crate::failure::Failure;
use crate::participants::diff::Collected;

/// Columns before the signals': cycle and seconds.
const FIXED: usize = 2;

/// A signal with its columns.
#[derive(Debug)]
struct Of {
    signal: Signal,
    name: String,
    /// Its node among those of the comparison.
    node: Option<usize>,
    /// Its first column.
    first: usize,
    /// The last instant, and how many values stood there.
    last: Option<(u64, u32)>,
}

/// The rows that are not complete yet, by cycle and by number within it.
#[derive(Debug)]
pub(super) struct Series {
    signals: Vec<Of>,
    rows: BTreeMap<(u64, u32), Vec<Cell>>,
    width: usize,
}

/// The columns of the signals.
///
/// # Errors
/// A node that takes no value in this run.
pub(super) fn columns(
    signals: &[Signal],
    app: &dyn App,
    facts: &Comparison,
) -> Result<Columns, Failure> {
    let mut columns = vec![
        ("cycle".to_owned(), Kind::Whole),
        ("t_s".to_owned(), Kind::Real),
    ];
    for signal in signals {
        let names = names(*signal, app, facts)?;
        columns.extend(names.into_iter().map(|name| (name, Kind::Real)));
    }
    Ok(columns)
}

fn names(signal: Signal, app: &dyn App, facts: &Comparison) -> Result<Vec<String>, Failure> {
    let name = signal.name(app);
    Ok(match signal {
        Signal::Node(_) => {
            node(&name, facts)?;
            node_columns(&name).into()
        }
        Signal::Code => vec!["channel".to_owned(), "code".to_owned()],
        _ => vec![name],
    })
}

/// The place of a node.
fn node(name: &str, facts: &Comparison) -> Result<usize, Failure> {
    let found = facts.nodes.iter().position(|node| node.name == name);
    found.ok_or_else(|| {
        Failure::input(format!(
            "--dump-signal {name}: the node took no value in this run"
        ))
    })
}

impl Series {
    pub(super) fn new(
        signals: &[Signal],
        app: &dyn App,
        facts: &Comparison,
        width: usize,
    ) -> Result<Self, Failure> {
        let (mut all, mut first) = (Vec::new(), FIXED);
        for &signal in signals {
            let name = signal.name(app);
            let node = match signal {
                Signal::Node(_) => Some(node(&name, facts)?),
                _ => None,
            };
            let columns = names(signal, app, facts)?.len();
            all.push(Of {
                signal,
                name,
                node,
                first,
                last: None,
            });
            first += columns;
        }
        Ok(Self {
            signals: all,
            rows: BTreeMap::new(),
            width,
        })
    }

    /// Nodes whose cycles are wanted.
    pub(super) fn nodes(&self) -> Vec<usize> {
        let nodes = self.signals.iter().filter_map(|of| match of.signal {
            Signal::Node(node) => Some(node),
            _ => None,
        });
        nodes.collect()
    }

    /// Whether any is published as a signal.
    pub(super) fn is_published(&self) -> bool {
        self.signals
            .iter()
            .any(|of| of.signal.published().is_some())
    }

    pub(super) fn add(
        &mut self,
        window: &Comparison,
        collected: &Collected,
        table: &mut Table,
    ) -> io::Result<()> {
        let Self {
            signals,
            rows,
            width,
        } = self;
        for of in signals {
            of.fill(window, collected, |key, first, cells| {
                let row = rows.entry(key).or_insert_with(|| vec![Cell::EMPTY; *width]);
                for (slot, cell) in row.iter_mut().skip(first).zip(cells) {
                    *slot = *cell;
                }
            });
        }
        // What comes later stands at the window's last instant, or behind it.
        let last = collected.conversions.last().map(|last| last.cycle);
        self.flush(last.unwrap_or(0), table)
    }

    /// Writes the rows before `cycle`.
    pub(super) fn flush(&mut self, cycle: u64, table: &mut Table) -> io::Result<()> {
        let later = self.rows.split_off(&(cycle, 0));
        for ((cycle, _), mut row) in std::mem::replace(&mut self.rows, later) {
            let instant = [Cell::Whole(cycle), Cell::Real(cycle as f64 / CPU_HZ as f64)];
            for (slot, cell) in row.iter_mut().zip(instant) {
                *slot = cell;
            }
            table.row(&row)?;
        }
        Ok(())
    }

    /// Every signal had a value.
    ///
    /// # Errors
    /// One that nobody published.
    pub(super) fn check(&self) -> Result<(), Failure> {
        let published = |of: &&Of| of.signal.published().is_some() && of.last.is_none();
        match self.signals.iter().find(published) {
            Some(Of { name, .. }) => Err(Failure::input(format!(
                "--dump-signal {name}: 'emulate' published no such signal; give it --dump-signal \
                 {name} too"
            ))),
            None => Ok(()),
        }
    }
}

impl Of {
    /// Gives every value of the window to `put`: where it stands, its first column, its cells.
    fn fill(
        &mut self,
        window: &Comparison,
        collected: &Collected,
        mut put: impl FnMut((u64, u32), usize, &[Cell]),
    ) {
        let (first, last) = (self.first, &mut self.last);
        let mut at = |cycle: u64, cells: &[Cell]| {
            let number = match *last {
                Some((before, number)) if before == cycle => number + 1,
                _ => 0,
            };
            *last = Some((cycle, number));
            put((cycle, number), first, cells);
        };
        match self.signal {
            Signal::Node(index) => {
                let Some(node) = self.node.map(|node| &window.nodes[node]) else {
                    return;
                };
                let cycles = collected.native_cycles.get(&index);
                for (number, &cycle) in cycles.into_iter().flatten().enumerate() {
                    at(cycle, &node_cells(node, number));
                }
            }
            Signal::Code => {
                for conversion in &collected.conversions {
                    let (channel, code) = (conversion.channel.into(), conversion.code.into());
                    at(conversion.cycle, &[Cell::Real(channel), Cell::Real(code)]);
                }
            }
            Signal::Voltage(channel) => {
                let conversions = collected.conversions.iter();
                for conversion in conversions.filter(|made| made.channel == channel) {
                    at(conversion.cycle, &[Cell::Real(conversion.ideal_volts)]);
                }
            }
            Signal::Inner(..) | Signal::Pin(_) => {
                let published = collected.signals.iter();
                for value in published.filter(|value| Some(value.signal) == self.signal.published())
                {
                    at(value.cycle, &[Cell::Real(value.value)]);
                }
            }
        }
    }
}
