//! Signals by cycle: one row per instant at which one of them has a value.
//!
//! The time base is the hold instant of conversions, in cycles since reset: a node's value stands at
//! that of the conversion that caused it, beside its code and the voltages. A pin has a row at each
//! edge. Where a node takes several values in one solution they have a row each.

use std::collections::BTreeMap;

use cardan_bench::App;
use cardan_compare::{Comparison, Node};
use cardan_spec::timing::CPU_HZ;

use super::signal::Signal;
use super::solutions::{node_cells, node_columns};
use super::table::{Cell, Kind, Table};
use crate::failure::Failure;
use crate::participants::diff::Collected;

/// Columns before the signals': cycle and seconds.
const FIXED: usize = 2;

/// Rows by cycle, and by number within it.
type Rows = BTreeMap<(u64, u32), Vec<Cell>>;

/// Some columns of the table being made.
struct Columns<'a> {
    rows: &'a mut Rows,
    /// Columns of the whole table.
    width: usize,
    /// Index of the first.
    first: usize,
    /// The last instant, and how many values stood there.
    last: Option<(u64, u32)>,
}

impl Columns<'_> {
    /// The next values, at `cycle`.
    fn put(&mut self, cycle: u64, cells: &[Cell]) {
        let number = match self.last {
            Some((last, number)) if last == cycle => number + 1,
            _ => 0,
        };
        self.last = Some((cycle, number));
        let width = self.width;
        let row = self
            .rows
            .entry((cycle, number))
            .or_insert_with(|| vec![Cell::EMPTY; width]);
        for (slot, cell) in row.iter_mut().skip(self.first).zip(cells) {
            *slot = *cell;
        }
    }
}

/// The table of `signals`.
pub(super) fn table(
    signals: &[Signal],
    app: &dyn App,
    comparison: &Comparison,
    collected: &Collected,
) -> Result<Table, Failure> {
    let mut table = Table::default();
    table.column("cycle", Kind::Whole);
    table.column("t_s", Kind::Real);
    let mut firsts = Vec::new();
    for signal in signals {
        firsts.push(table.width());
        for column in columns(*signal, app, comparison)? {
            table.column(&column, Kind::Real);
        }
    }
    let mut rows = Rows::new();
    for (signal, first) in signals.iter().zip(firsts) {
        let columns = Columns {
            rows: &mut rows,
            width: table.width(),
            first,
            last: None,
        };
        fill(*signal, app, columns, comparison, collected)?;
    }
    for ((cycle, _), mut row) in rows {
        for (slot, cell) in row.iter_mut().zip(instant(cycle)) {
            *slot = cell;
        }
        table.rows.push(row);
    }
    Ok(table)
}

fn instant(cycle: u64) -> [Cell; FIXED] {
    [Cell::Whole(cycle), Cell::Real(cycle as f64 / CPU_HZ as f64)]
}

fn node<'a>(name: &str, comparison: &'a Comparison) -> Result<&'a Node, Failure> {
    let found = comparison.nodes.iter().find(|node| node.name == name);
    found.ok_or_else(|| {
        Failure::input(format!(
            "--dump-signal {name}: the node took no value in this run"
        ))
    })
}

fn columns(signal: Signal, app: &dyn App, comparison: &Comparison) -> Result<Vec<String>, Failure> {
    Ok(match signal {
        Signal::Node(_) => node_columns(&node(&signal.name(app), comparison)?.name).into(),
        Signal::Code => vec!["channel".to_owned(), "code".to_owned()],
        _ => vec![signal.name(app)],
    })
}

fn fill(
    signal: Signal,
    app: &dyn App,
    mut columns: Columns<'_>,
    comparison: &Comparison,
    collected: &Collected,
) -> Result<(), Failure> {
    match signal {
        Signal::Node(index) => {
            let node = node(&signal.name(app), comparison)?;
            let cycles = collected.native_cycles.get(&index);
            for (number, &cycle) in cycles.into_iter().flatten().enumerate() {
                columns.put(cycle, &node_cells(node, number));
            }
        }
        Signal::Code => {
            for conversion in &collected.conversions {
                let (channel, code) = (conversion.channel.into(), conversion.code.into());
                columns.put(conversion.cycle, &[Cell::Real(channel), Cell::Real(code)]);
            }
        }
        Signal::Voltage(channel) => {
            for conversion in &collected.conversions {
                if conversion.channel == channel {
                    columns.put(conversion.cycle, &[Cell::Real(conversion.ideal_volts)]);
                }
            }
        }
        Signal::Inner(..) | Signal::Pin(_) => {
            let published = collected.signals.iter();
            let ours = published.filter(|value| Some(value.signal) == signal.published());
            let before = columns.last;
            for value in ours {
                columns.put(value.cycle, &[Cell::Real(value.value)]);
            }
            if columns.last == before {
                let name = signal.name(app);
                return Err(Failure::input(format!(
                    "--dump-signal {name}: 'emulate' published no such signal; give it \
                     --dump-signal {name} too"
                )));
            }
        }
    }
    Ok(())
}
