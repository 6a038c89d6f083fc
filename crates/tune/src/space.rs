//! What may be chosen: groups of nodes that share a word length, and the lengths they may take.

use std::sync::Arc;

use cardan_datapath::wordlengths::container_bits;
use cardan_datapath::{Format, Overflow, Rounding};
use cardan_numerics::tape::{NO_NODE, Tape};
use cardan_numerics::trial::deployable;

use crate::catalogue::mend;
use crate::noise::natural_frac;
use crate::problem::Problem;

/// Longest word of a deployed format on the reference controller.
pub(crate) const LONGEST: u32 = 32;

/// Integer bits, sign included, of 16-bit words that share their binary point: values to 2.
const SHARED_INTEGER: i32 = 2;

/// Nodes with one word length.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Group {
    pub(crate) nodes: Vec<usize>,
    /// Lengths it may take, ascending.
    pub(crate) widths: Vec<u32>,
}

/// All choices.
#[derive(Clone, Debug)]
pub(crate) struct Space {
    pub(crate) groups: Vec<Group>,
    /// Formats of locked nodes, and rounding and overflow of all.
    template: Vec<Format>,
    integer: Vec<i32>,
    /// Lengths that the user allows, ascending.
    allowed: Vec<u32>,
    /// Where words fill containers: the algorithm, whose exact results need no more places than they
    /// have.
    exact: Option<Arc<Tape>>,
}

/// A choice: per group an index into its widths.
pub(crate) type Levels = Vec<u8>;

/// Why locks, couplings or widths were refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpaceError {
    /// No such node.
    #[error("{option}: no node '{name}'; {mend}")]
    UnknownNode {
        /// The option that names it.
        option: &'static str,
        /// The name.
        name: String,
        /// What to write instead.
        mend: String,
    },
    /// A length that no word has.
    #[error("--widths: {width}: expected word lengths from 1 to 32 bits")]
    Width {
        /// The length.
        width: u32,
    },
    /// Nothing to choose.
    #[error("every node is locked: nothing to tune")]
    AllLocked,
    /// Too many choices to try all.
    #[error(
        "--method exhaustive: {count:.0} combinations; at most {most} can be tried: lock or couple nodes, or give --widths"
    )]
    TooLarge {
        /// Combinations.
        count: f64,
        /// The limit.
        most: u64,
    },
}

/// Restrictions as the user gives them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Restrictions {
    /// Nodes that keep their deployed formats.
    pub(crate) locked: Vec<String>,
    /// Nodes that share a word length, by group.
    pub(crate) coupled: Vec<Vec<String>>,
    /// Word lengths that are allowed; all up to 32 bits if none are given.
    pub(crate) widths: Vec<u32>,
}

impl Space {
    /// The choices that `restrictions` leave, for nodes with the given integer bits (sign included).
    pub(crate) fn new(
        problem: &Problem,
        integer: Vec<i32>,
        restrictions: &Restrictions,
        by_design: &[bool],
    ) -> Result<Self, SpaceError> {
        let node = |option: &'static str, name: &String| {
            problem.node(name).ok_or_else(|| SpaceError::UnknownNode {
                option,
                name: name.clone(),
                mend: mend(name, problem.nodes.iter().map(|node| node.name)),
            })
        };
        let mut locked = vec![false; problem.nodes.len()];
        for name in &restrictions.locked {
            locked[node("--lock", name)?] = true;
        }
        let mut widths = restrictions.widths.clone();
        widths.sort_unstable();
        widths.dedup();
        if let Some(&width) = widths.iter().find(|width| !(1..=LONGEST).contains(*width)) {
            return Err(SpaceError::Width { width });
        }
        if widths.is_empty() {
            widths = (1..=LONGEST).collect();
        }
        let mut group_of: Vec<usize> = (0..problem.nodes.len()).collect();
        for names in &restrictions.coupled {
            let members = names
                .iter()
                .map(|name| node("--couple", name))
                .collect::<Result<Vec<_>, _>>()?;
            for &member in &members {
                group_of[member] = members[0];
            }
        }
        let mut groups = Vec::new();
        for leader in 0..problem.nodes.len() {
            let members = (0..problem.nodes.len()).filter(|&n| group_of[n] == leader && !locked[n]);
            let nodes: Vec<usize> = members.collect();
            if !nodes.is_empty() {
                groups.push(Group {
                    widths: lengths(&widths, &integer, &nodes),
                    nodes,
                });
            }
        }
        if groups.is_empty() {
            return Err(SpaceError::AllLocked);
        }
        let template = |(index, info): (usize, &cardan_datapath::NodeInfo)| {
            if locked[index] {
                info.format
            } else {
                // To nearest costs no bits and never brings a bias; floor is tried at the end, and so is
                // wrapping where it is proven and not the node's purpose.
                let overflow = match info.format.overflow {
                    Overflow::Wrap if !by_design[index] => Overflow::Saturate,
                    own => own,
                };
                Format {
                    rounding: Rounding::NearestUp,
                    overflow,
                    ..info.format
                }
            }
        };
        Ok(Self {
            groups,
            template: problem.nodes.iter().enumerate().map(template).collect(),
            integer,
            allowed: widths,
            exact: None,
        })
    }

    /// The same choices for nodes with other integer bits.
    pub(crate) fn with_integer(&self, integer: &[i32]) -> Self {
        let mut other = self.clone();
        for group in &mut other.groups {
            group.widths = lengths(&self.allowed, integer, &group.nodes);
        }
        other.integer = integer.to_vec();
        other
    }

    /// The same choices where words fill containers, whose bits cost nothing: 16-bit words share their
    /// binary point as far as their ranges allow, so that sums need no shifts, and no node has more
    /// places than its exact result.
    pub(crate) fn in_containers(&self, problem: &Problem) -> Self {
        // What wraps by design needs the range that it has.
        let shared = |(&own, format): (&i32, &Format)| match format.overflow {
            Overflow::Wrap => own,
            _ => own.max(SHARED_INTEGER),
        };
        let shared: Vec<i32> = self
            .integer
            .iter()
            .zip(&self.template)
            .map(shared)
            .collect();
        let mut other = self.with_integer(&shared);
        other.exact = problem
            .tuning
            .first()
            .map(|case| Arc::new(case.tape.clone()));
        other
    }

    /// Takes the places that exact results do not have.
    fn without_empty_places(&self, mut formats: Vec<Format>) -> Vec<Format> {
        let Some(tape) = &self.exact else {
            return formats;
        };
        let free = |node: usize| self.groups.iter().any(|group| group.nodes.contains(&node));
        let mut most: Vec<Option<u32>> = vec![Some(0); formats.len()];
        for entry in &tape.steady {
            let node = entry.node as usize;
            if entry.node == NO_NODE || !entry.op.is_recorded() || !free(node) {
                continue;
            }
            let frac = |at| {
                formats
                    .get(tape.node_of(at) as usize)
                    .map_or(0, |f| f.frac.into())
            };
            let natural = natural_frac(entry, frac).and_then(|frac| u32::try_from(frac).ok());
            most[node] = most[node].zip(natural).map(|(a, b)| a.max(b));
            // What wraps by design needs the range that it has.
            if let Some(most) = most[node]
                && formats[node].overflow != Overflow::Wrap
            {
                formats[node].frac = formats[node].frac.min(most);
            }
        }
        formats
    }

    /// The formats of a choice.
    pub(crate) fn formats(&self, levels: &[u8]) -> Vec<Format> {
        let mut formats = self.template.clone();
        for (group, &level) in self.groups.iter().zip(levels) {
            for &node in &group.nodes {
                formats[node] = self.format(node, group.widths[usize::from(level)]);
            }
        }
        self.without_empty_places(formats)
    }

    /// Every free node with the same word length.
    pub(crate) fn uniform(&self, word: u32) -> Vec<Format> {
        let mut formats = self.template.clone();
        for group in &self.groups {
            for &node in &group.nodes {
                formats[node] = self.format(node, word);
            }
        }
        self.without_empty_places(formats)
    }

    /// Integer bits of each node.
    pub(crate) fn integer(&self) -> &[i32] {
        &self.integer
    }

    /// The format of a node with that word length.
    fn format(&self, node: usize, word: u32) -> Format {
        let most = container_bits(word).cast_signed();
        let frac = (word.cast_signed() - self.integer[node]).clamp(0, most);
        Format {
            word,
            frac: frac.unsigned_abs(),
            ..self.template[node]
        }
    }

    /// The level of a group nearest to `frac` fractional bits, not below it where possible.
    pub(crate) fn level_for(&self, group: usize, frac: f64) -> u8 {
        let group = &self.groups[group];
        let integer = group
            .nodes
            .iter()
            .map(|&node| self.integer[node])
            .max()
            .unwrap_or(0);
        let wanted = frac.clamp(-100.0, 100.0).ceil() as i32 + integer;
        let found = group
            .widths
            .iter()
            .position(|&width| width.cast_signed() >= wanted);
        found.unwrap_or(group.widths.len() - 1) as u8
    }

    /// Number of combinations.
    pub(crate) fn size(&self) -> f64 {
        self.groups
            .iter()
            .map(|group| group.widths.len() as f64)
            .product()
    }

    /// The widest choice.
    pub(crate) fn widest(&self) -> Levels {
        self.groups
            .iter()
            .map(|group| (group.widths.len() - 1) as u8)
            .collect()
    }
}

/// The allowed lengths that hold the integer bits of all `nodes`.
fn lengths(allowed: &[u32], integer: &[i32], nodes: &[usize]) -> Vec<u32> {
    let needed = nodes
        .iter()
        .map(|&node| integer[node].max(1).unsigned_abs());
    let least = needed.max().unwrap_or(1);
    let mut own: Vec<u32> = allowed.iter().copied().filter(|&w| w >= least).collect();
    if own.is_empty() {
        // The range needs more than any allowed length has: the longest saturates least.
        own.extend(allowed.last());
    }
    own
}

/// Whether the deployed arithmetic would build every case's algorithm in `formats`.
pub(crate) fn builds(problem: &Problem, formats: &[Format]) -> bool {
    problem
        .tuning
        .iter()
        .all(|case| deployable(&case.tape, formats).is_ok())
}
