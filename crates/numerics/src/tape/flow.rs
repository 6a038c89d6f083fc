//! Which nodes' values enter which: the data flow of a steady step, node by node.

use std::collections::BTreeSet;

use super::{Entry, NO_NODE, Op, Ref, Tape};

/// The data flow between nodes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Flow {
    /// Nodes in the order of their first write: first those that are written before the first step only
    /// (settings), then those of a step.
    pub order: Vec<usize>,
    /// Which values enter which node, without repetition, by target and source.
    pub edges: Vec<Edge>,
    /// Nodes that a step's inputs enter.
    pub inputs: Vec<usize>,
    /// Per node in `order`, the places of its writes in a step: a node that is used again has several.
    pub writes: Vec<Vec<usize>>,
    /// Per node in `order`, the operations that write it, in words.
    pub operations: Vec<Vec<&'static str>>,
}

/// A value of one node enters another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Edge {
    /// The node that takes it.
    pub to: usize,
    /// The node that gives it.
    pub from: usize,
    /// It is the value of an earlier step.
    pub earlier: bool,
}

impl Tape {
    /// The data flow of a steady step. Decisions count: what a selection looks at enters its node. A
    /// node that takes its own value of the same step (a sum in a loop) is no edge.
    #[must_use]
    pub fn flow(&self) -> Flow {
        let mut flow = Flow::default();
        let mut edges = BTreeSet::new();
        let in_step: BTreeSet<u32> = self.steady.iter().map(|entry| entry.node).collect();
        for (body, is_step) in [(&self.before, false), (&self.steady, true)] {
            for (index, entry) in body.iter().enumerate() {
                if entry.node == NO_NODE {
                    continue;
                }
                // What a step's node holds at first is no write of a step.
                if is_step || !in_step.contains(&entry.node) {
                    flow.note(entry, is_step.then_some(index));
                }
                let here = if is_step { Ref::Here } else { Ref::Before };
                let mut sources = Sources {
                    tape: self,
                    seen: BTreeSet::new(),
                    found: BTreeSet::new(),
                };
                sources.operands_of(here(index as u32), false);
                let to = entry.node as usize;
                edges.extend(
                    sources
                        .found
                        .into_iter()
                        .filter(|&(from, earlier)| from != to || earlier)
                        .map(|(from, earlier)| Edge { to, from, earlier }),
                );
            }
        }
        flow.edges = edges.into_iter().collect();
        flow
    }

    fn entry(&self, at: Ref) -> Option<&Entry> {
        match at {
            Ref::Here(index) | Ref::Ago { index, .. } => self.steady.get(index as usize),
            Ref::Before(index) => self.before.get(index as usize),
        }
    }
}

impl Flow {
    fn note(&mut self, entry: &Entry, place: Option<usize>) {
        let node = entry.node as usize;
        let at = match self.order.iter().position(|&known| known == node) {
            Some(at) => at,
            None => {
                self.order.push(node);
                self.operations.push(Vec::new());
                self.writes.push(Vec::new());
                self.order.len() - 1
            }
        };
        if entry.op.is_recorded() {
            self.writes[at].extend(place);
        }
        let word = entry.op.word();
        if !self.operations[at].contains(&word) {
            self.operations[at].push(word);
        }
        if matches!(entry.op, Op::Input { .. }) && !self.inputs.contains(&node) {
            self.inputs.push(node);
        }
    }

    /// Position of a node in the order of first writes.
    #[must_use]
    pub fn position(&self, node: usize) -> Option<usize> {
        self.order.iter().position(|&known| known == node)
    }
}

/// The nodes behind an operation, through the truths between them.
struct Sources<'a> {
    tape: &'a Tape,
    seen: BTreeSet<(Ref, bool)>,
    found: BTreeSet<(usize, bool)>,
}

impl Sources<'_> {
    fn operands_of(&mut self, at: Ref, earlier: bool) {
        let Some(entry) = self.tape.entry(at) else {
            return;
        };
        for operand in entry.op.operands() {
            let earlier = earlier || matches!(operand, Ref::Ago { .. });
            let Some(source) = self.tape.entry(operand) else {
                continue;
            };
            if source.node != NO_NODE {
                self.found.insert((source.node as usize, earlier));
            } else if self.seen.insert((operand, earlier)) {
                self.operands_of(operand, earlier);
            }
        }
    }
}

impl<R> Op<R> {
    /// The operation in a word or two.
    #[must_use]
    pub const fn word(&self) -> &'static str {
        match self {
            Self::Input { .. } => "input",
            Self::Parameter { .. } => "setting",
            Self::Constant(_) => "constant",
            Self::Lookup(..) => "table",
            Self::Add(..) => "sum",
            Self::Sub(..) => "difference",
            Self::Mul(..) => "product",
            Self::Div(..) => "quotient",
            Self::Sqrt(_) => "square root",
            Self::Shift(..) => "power of two",
            Self::Neg(_) => "negation",
            Self::Abs(_) => "magnitude",
            Self::Select(..) => "selection",
            Self::Less(..) | Self::Negative(_) => "comparison",
            Self::External { .. } | Self::Known(_) => "truth",
            Self::Not(_) | Self::Or(..) | Self::Xor(..) | Self::Either(..) => "logic",
            Self::Raise(..) => "status",
        }
    }
}
