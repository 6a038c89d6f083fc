//! What is tuned: an algorithm on inputs, with what its outputs should be.

use cardan_datapath::{Format, NodeInfo};
use cardan_numerics::Datapath;
use cardan_numerics::tape::{Inputs, Reals, Tape, TraceError};

/// An output that budgets speak of.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Name in budgets.
    pub name: String,
    /// The node whose last write of a step it is.
    pub node: usize,
    /// Budgets' units per node unit (180 degrees per half turn).
    pub scale: f64,
    /// What is the same value again, in node units (2 half turns).
    pub period: Option<f64>,
}

/// An error made of all quantities: from values and references in node units.
#[derive(Clone, Debug)]
pub struct Combined {
    /// Name in budgets.
    pub name: String,
    /// The size of the error, in budgets' units.
    pub error: fn(values: &[f64], references: &[f64]) -> f64,
}

/// The algorithm on one set of inputs.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name in reports.
    pub name: String,
    /// The algorithm, recorded with this case's settings.
    pub tape: Tape,
    /// What it takes from outside.
    pub inputs: Inputs,
    /// Bounds of the raw inputs of a step, per port: what proofs assume. Anything at all until they are
    /// declared; data never declare them.
    pub ports: Vec<(i32, i32)>,
    /// How many channels take turns on the ports (1 if each is a signal of its own kind).
    pub channels: usize,
    /// Per quantity, per step: what it should be; not a number where that is unknown.
    pub references: Vec<Vec<f64>>,
    /// Per quantity, per step: the truth, where there is one.
    pub truths: Vec<Vec<f64>>,
}

/// What is tuned.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Name in reports.
    pub name: String,
    /// Nodes with their deployed formats.
    pub nodes: Vec<NodeInfo>,
    /// Nodes that are computed outside a step's own time (in an interrupt): they cost no cycles of it.
    pub background: Vec<usize>,
    /// The arithmetic's own status bit.
    pub domain_flag: u16,
    /// Outputs that budgets speak of.
    pub quantities: Vec<Quantity>,
    /// Errors made of all of them.
    pub combined: Vec<Combined>,
    /// What formats are tuned on.
    pub tuning: Vec<Case>,
    /// What they are verified on.
    pub held_out: Vec<Case>,
}

impl Case {
    /// Records `datapath` on `steps`, the inputs of each step. Nothing is assumed of the ports, and
    /// there is no reference yet.
    ///
    /// # Errors
    /// An algorithm whose steps differ, or no steps.
    pub fn record<A: Datapath, I: AsRef<[i32]>>(
        name: &str,
        datapath: &A,
        steps: &[I],
    ) -> Result<Self, TraceError> {
        let (tape, inputs) = Tape::record(datapath, steps)?;
        Ok(Self {
            name: name.to_owned(),
            ports: vec![(i32::MIN, i32::MAX); inputs.raws.len()],
            channels: 1,
            tape,
            inputs,
            references: Vec::new(),
            truths: Vec::new(),
        })
    }

    /// Takes the algorithm's own real interpretation as the reference of `quantities`: what is
    /// measured then is rounding alone. `nodes` are the deployed ones.
    #[must_use]
    pub fn against_real(mut self, quantities: &[Quantity], nodes: &[NodeInfo]) -> Self {
        let formats: Vec<Format> = nodes.iter().map(|node| node.format).collect();
        let reals = Reals::run(&self.tape, &self.inputs, &formats, 0);
        let series = |quantity: &Quantity| {
            let value = |(step, values): (usize, &Vec<f64>)| {
                let write = self.tape.last_write_in(step, quantity.node);
                write.map_or(f64::NAN, |index| values[index])
            };
            reals.steps.iter().enumerate().map(value).collect()
        };
        self.references = quantities.iter().map(series).collect();
        self
    }
}

impl Problem {
    /// The deployed formats.
    #[must_use]
    pub fn deployed(&self) -> Vec<Format> {
        self.nodes.iter().map(|node| node.format).collect()
    }

    /// Every case.
    pub fn cases(&self) -> impl Iterator<Item = &Case> {
        self.tuning.iter().chain(&self.held_out)
    }

    /// Index of the node of that name.
    #[must_use]
    pub fn node(&self, name: &str) -> Option<usize> {
        self.nodes.iter().position(|node| node.name == name)
    }
}
