//! Pass or fail, and every reason for the latter.

use cardan_outputs::{Check, Group, Is};
use serde::Serialize;

use crate::bits::FrameComparison;
use crate::chain::{BudgetDetail, ErrorBudget, GroupErrors};
use crate::input::{Comparison, Reference, TruthTolerance};
use crate::messages::OutputReport;
use crate::metrics::exceeds;
use crate::reason::Reason;

/// The parts of the budget must add up to the whole error within this, in the group's unit.
pub(crate) const CLOSURE_LIMIT: f64 = 1e-9;

/// Share of the solutions without status flags in which the truth must be known for it to be judged.
const LEAST_KNOWN: f64 = 0.1;

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

/// What is wrong with the run as a whole; `errors` are those against truth and against golden.
pub(crate) fn check_run(
    comparison: &Comparison,
    group: &Group,
    [truth, golden]: [Option<&GroupErrors>; 2],
    outputs: &[OutputReport],
    (budget, detail): (&ErrorBudget, &BudgetDetail),
    unflagged: u64,
    reasons: &mut Vec<Reason>,
) {
    check_stages(comparison, group, detail, reasons);
    check_tuned(comparison, group, golden, reasons);
    check_outputs(comparison, outputs, reasons);
    let unit = group.unit.words.as_ref();
    let compiled = comparison
        .chain
        .stages
        .iter()
        .find(|stage| stage.stage.is == Is::Emulated);
    if let Some(by) = compiled.and_then(|stage| budget.part(&stage.stage.part))
        && exceeds(by, 0.0)
    {
        let unit = unit.to_owned();
        reasons.push(Reason::CompiledDiffers { by, unit });
    }
    if let Some(tolerance) = comparison.truth_tolerance {
        check_truth(tolerance, group, truth, unflagged, reasons);
    }
    if let Some(by) = detail.closure
        && exceeds(by, CLOSURE_LIMIT)
    {
        let unit = unit.to_owned();
        reasons.push(Reason::BudgetOpen { by, unit });
    }
}

/// The budget that the word lengths were tuned to.
fn check_tuned(
    comparison: &Comparison,
    group: &Group,
    golden: Option<&GroupErrors>,
    reasons: &mut Vec<Reason>,
) {
    for error in comparison.tuned.iter().flat_map(|tuned| &tuned.errors) {
        let spread = golden.and_then(|errors| {
            let is_whole = error.subject == group.key;
            if is_whole {
                errors.whole()
            } else {
                errors.named(&error.subject)
            }
        });
        let value = spread.and_then(|spread| match error.statistic.as_str() {
            "rms" => spread.rms,
            "p99" => spread.p99,
            _ => spread.max,
        });
        let check = Check {
            party: "word lengths".to_owned(),
            what: format!("{} of {} against golden", error.statistic, error.subject),
            value: value.unwrap_or(f64::NAN),
            least: 0.0,
            most: error.most,
            unit: group.unit.words.to_string(),
            reason: format!("tuned to {}", error.text),
        };
        if !check.is_met() {
            reasons.push(Reason::CheckMissed(check));
        }
    }
}

/// Limits of single outputs.
fn check_outputs(comparison: &Comparison, outputs: &[OutputReport], reasons: &mut Vec<Reason>) {
    for limit in &comparison.output_limits {
        let found = outputs.iter().find(|output| output.name == limit.output);
        let against = found.and_then(|output| match limit.against {
            Reference::Golden => Some(output.against.golden),
            Reference::Truth => output.against.truth,
        });
        let value = against.and_then(|found| match limit.statistic.as_str() {
            "rms" => found.rms,
            "p99" => found.p99,
            "bias" => found.bias.map(f64::abs),
            _ => found.max,
        });
        let check = Check {
            party: "outputs".to_owned(),
            what: format!(
                "{} of {} against {}",
                limit.statistic,
                limit.output,
                limit.against.name()
            ),
            value: value.unwrap_or(f64::NAN),
            least: 0.0,
            most: limit.most,
            unit: found.map(|output| output.unit.clone()).unwrap_or_default(),
            reason: limit.reason.clone(),
        };
        if !check.is_met() {
            reasons.push(Reason::CheckMissed(check));
        }
    }
}

/// The size of each part that has a limit.
fn check_stages(
    comparison: &Comparison,
    group: &Group,
    detail: &BudgetDetail,
    reasons: &mut Vec<Reason>,
) {
    let what = (group.combined.as_ref()).map_or("error", |combined| combined.what.as_str());
    for (name, limit) in &comparison.stage_limits {
        let part = detail.parts.iter().find(|part| part.part == *name);
        let rms = part.and_then(|part| part.size()?.rms);
        let check = Check {
            party: format!("error budget, {name}"),
            what: format!("root mean square of the {what}"),
            value: rms.unwrap_or(f64::NAN),
            least: 0.0,
            most: limit.most,
            unit: group.unit.words.to_string(),
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

fn check_truth(
    tolerance: TruthTolerance,
    group: &Group,
    truth: Option<&GroupErrors>,
    unflagged: u64,
    reasons: &mut Vec<Reason>,
) {
    let whole = truth
        .and_then(GroupErrors::whole)
        .copied()
        .unwrap_or_default();
    if whole.samples == 0 {
        reasons.push(Reason::NoTruth {
            of: group.key.clone(),
        });
        return;
    }
    if (whole.samples as f64) < LEAST_KNOWN * unflagged as f64 {
        reasons.push(Reason::TruthSparse {
            of: group.key.clone(),
            known: whole.samples,
            unflagged,
        });
    }
    for (statistic, value, limit) in [
        ("rms", whole.rms, tolerance.rms),
        ("p99", whole.p99, tolerance.p99),
        ("max", whole.max, tolerance.max),
    ] {
        if let (Some(value), Some(limit)) = (value, limit)
            && exceeds(value, limit)
        {
            reasons.push(Reason::TruthMissed {
                of: group.key.clone(),
                unit: group.unit.words.to_string(),
                statistic,
                value,
                limit,
            });
        }
    }
}
