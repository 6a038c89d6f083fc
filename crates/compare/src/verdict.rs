//! Pass or fail, and every reason for the latter.

use cardan_outputs::Check;
use serde::Serialize;

use crate::attitude::AttitudeErrors;
use crate::bits::FrameComparison;
use crate::budget::{BudgetDetail, ErrorBudget};
use crate::input::{Comparison, TruthTolerance};
use crate::metrics::exceeds;
use crate::reason::Reason;

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
