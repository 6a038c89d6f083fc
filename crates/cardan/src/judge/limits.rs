//! The limits of a run: the scenario's, those stated for it, and those of a word-length file.

use cardan_compare::{Limit, Tolerance, TunedError, TunedTo};
use cardan_datapath::wordlengths::Tuned;
use cardan_scenario::tolerance::Tolerance as ScenarioTolerance;

use crate::run_options::Setup;

/// The scenario's limits for the run's length, and those stated for this run.
pub(super) fn widened(setup: &Setup) -> ScenarioTolerance {
    let exact: Vec<&str> = setup.stated.iter().map(String::as_str).collect();
    setup.scenario.limits_of(setup.seconds, &exact)
}

pub(super) fn stage_limits(tolerance: &ScenarioTolerance) -> Vec<(String, Limit)> {
    let stages = &tolerance.stages;
    [
        ("latency", stages.latency_deg),
        ("motion", stages.motion_deg),
        ("sensor_frontend", stages.sensor_frontend_deg),
        ("adc", stages.adc_deg),
    ]
    .into_iter()
    .filter_map(|(name, limit)| {
        let reason = stages.reason.clone();
        Some((
            name.to_owned(),
            Limit {
                most: limit?,
                reason,
            },
        ))
    })
    .collect()
}

pub(super) fn most_flagged(tolerance: &ScenarioTolerance) -> Option<Limit> {
    Some(Limit {
        most: tolerance.status.most_flagged?,
        reason: tolerance.status.reason.clone(),
    })
}

/// The tolerance that the scenario sets, in place of what rounding explains.
pub(super) fn set_tolerance(setup: &Setup, node: &str) -> Option<Tolerance> {
    let max_abs = *setup.scenario.tolerance.nodes.get(node)?;
    Some(Tolerance {
        max_abs,
        reason: "set by the scenario".to_owned(),
    })
}

/// The tolerance that the word-length file states.
pub(super) fn tuned_tolerance(setup: &Setup, node: &str) -> Option<Tolerance> {
    let all = &setup.tuned.as_ref()?.tolerance;
    let stated = all.iter().find(|stated| stated.node == node)?;
    Some(Tolerance {
        max_abs: stated.max,
        reason: "stated by the word-length file".to_owned(),
    })
}

/// The budget of a word-length file, as far as a comparison measures it.
pub(super) fn tuned_to(tuned: &Tuned) -> TunedTo {
    let mut to = TunedTo::default();
    for text in &tuned.budget {
        let parsed = text
            .split_once("<=")
            .and_then(|(measure, limit)| Some((measure.trim(), limit.trim().parse::<f64>().ok()?)));
        match parsed {
            Some(("flags", limit)) => to.most_status = limit,
            Some((measure, most)) if !measure.starts_with("truth.") => {
                match measure.split_once('.') {
                    Some((subject, statistic)) => to.errors.push(TunedError {
                        text: text.clone(),
                        subject: subject.to_owned(),
                        statistic: statistic.to_owned(),
                        most,
                    }),
                    None => to.unjudged.push(text.clone()),
                }
            }
            _ => to.unjudged.push(text.clone()),
        }
    }
    to
}

pub(super) fn allowance(bundled: &[cardan_bench::app::Tolerance], node: &str) -> Option<Tolerance> {
    let bundled = bundled.iter().find(|tolerance| tolerance.node == node)?;
    Some(Tolerance {
        max_abs: bundled.max_abs,
        reason: bundled.reason.to_owned(),
    })
}
