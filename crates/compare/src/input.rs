//! What a comparison is made of: plain data that the caller collects from the participants.

use cardan_outputs::{Check, Message, Outputs, Status};
use serde::Serialize;

pub use crate::overflow::{Format, OnOverflow};
use crate::series::Chain;

/// Everything one run leaves behind, or a window of it: whatever is a list per solution, or per value, then holds
/// that of the window's solutions.
#[derive(Clone, Debug, Default)]
pub struct Comparison {
    /// What was run.
    pub run: Run,
    /// What the run must have; `None` judges what there is.
    pub required: Option<Required>,
    /// The nodes in signal order, shared ones and those of the implementation alone.
    pub nodes: Vec<Node>,
    /// Frames on the serial line.
    pub frames: Frames,
    /// Native's status word per solution.
    pub flags: Vec<u32>,
    /// What the product sends.
    pub outputs: Outputs,
    /// Its messages, decoded by the golden side.
    pub messages: Messages,
    /// The reference's status per solution; empty when it is not known.
    pub status: Vec<Status>,
    /// Figures of stages that no other comparison sees, each with its limits.
    pub checks: Vec<Check>,
    /// Largest root mean square that parts of the error budget may have, in the group's unit, by their names.
    pub stage_limits: Vec<(String, Limit)>,
    /// What formats were tuned to; none for formats chosen by hand.
    pub tuned: Option<TunedTo>,
    /// Largest share of solutions with status bits.
    pub most_flagged: Option<Limit>,
    /// What each stage of the chain makes of the same solutions.
    pub chain: Chain,
    /// Limits of single outputs.
    pub output_limits: Vec<OutputLimit>,
    /// Limits on the error against truth, if the scenario sets any.
    pub truth_tolerance: Option<TruthTolerance>,
    /// By which factor the scenario's limits are wider than stated, since the run is shorter; at least 1.
    pub widening: f64,
    /// What the checkout's firmware sources say of the image and of this program, where they are others
    /// than both were made of; with the command that mends it.
    pub stale: Option<String>,
    /// Counters of the emulator.
    pub emulator: EmulatorStatistics,
    /// Counters of the link.
    pub link: LinkStatistics,
    /// Parameters that are assumed, not published or measured.
    pub assumed: Vec<Assumed>,
    /// How to run it again.
    pub reproduce: Reproduce,
}

/// What a run must have. Then every stream that its nodes, outputs and stages have must be there to its end,
/// also where it is empty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Required {
    /// Solutions.
    pub solutions: u64,
}

/// Names and sizes of a run.
#[derive(Clone, Debug, Default)]
pub struct Run {
    /// The application, as in `--app`.
    pub app: String,
    /// The scenario's name.
    pub scenario: String,
    /// Seed of every random number.
    pub seed: u64,
    /// Session under which the participants met.
    pub session: String,
    /// Simulated seconds.
    pub seconds: f64,
    /// Conversions of the converter, all channels, warm-up included.
    pub samples: u64,
    /// Seconds from one solution to the next.
    pub solution_seconds: f64,
}

/// A node with its values from every participant, each stream in order of writing.
#[derive(Clone, Debug, Default)]
pub struct Node {
    /// Name.
    pub name: String,
    /// What it is, in one line; may be empty.
    pub meaning: String,
    /// The nodes whose values enter it; empty where the data flow is not known.
    pub inputs: Vec<NodeInput>,
    /// What writes it, in words; empty where that is not known.
    pub operations: Vec<String>,
    /// Its place in the order of first writes, where the data flow is known.
    pub position: Option<usize>,
    /// Places of its writes among all operations of a solution, where the data flow is known.
    pub writes: Vec<usize>,
    /// Unit; differences of `half_turn` nodes are wrapped to half a turn either way.
    pub unit: String,
    /// Values per solution; 0 is taken as 1.
    pub per_solution: usize,
    /// The deployed format, where there is one.
    pub format: Option<Format>,
    /// The value of one step of the raw integers, in the node's unit.
    pub lsb: f64,
    /// Raw integers of the native participant.
    pub native: Vec<i64>,
    /// Raw integers of the emulated participant; `None` for an image without taps.
    pub emulated: Option<Vec<i64>>,
    /// The same algorithm in f64, never rounded.
    pub real: Option<Vec<f64>>,
    /// What rounding makes of each value of `real`; `None` where that was not computed.
    pub expected: Option<Vec<Expectation>>,
    /// The golden model on the same codes; `None` for nodes that it does not know.
    pub golden: Option<Vec<f64>>,
    /// Overflows that the native participant counted.
    pub overflows: u64,
    /// Largest permitted difference, from golden or from real where golden has no such node; in place
    /// of what `expected` permits.
    pub tolerance: Option<Tolerance>,
    /// Largest permitted difference from the real interpretation of formats that were tuned to it; then
    /// it stands in place of what `expected` permits, and golden judges the outputs alone.
    pub tuned: Option<Tolerance>,
    /// By how much golden and the real interpretation may differ, beside rounding.
    pub allowance: Option<Tolerance>,
}

/// A node whose value enters another.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct NodeInput {
    /// Its name.
    pub node: String,
    /// The value is an earlier solution's.
    pub earlier: bool,
}

/// The difference that rounding is expected to make: native less real.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Expectation {
    /// Its mean, in the node's unit.
    pub bias: f64,
    /// Its standard deviation; infinite where nothing bounds it.
    pub deviation: f64,
}

/// The budget that word lengths were tuned to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TunedTo {
    /// Limits of errors against golden on the same codes.
    pub errors: Vec<TunedError>,
    /// Largest share of solutions whose status differs from golden's.
    pub most_status: f64,
    /// Budget expressions that a comparison does not measure.
    pub unjudged: Vec<String>,
}

/// A limit of a budget.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TunedError {
    /// As written.
    pub text: String,
    /// A member of the group, or the group's key for all of it.
    pub subject: String,
    /// `rms`, `p99` or `max`.
    pub statistic: String,
    /// In the group's unit.
    pub most: f64,
}

/// Messages on the line, in order, or why they could not be read.
#[derive(Clone, Debug, Default)]
pub struct Messages {
    /// Of the native participant.
    pub native: Vec<Result<Message, String>>,
    /// Of the emulated one.
    pub emulated: Vec<Result<Message, String>>,
}

/// What an output is held against.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// The golden model on the same inputs.
    Golden,
    /// The truth.
    Truth,
}

impl Reference {
    /// Its name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Golden => "golden",
            Self::Truth => "truth",
        }
    }
}

/// An upper limit of an output's error, in the output's unit.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputLimit {
    /// The output.
    pub output: String,
    /// What it is held against.
    pub against: Reference,
    /// `rms`, `p99`, `max` or `bias` (of either sign).
    pub statistic: String,
    /// Largest permitted value.
    pub most: f64,
    /// Why.
    pub reason: String,
}

/// An upper limit.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Limit {
    /// Largest permitted value.
    pub most: f64,
    /// Why.
    pub reason: String,
}

impl Node {
    /// The solution in which a value was written.
    #[must_use]
    pub fn solution_of(&self, sample: usize) -> usize {
        sample / self.per_solution.max(1)
    }

    /// Native's values in the node's unit.
    pub fn native_values(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        self.native.iter().map(|&raw| raw as f64 * self.lsb)
    }
}

/// A tolerance on a node.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tolerance {
    /// Largest permitted absolute difference, in the node's unit.
    pub max_abs: f64,
    /// Why this much.
    pub reason: String,
}

/// Limits on the error of the whole group against truth over solutions without flags, in the group's unit.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TruthTolerance {
    /// On the root mean square.
    pub rms: Option<f64>,
    /// On the 99th percentile.
    pub p99: Option<f64>,
    /// On the largest error.
    pub max: Option<f64>,
}

/// Frames as bytes on the line, in order.
#[derive(Clone, Debug, Default)]
pub struct Frames {
    /// What the native participant would send.
    pub native: Vec<Vec<u8>>,
    /// What the emulated serial port sent.
    pub emulated: Vec<Vec<u8>>,
}

/// Counters of the emulator.
#[derive(Clone, Debug, Default, Serialize)]
pub struct EmulatorStatistics {
    /// Cycles of the controller.
    pub cycles: u64,
    /// Instructions executed.
    pub instructions: u64,
    /// Simulated over host time; the only figure here that differs between equal runs.
    pub realtime_factor: f64,
    /// Part of the cycles that the core was awake, 0..1.
    pub cpu_load: f64,
    /// Largest stack in bytes; `None` where it is not measured.
    pub stack_peak: Option<u64>,
    /// Conversions whose result was taken later than the next conversion's start.
    pub late_conversions: u64,
    /// Conversions whose result was never taken.
    pub lost_conversions: u64,
    /// Longest time from an interrupt's flag to its handler's first instruction, in cycles.
    pub isr_latency_max_cycles: u64,
    /// Solutions that were not finished when the next averages were complete.
    pub missed_deadlines: u64,
    /// Pin edges, hold instants and serial bits off the design's schedule.
    pub mistimed: u64,
    /// The first of them, in words.
    pub first_mistimed: Option<String>,
    /// From the instant that a solution stands for to the end of its frame, in milliseconds, on the
    /// average: group delay, half the averaging window, computing, sending.
    pub output_latency_ms: Option<f64>,
    /// Cycle of the first conversion's hold: how long the start-up took.
    pub first_conversion_cycle: Option<u64>,
}

/// Counters of the link, all services of the session together.
#[derive(Clone, Debug, Default, Serialize)]
pub struct LinkStatistics {
    /// Messages delivered.
    pub messages: u64,
    /// Bytes of payload delivered.
    pub bytes: u64,
    /// Messages missing in a sequence.
    pub lost: u64,
}

/// A parameter that the scenario assumes.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Assumed {
    /// Its key in the scenario file.
    pub name: String,
    /// Its value with its unit.
    pub value: String,
    /// Why this value, as far as anything is known.
    pub reason: String,
}

/// Key of a line of [`Reproduce::provenance`] that says what the verdict leaves out, and why.
pub const NOT_JUDGED: &str = "not judged";

/// How to run it again.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Reproduce {
    /// The command line.
    pub command: String,
    /// What else decides the result: versions, hashes of image, formats and scenario.
    pub provenance: Vec<(String, String)>,
}
