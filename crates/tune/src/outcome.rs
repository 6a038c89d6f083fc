//! What a search found, as it is reported.

use cardan_datapath::wordlengths::TunedTolerance;
use cardan_datapath::{Format, NodeInfo};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::noise::NodeNoise;
use crate::ranges::NodeRange;

/// A value against its limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reached {
    /// The budget expression.
    pub constraint: String,
    /// What was reached; none where it could not be measured.
    pub value: Option<f64>,
    /// How far it stretches the limit: up to 1 is within.
    pub ratio: Option<f64>,
}

/// Formats by node name, in the order of the nodes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NamedFormats(pub Vec<(String, Format)>);

impl NamedFormats {
    pub(crate) fn new(nodes: &[NodeInfo], formats: &[Format]) -> Self {
        let named = nodes.iter().zip(formats);
        Self(
            named
                .map(|(node, &format)| (node.name.to_owned(), format))
                .collect(),
        )
    }

    /// Whether these are `formats`.
    pub(crate) fn is(&self, formats: &[Format]) -> bool {
        self.0.iter().map(|(_, own)| own).eq(formats)
    }
}

#[derive(Serialize)]
struct FormatDocument {
    word: u32,
    frac: u32,
    rounding: &'static str,
    overflow: &'static str,
}

impl Serialize for NamedFormats {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, format) in &self.0 {
            let document = FormatDocument {
                word: format.word,
                frac: format.frac,
                rounding: format.rounding.name(),
                overflow: format.overflow.name(),
            };
            map.serialize_entry(name, &document)?;
        }
        map.end()
    }
}

/// What the target takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct OnTarget {
    /// Cycles of a solution, mean.
    pub cycles: f64,
    /// Flash in bytes.
    pub flash: f64,
    /// Static RAM in bytes.
    pub ram: f64,
}

/// A candidate.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Candidate {
    /// What it is.
    pub name: String,
    /// Sum of the word lengths.
    pub bits: u64,
    /// Cycles of a solution: measured on the target, none where it was not.
    pub cycles: Option<f64>,
    /// The cycle model's estimate.
    pub cycles_estimated: Option<f64>,
    /// Flash, measured.
    pub flash: Option<f64>,
    /// Static RAM, measured.
    pub ram: Option<f64>,
    /// Estimated silicon area in gate equivalents.
    pub area: Option<f64>,
    /// The first error of the budget.
    pub error: Option<f64>,
    /// Every figure of the budget.
    pub reached: Vec<Reached>,
    /// The formats.
    pub formats: NamedFormats,
}

/// A point of the Pareto front.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Point {
    /// The budget's limits were taken times this.
    pub limit_factor: f64,
    /// Sum of the word lengths.
    pub bits: u64,
    /// Cost in the search's own measure.
    pub cost: f64,
    /// The first error of the budget.
    pub error: Option<f64>,
    /// The formats.
    pub formats: NamedFormats,
}

/// How often a status bit was raised, over all solutions of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FlagCount {
    /// The bit's mask.
    pub bit: u16,
    /// By the algorithm on real numbers.
    pub real: u64,
    /// In these formats.
    pub tuned: u64,
    /// By one of them alone.
    pub differing: u64,
}

/// What fresh runs tell of all runs like them: how far each stretches a limit is taken as normally
/// distributed over seeds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Statistics {
    /// Fresh runs that the result was verified on.
    pub runs: usize,
    /// Of these, runs that meet every limit.
    pub holding: usize,
    /// So many runs hold without exception that no model of how they scatter is needed.
    pub by_count: bool,
    /// Rounds of search and verification, each on runs of its own.
    pub rounds: u64,
    /// Confidence over all rounds that the bounds hold for `content` of all runs.
    pub confidence: f64,
    /// The share of all runs.
    pub content: f64,
    /// Factor of the one-sided tolerance limit.
    pub factor: f64,
    /// Per constraint: mean and standard deviation of the stretch, and mean + factor deviation; up to 1
    /// is within the limit.
    pub stretches: Vec<Stretch>,
}

/// How far fresh runs stretch one limit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stretch {
    /// The budget expression.
    pub constraint: String,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
    /// What is not exceeded.
    pub bound: f64,
}

/// The best candidate on one case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verification {
    /// The case.
    pub case: String,
    /// It was not tuned on.
    pub held_out: bool,
    /// It is one of the fresh runs of the statistics.
    pub fresh: bool,
    /// Status bits that either raised.
    pub flags: Vec<FlagCount>,
    /// Every figure of the budget.
    pub reached: Vec<Reached>,
    /// Every limit is met.
    pub pass: bool,
    /// The largest stretch over that of the tuning cases: above 1 is what tuning overfitted.
    pub over_tuning: Option<f64>,
}

/// What a search found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Outcome {
    /// The budget is met on the tuning cases.
    pub feasible: bool,
    /// And on the held-out cases; with fresh runs, by their statistics too.
    pub verified: bool,
    /// The constraint that stretches most, where the budget is not met.
    pub binding: Option<String>,
    /// Why no formats can meet it, where the algorithm itself misses it.
    pub reason: Option<String>,
    /// Method.
    pub method: &'static str,
    /// Cost model.
    pub cost: &'static str,
    /// Candidates simulated.
    pub evaluations: u64,
    /// Host seconds.
    pub seconds: f64,
    /// Every node 32 bit.
    pub baseline: Candidate,
    /// The deployed formats.
    pub deployed: Candidate,
    /// The best uniform word length that meets the budget.
    pub best_uniform: Option<Candidate>,
    /// The result; the closest point where nothing meets the budget.
    pub best: Candidate,
    /// Cost against error.
    pub pareto: Vec<Point>,
    /// Candidates that were built and measured, with the model's estimates.
    pub measured: Vec<Candidate>,
    /// The result on every case.
    pub verification: Vec<Verification>,
    /// What fresh runs tell; none without any.
    pub statistics: Option<Statistics>,
    /// Errors of every node against the algorithm on real numbers: twice the largest over all cases.
    pub tolerances: Vec<TunedTolerance>,
    /// Nodes of the result that no inputs within the assumptions make overflow.
    pub proven: Vec<String>,
    /// What the proofs assume of the inputs.
    pub assumptions: Vec<String>,
    /// The noise model at the result.
    pub sensitivities: Vec<NodeNoise>,
    /// Ranges of the nodes.
    pub ranges: Vec<NodeRange>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Why the journal does not hold all that was evaluated; the result is whole all the same.
    #[serde(skip)]
    pub journal_lost: Option<String>,
}
