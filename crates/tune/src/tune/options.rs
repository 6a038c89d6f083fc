//! How to tune, and what a journal must agree in.

use std::path::PathBuf;

use crate::cost::Cost;
use crate::problem::Problem;
use crate::search::Method;

/// How to tune.
#[derive(Clone, Debug)]
pub struct Options {
    /// What must be met.
    pub budget: Vec<String>,
    /// What is to be small.
    pub cost: Cost,
    /// How to search.
    pub method: Method,
    /// Seed of every random number.
    pub seed: u64,
    /// Threads.
    pub threads: usize,
    /// Guard bits over simulated ranges that are not proven.
    pub guard_bits: u32,
    /// Nodes that keep their formats.
    pub locked: Vec<String>,
    /// Nodes that share a word length.
    pub coupled: Vec<Vec<String>>,
    /// Allowed word lengths; all if empty.
    pub widths: Vec<u32>,
    /// Most candidates to simulate.
    pub evaluations: Option<u64>,
    /// Most seconds to search (makes the result depend on the host's speed).
    pub seconds: Option<f64>,
    /// Most candidates without a better one.
    pub patience: Option<u64>,
    /// Where evaluations are kept for a later continuation.
    pub journal: Option<PathBuf>,
    /// Fresh runs per round of verification, where a source of them is given; fewer than 94 of them need
    /// a model of how far runs stretch a limit.
    pub fresh: u64,
    /// Factors on the limits for the Pareto front.
    pub pareto: Vec<f64>,
}

impl Options {
    /// The default search for a budget.
    #[must_use]
    pub fn new<S: Into<String>>(budget: impl IntoIterator<Item = S>) -> Self {
        Self {
            budget: budget.into_iter().map(Into::into).collect(),
            cost: Cost::Bits,
            method: Method::Sensitivity,
            seed: 1,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            guard_bits: 0,
            locked: Vec::new(),
            coupled: Vec::new(),
            widths: Vec::new(),
            evaluations: None,
            seconds: None,
            patience: None,
            journal: None,
            fresh: 94,
            pareto: vec![4.0, 2.0, 1.0, 0.5, 0.25],
        }
    }

    /// The allowed word lengths: containers alone count on a controller, unless the user says
    /// otherwise; a bit less than the longest leaves room for a carry.
    pub(super) fn effective_widths(&self) -> Vec<u32> {
        if self.widths.is_empty() && matches!(self.cost, Cost::Cycles(_)) {
            vec![8, 16, 31]
        } else {
            self.widths.clone()
        }
    }

    /// What a journal must agree in.
    pub(super) fn identity(&self, problem: &Problem) -> String {
        let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
        let inputs = problem
            .tuning
            .iter()
            .map(|case| (&case.tape, &case.inputs, &case.references));
        let all = (
            &self.budget,
            &self.cost,
            self.method,
            self.seed,
            self.guard_bits,
        );
        let space = (&self.locked, &self.coupled, &self.widths, &problem.nodes);
        // Hashing text cannot fail.
        let _ = std::fmt::Write::write_fmt(
            &mut hash,
            format_args!("{all:?} {space:?} {:?}", inputs.collect::<Vec<_>>()),
        );
        format!("{} {:016x}", env!("CARGO_PKG_VERSION"), hash.0)
    }
}

/// FNV-1a over text.
struct Fnv(u64);

impl std::fmt::Write for Fnv {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        for byte in text.bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        Ok(())
    }
}
