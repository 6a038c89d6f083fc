//! Pass or fail, and every reason for the latter.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::attitude::AttitudeErrors;
use crate::bits::{BitMismatch, FrameComparison, FrameMismatch};
use crate::budget::{BudgetDetail, ErrorBudget};
use crate::format::{number, percent};
use crate::input::{Comparison, OnOverflow, TruthTolerance};
use crate::metrics::{Violation, exceeds};
use crate::nodes::Occurrence;
use cardan_outputs::Check;
use cardan_page::unit::reading;

/// The parts of the budget must add up to the whole error within this, in degrees.
pub(crate) const CLOSURE_LIMIT_DEG: f64 = 1e-9;

/// Whether the firmware does what the models say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Nothing is wrong.
    Pass,
    /// At least one reason says what is.
    Fail,
}

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
    CompiledDiffers(f64),
    /// Streams that belong together have different lengths.
    LengthsDiffer {
        /// What they are streams of.
        what: String,
        /// Whose they are.
        names: [&'static str; 2],
        /// How long they are.
        lengths: [usize; 2],
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
        /// `rms`, `p99` or `max`.
        statistic: &'static str,
        /// The error in degrees.
        value_deg: f64,
        /// The limit in degrees.
        limit_deg: f64,
    },
    /// The scenario limits the error against truth, but no solution without flags has a truth.
    NoTruth,
    /// The parts of the error budget do not add up, by this many degrees.
    BudgetOpen(f64),
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
            Self::CheckMissed(check) => write!(
                f,
                "{}: {} is {} {}, expected {} to {} ({})",
                check.party,
                check.what,
                number(check.value),
                check.unit,
                number(check.least),
                number(check.most),
                check.reason,
            ),
            Self::CompiledDiffers(by) => write!(
                f,
                "error budget: compiled code differs from native by {} degrees rms, expected 0",
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
                statistic,
                value_deg,
                limit_deg,
            } => write!(
                f,
                "attitude: {statistic} error against truth is {} degrees, limit {}",
                number(*value_deg),
                number(*limit_deg),
            ),
            Self::NoTruth => write!(
                f,
                "attitude: tolerance.truth is set, but no solution without status flags has a truth"
            ),
            Self::BudgetOpen(by) => write!(
                f,
                "error budget: the parts miss the whole error by {} degrees",
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

/// What went wrong on the way of the data: link, timing, and the stages' own checks. These come first,
/// since whatever else differs may follow from them.
pub(crate) fn check_chain(comparison: &Comparison, reasons: &mut Vec<Reason>) {
    let emulator = &comparison.emulator;
    let missed = comparison.checks.iter().filter(|check| !check.is_met());
    let (controller, others): (Vec<&Check>, Vec<&Check>) =
        missed.partition(|check| check.party == Check::CONTROLLER);
    if comparison.link.lost > 0 {
        reasons.push(Reason::MessagesLost(comparison.link.lost));
    }
    reasons.extend(controller.into_iter().cloned().map(Reason::CheckMissed));
    let counts = [
        (
            emulator.late_conversions,
            Reason::LateConversions as fn(u64) -> _,
        ),
        (emulator.lost_conversions, Reason::LostConversions),
        (emulator.missed_deadlines, Reason::MissedDeadlines),
    ];
    for (count, reason) in counts {
        if count > 0 {
            reasons.push(reason(count));
        }
    }
    if emulator.mistimed > 0 {
        reasons.push(Reason::Mistimed {
            count: emulator.mistimed,
            first: emulator.first_mistimed.clone().unwrap_or_default(),
        });
    }
    reasons.extend(others.into_iter().cloned().map(Reason::CheckMissed));
}

/// What is wrong with the run as a whole.
pub(crate) fn check_run(
    comparison: &Comparison,
    attitude: Option<&AttitudeErrors>,
    against_golden: Option<&AttitudeErrors>,
    budget: (&ErrorBudget, &BudgetDetail),
    reasons: &mut Vec<Reason>,
) {
    let (budget, detail) = budget;
    check_series(comparison, reasons);
    check_stages(comparison, detail, reasons);
    check_tuned(comparison, against_golden, reasons);
    if let Some(compiled) = budget.compiled
        && exceeds(compiled, 0.0)
    {
        reasons.push(Reason::CompiledDiffers(compiled));
    }
    if let Some(tolerance) = comparison.truth_tolerance {
        check_truth(tolerance, attitude, reasons);
    }
    if let Some(open) = detail.closure_deg
        && exceeds(open, CLOSURE_LIMIT_DEG)
    {
        reasons.push(Reason::BudgetOpen(open));
    }
}

/// The budget that the word lengths were tuned to.
fn check_tuned(
    comparison: &Comparison,
    against_golden: Option<&AttitudeErrors>,
    reasons: &mut Vec<Reason>,
) {
    for error in comparison.tuned.iter().flat_map(|tuned| &tuned.errors) {
        let spread = against_golden.map(|errors| match error.subject.as_str() {
            "yaw" => errors.yaw,
            "pitch" => errors.pitch,
            "roll" => errors.roll,
            _ => errors.total,
        });
        let value = spread.and_then(|spread| match error.statistic.as_str() {
            "rms" => spread.rms_deg,
            "p99" => spread.p99_deg,
            _ => spread.max_deg,
        });
        let check = Check {
            party: "word lengths".to_owned(),
            what: format!("{} of {} against golden", error.statistic, error.subject),
            value: value.unwrap_or(f64::NAN),
            least: 0.0,
            most: error.most_deg,
            unit: "degrees".to_owned(),
            reason: format!("tuned to {}", error.text),
        };
        if !check.is_met() {
            reasons.push(Reason::CheckMissed(check));
        }
    }
}

/// The rms rotation of each part that has a limit.
fn check_stages(comparison: &Comparison, detail: &BudgetDetail, reasons: &mut Vec<Reason>) {
    for (name, limit) in &comparison.stage_limits {
        let part = detail.parts.iter().find(|part| part.part == *name);
        let rms_deg = part.and_then(|part| part.rotation.rms_deg);
        let check = Check {
            party: format!("error budget, {name}"),
            what: "root mean square of the rotation".to_owned(),
            value: rms_deg.unwrap_or(f64::NAN),
            least: 0.0,
            most: limit.most,
            unit: "degrees".to_owned(),
            reason: limit.reason.clone(),
        };
        if !check.is_met() {
            reasons.push(Reason::CheckMissed(check));
        }
    }
}

pub(crate) fn check_frames(frames: &FrameComparison, reasons: &mut Vec<Reason>) {
    if let Some(first) = &frames.first_mismatch {
        reasons.push(Reason::FramesDiffer {
            mismatches: frames.mismatches,
            compared: frames.compared,
            first: first.clone(),
        });
    }
}

/// Every series that exists has one entry per solution.
fn check_series(comparison: &Comparison, reasons: &mut Vec<Reason>) {
    let attitudes = &comparison.attitudes;
    let expected = comparison.flags.len();
    let mut check = |what: String, name: &'static str, length: usize| {
        if length != 0 && length != expected {
            reasons.push(Reason::LengthsDiffer {
                what,
                names: ["native's solutions", name],
                lengths: [expected, length],
            });
        }
    };
    for (name, series) in [
        ("truth", &attitudes.truth),
        ("golden on ideal readings", &attitudes.direct),
        ("golden on the true experience", &attitudes.experienced),
        ("golden on ideal voltages", &attitudes.ideal),
        ("golden on codes", &attitudes.codes),
        ("real", &attitudes.real),
        ("native", &attitudes.deployed),
        ("emulated", &attitudes.emulated),
    ] {
        check("attitudes".to_owned(), name, series.0.len());
    }
    for step in &attitudes.rounding_steps {
        let what = format!("attitudes with the rounding of {}", step.node);
        check(what, "step", step.attitudes.0.len());
    }
    check("status flags".to_owned(), "golden", comparison.status.len());
}

fn check_truth(
    tolerance: TruthTolerance,
    attitude: Option<&AttitudeErrors>,
    reasons: &mut Vec<Reason>,
) {
    let total = attitude.map(|attitude| attitude.total).unwrap_or_default();
    if total.samples == 0 {
        reasons.push(Reason::NoTruth);
        return;
    }
    for (statistic, value, limit) in [
        ("rms", total.rms_deg, tolerance.rms_deg),
        ("p99", total.p99_deg, tolerance.p99_deg),
        ("max", total.max_deg, tolerance.max_deg),
    ] {
        if let (Some(value_deg), Some(limit_deg)) = (value, limit)
            && exceeds(value_deg, limit_deg)
        {
            reasons.push(Reason::TruthMissed {
                statistic,
                value_deg,
                limit_deg,
            });
        }
    }
}
