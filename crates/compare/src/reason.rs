//! Why a run fails: every reason with its place.

use std::borrow::Cow;
use std::fmt;

use cardan_outputs::Check;
use cardan_page::unit::reading;
use serde::{Serialize, Serializer};

use crate::bits::{BitMismatch, FrameMismatch};
use crate::format::{number, percent};
use crate::input::OnOverflow;
use crate::metrics::Violation;
use crate::nodes::Occurrence;

/// A reason to fail. Its text (also in JSON) names the place.
#[derive(Clone, Debug, PartialEq)]
pub enum Reason {
    /// A node differs from its model by more than its tolerance.
    ToleranceMissed {
        /// The node.
        node: String,
        /// Its unit.
        unit: String,
        /// `golden` or `real`.
        against: &'static str,
        /// Largest difference.
        max_abs: f64,
        /// Largest permitted difference.
        tolerance: f64,
        /// The first one beyond it.
        first: Violation,
    },
    /// A node leaves the range of its format, and that is not what its wrapping is for.
    Overflows {
        /// The node.
        node: String,
        /// Its unit.
        unit: String,
        /// Overflows that native counted, over the whole run.
        count: u64,
        /// What becomes of the value.
        does: OnOverflow,
        /// Smallest and largest value of its format.
        range: (f64, f64),
        /// The first value that is beyond the range by itself.
        first: Occurrence,
    },
    /// The checkout's firmware is another than the one that was run.
    Stale(String),
    /// A figure is worse than in a stored run.
    WorseThanBaseline {
        /// The figure.
        figure: String,
        /// Its value.
        value: f64,
        /// What it was; none where the stored run has it and this one does not.
        before: f64,
        /// By how much it may be worse, 0.1 is 10 %.
        margin: f64,
    },
    /// The differences of a node are more, or lie more to one side, than rounding explains.
    NotRounding {
        /// The node.
        node: String,
        /// `golden` or `real`.
        against: &'static str,
        /// `root mean square` or `mean`.
        statistic: &'static str,
        /// It, in expected deviations.
        value: f64,
        /// Its limit.
        limit: f64,
    },
    /// A node has a tolerance but no value to judge: every solution is flagged, or no model knows it.
    NothingJudged {
        /// The node.
        node: String,
    },
    /// Native and emulated raw integers differ.
    BitsDiffer {
        /// The node.
        node: String,
        /// Values that differ or lack a partner.
        mismatches: u64,
        /// Values that both wrote.
        compared: u64,
        /// The first difference.
        first: BitMismatch,
    },
    /// Native and emulated frames differ.
    FramesDiffer {
        /// Frames that differ or lack a partner.
        mismatches: u64,
        /// Frames that both sent.
        compared: u64,
        /// The first difference.
        first: FrameMismatch,
    },
    /// No frame was there to compare.
    NoFrames,
    /// What a message says is not what golden computed, or it cannot be read.
    MessageWrong {
        /// Whose message.
        side: &'static str,
        /// What is wrong, with its place.
        what: String,
    },
    /// A status bit differs from golden's where rounding does not decide.
    StatusDiffers {
        /// Whose bit.
        side: &'static str,
        /// Its name.
        bit: String,
        /// Solutions in which it differs.
        count: u64,
        /// The first of them.
        solution: usize,
        /// Whether it is set there.
        is_set: bool,
    },
    /// Rounding decides a status bit too often for it to be judged.
    StatusDoubtful {
        /// Its name.
        bit: String,
        /// Share of solutions, 0 to 1.
        share: f64,
        /// Largest permitted share.
        limit: f64,
    },
    /// Too many solutions carry status bits.
    TooManyFlagged {
        /// Share of solutions, 0 to 1.
        share: f64,
        /// Largest permitted share.
        limit: f64,
    },
    /// A stage's own check is beyond its limits.
    CheckMissed(Check),
    /// Compiled code and native model give different results.
    CompiledDiffers {
        /// By how much, rms.
        by: f64,
        /// Its unit, in words.
        unit: String,
    },
    /// Streams that belong together have different lengths.
    LengthsDiffer {
        /// What they are streams of.
        what: String,
        /// Whose they are.
        names: [Cow<'static, str>; 2],
        /// How long they are.
        lengths: [usize; 2],
    },
    /// The device gave fewer solutions than the run has.
    TooFewSolutions {
        /// Those that it sent.
        found: u64,
        /// Those that the run has.
        planned: u64,
    },
    /// The truth is known in too few of the solutions that are judged by it.
    TruthSparse {
        /// The group's key.
        of: String,
        /// Solutions with a truth.
        known: u64,
        /// Solutions without status flags.
        unflagged: u64,
    },
    /// The differences of all nodes together are far smaller than what is expected of them: the limits that
    /// follow from it mean nothing.
    LimitsTooWide {
        /// Root mean square of the differences over their expected deviations.
        rms: f64,
        /// Least that is expected.
        least: f64,
    },
    /// Messages were lost on the link.
    MessagesLost(u64),
    /// Conversions were taken late.
    LateConversions(u64),
    /// Conversions were never taken.
    LostConversions(u64),
    /// Solutions were not finished in time.
    MissedDeadlines(u64),
    /// The device left the schedule of its design.
    Mistimed {
        /// How often.
        count: u64,
        /// The first time, in words.
        first: String,
    },
    /// The error against truth is beyond the scenario's limit.
    TruthMissed {
        /// The group's key.
        of: String,
        /// Its unit, in words.
        unit: String,
        /// `rms`, `p99` or `max`.
        statistic: &'static str,
        /// The error.
        value: f64,
        /// The limit.
        limit: f64,
    },
    /// The scenario limits the error against truth, but no solution without flags has a truth.
    NoTruth {
        /// The group's key.
        of: String,
    },
    /// The parts of the error budget do not add up.
    BudgetOpen {
        /// By how much.
        by: f64,
        /// Its unit, in words.
        unit: String,
    },
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ToleranceMissed {
                node,
                unit,
                against,
                max_abs,
                tolerance,
                first,
            } => {
                let reading = reading(unit);
                let (unit, scale) = (reading.suffix(), reading.scale);
                write!(
                    f,
                    "node {node}: differs from {against} by up to {}{unit}, tolerance {}{unit}; \
                     first in solution {} (sample {}): {against} {}{unit}, native {}{unit}",
                    number(scale * max_abs),
                    number(scale * tolerance),
                    first.solution,
                    first.sample,
                    scale * first.reference(),
                    scale * first.native,
                )
            }
            Self::Overflows {
                node,
                unit,
                count,
                does,
                range: (least, most),
                first,
            } => {
                let reading = reading(unit);
                let (unit, scale) = (reading.suffix(), reading.scale);
                let does = match does {
                    OnOverflow::Saturates => "saturates",
                    OnOverflow::Wraps | OnOverflow::Turns => "wraps",
                };
                write!(
                    f,
                    "node {node}: {does} {}: its format holds {} to {}{unit}; first in solution {} \
                     (sample {}), where the same algorithm in f64 has {}{unit}",
                    counted(*count, "time"),
                    number(scale * least),
                    number(scale * most),
                    first.solution,
                    first.sample,
                    number(scale * first.real),
                )
            }
            Self::WorseThanBaseline {
                figure,
                value,
                before,
                margin,
            } if value.is_nan() => write!(
                f,
                "baseline: {figure} is not there any more; it was {} (margin {})",
                number(*before),
                percent(*margin),
            ),
            Self::WorseThanBaseline {
                figure,
                value,
                before,
                margin,
            } => write!(
                f,
                "baseline: {figure} is {}, and was {} (margin {})",
                number(*value),
                number(*before),
                percent(*margin),
            ),
            Self::Stale(what) => write!(f, "image: {what}"),
            Self::NotRounding {
                node,
                against,
                statistic,
                value,
                limit,
            } => write!(
                f,
                "node {node}: the {statistic} of its differences from {against} is {} of the \
                 deviations that rounding explains, limit {}",
                number(*value),
                number(*limit),
            ),
            Self::NothingJudged { node } => write!(
                f,
                "node {node}: has a tolerance, but no solution without status flags has a value to \
                 judge it by"
            ),
            Self::BitsDiffer {
                node,
                mismatches,
                compared,
                first,
            } => write!(
                f,
                "node {node}: native and emulated differ in {} of {compared}; first in solution {} \
                 (sample {}): native {}, emulated {}",
                counted(*mismatches, "value"),
                first.solution,
                first.sample,
                or_missing(first.native),
                or_missing(first.emulated),
            ),
            Self::FramesDiffer {
                mismatches,
                compared,
                first,
            } => write!(
                f,
                "frames: native and emulated differ in {} of {compared}; first is frame {}: native \
                 {}, emulated {}",
                counted(*mismatches, "frame"),
                first.frame,
                or_missing(first.native.as_ref()),
                or_missing(first.emulated.as_ref()),
            ),
            Self::NoFrames => write!(f, "frames: none were compared"),
            Self::MessageWrong { side, what } => write!(f, "frames: {side}: {what}"),
            Self::StatusDiffers {
                side,
                bit,
                count,
                solution,
                is_set,
            } => {
                let (set, golden) = if *is_set {
                    ("set", "not")
                } else {
                    ("not set", "set")
                };
                write!(
                    f,
                    "status: {bit} of {side} differs from golden's in {}; first in solution \
                     {solution}, where it is {set} and golden's is {golden}",
                    counted(*count, "solution"),
                )
            }
            Self::StatusDoubtful { bit, share, limit } => write!(
                f,
                "status: rounding decides {bit} in {} of the solutions, limit {}: it cannot be judged",
                percent(*share),
                percent(*limit),
            ),
            Self::TooManyFlagged { share, limit } => write!(
                f,
                "status: {} of the solutions carry status bits, limit {}",
                percent(*share),
                percent(*limit),
            ),
            Self::CheckMissed(check) => {
                let space = if check.unit.is_empty() { "" } else { " " };
                write!(
                    f,
                    "{}: {} is {}{space}{}, expected {} to {}",
                    check.party,
                    check.what,
                    number(check.value),
                    check.unit,
                    number(check.least),
                    number(check.most),
                )?;
                match check.reason.as_str() {
                    "" => Ok(()),
                    reason => write!(f, " ({reason})"),
                }
            }
            Self::CompiledDiffers { by, unit } => write!(
                f,
                "error budget: compiled code differs from native by {} {unit} rms, expected 0",
                number(*by)
            ),
            Self::LengthsDiffer {
                what,
                names: [left, right],
                lengths: [left_length, right_length],
            } => write!(
                f,
                "{what}: lengths differ, {left} {left_length}, {right} {right_length}"
            ),
            Self::TooFewSolutions { found, planned } => write!(
                f,
                "device: gave {found} of the run's {planned} solutions: it stopped, or was too slow"
            ),
            Self::TruthSparse {
                of,
                known,
                unflagged,
            } => write!(
                f,
                "{of}: tolerance.truth is set, but the truth is known in {known} of {unflagged} solutions \
                 without status flags only"
            ),
            Self::LimitsTooWide { rms, least } => write!(
                f,
                "nodes: the differences of all nodes are {} of the deviations that rounding explains, \
                 expected at least {}: limits so wide judge nothing",
                number(*rms),
                number(*least),
            ),
            Self::MessagesLost(count) => write!(f, "link: {} lost", counted(*count, "message")),
            Self::LateConversions(count) => {
                write!(f, "timing: {} taken late", counted(*count, "conversion"))
            }
            Self::LostConversions(count) => {
                write!(f, "timing: {} lost", counted(*count, "conversion"))
            }
            Self::Mistimed { count, first } => {
                write!(
                    f,
                    "{} off the design's schedule; first: {first}",
                    counted(*count, "event")
                )
            }
            Self::MissedDeadlines(count) => {
                write!(f, "timing: {} missed", counted(*count, "deadline"))
            }
            Self::TruthMissed {
                of,
                unit,
                statistic,
                value,
                limit,
            } => write!(
                f,
                "{of}: {statistic} error against truth is {} {unit}, limit {}",
                number(*value),
                number(*limit),
            ),
            Self::NoTruth { of } => write!(
                f,
                "{of}: tolerance.truth is set, but no solution without status flags has a truth"
            ),
            Self::BudgetOpen { by, unit } => write!(
                f,
                "error budget: the parts miss the whole error by {} {unit}",
                number(*by)
            ),
        }
    }
}

impl Serialize for Reason {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

fn counted(count: u64, noun: &str) -> String {
    let ending = if count == 1 { "" } else { "s" };
    format!("{count} {noun}{ending}")
}

fn or_missing<T: fmt::Display>(value: Option<T>) -> String {
    value.map_or_else(|| "missing".to_owned(), |value| value.to_string())
}
