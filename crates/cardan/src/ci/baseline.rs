//! A stored run as the measure: what is worse than it by more than a margin.

use std::collections::BTreeMap;
use std::path::Path;

use cardan_compare::{Reason, Report, Verdict};
use serde_json::Value;

use crate::failure::Failure;
use crate::files;
use crate::run_options::Setup;

/// Length of runs whose figures are compared: they may differ by this share.
const SAME_LENGTH: f64 = 0.05;
/// What an angle may always change by, in degrees: the last digits of f64.
const LEAST_DEG: f64 = 1e-6;
/// What a node may always change by, in steps of its format.
const LEAST_STEPS: f64 = 0.01;
/// What a share of solutions may always change by.
const LEAST_SHARE: f64 = 1e-3;

/// A document of `compare --json`.
pub(super) struct Baseline(Value);

/// Reads the document in `file`.
pub(super) fn read(file: &Path) -> Result<Baseline, Failure> {
    let name = file.display();
    let expected = "expected what `cardan compare --json` wrote";
    let text = files::read(file)?;
    let document: Value = serde_json::from_slice(&text)
        .map_err(|error| Failure::input(format!("--baseline {name}: {expected}: {error}")))?;
    if !document["nodes"].is_array() || !document["scenario"].is_string() {
        return Err(Failure::input(format!(
            "--baseline {name}: {expected}; it has no nodes or no scenario"
        )));
    }
    Ok(Baseline(document))
}

impl Baseline {
    /// It is of the same application and scenario, and as long.
    pub(super) fn check(&self, file: &Path, setup: &Setup) -> Result<(), Failure> {
        let name = file.display();
        for (key, ours) in [
            ("app", setup.app.name()),
            ("scenario", &setup.scenario.name),
        ] {
            let theirs = self.0[key].as_str().unwrap_or_default();
            if theirs != ours {
                return Err(Failure::input(format!(
                    "--baseline {name}: it is of {key} '{theirs}', and this run of '{ours}'; compare the same"
                )));
            }
        }
        Ok(())
    }

    /// Adds to the reasons which figures are worse by more than `margin` (0.1 is 10 %), the worst first.
    pub(super) fn judge(&self, report: &mut Report, margin: f64) -> Result<(), Failure> {
        let document = serde_json::to_value(&*report).map_err(Failure::participant)?;
        let seconds = |document: &Value| document["seconds"].as_f64().unwrap_or(f64::NAN);
        let (theirs, ours) = (seconds(&self.0), seconds(&document));
        let same = (theirs / ours - 1.0).abs() <= SAME_LENGTH;
        if !same {
            return Err(Failure::input(format!(
                "--baseline: it is of {theirs} s, and this run of {ours} s; compare runs of one length"
            )));
        }
        let now = figures(&document);
        let before = figures(&self.0);
        // A document without figures would let everything pass.
        if let Some(lacking) = now.keys().find(|figure| !before.contains_key(*figure))
            && before.len() < now.len() / 2
        {
            return Err(Failure::input(format!(
                "--baseline: it has {} of this run's {} figures only, and lacks for instance '{lacking}'; \
                 store the document of such a run anew",
                before.len(),
                now.len()
            )));
        }
        let mut worse: Vec<(f64, Reason)> = Vec::new();
        for (
            figure,
            Figure {
                value: before,
                least,
            },
        ) in figures(&self.0)
        {
            let value = now.get(&figure).map_or(f64::NAN, |found| found.value);
            if value <= before * (1.0 + margin) + least {
                continue;
            }
            let ratio = if value.is_nan() {
                f64::INFINITY
            } else {
                value / before.max(least)
            };
            let reason = Reason::WorseThanBaseline {
                figure,
                value,
                before,
                margin,
            };
            worse.push((ratio, reason));
        }
        worse.sort_by(|a, b| b.0.total_cmp(&a.0));
        if !worse.is_empty() {
            report.verdict = Verdict::Fail;
        }
        report
            .reasons
            .extend(worse.into_iter().map(|(_, reason)| reason));
        Ok(())
    }
}

/// An error figure, and what it may always change by.
#[derive(Clone, Copy)]
struct Figure {
    value: f64,
    least: f64,
}

/// Every error figure of a document by its name.
fn figures(document: &Value) -> BTreeMap<String, Figure> {
    let mut all = BTreeMap::new();
    let mut add = |name: String, value: &Value, least: f64| {
        if let Some(value) = value.as_f64() {
            all.insert(name, Figure { value, least });
        }
    };
    for node in document["nodes"].as_array().into_iter().flatten() {
        let name = node["name"].as_str().unwrap_or_default();
        let frac = node["format"]["frac"].as_f64().unwrap_or(0.0);
        let least = LEAST_STEPS * (-frac).exp2();
        for (key, against) in [("golden_vs_native", "golden"), ("real_vs_native", "real")] {
            for (figure, words) in [("rms", "rms"), ("max_abs", "largest")] {
                let unit = node["unit"].as_str().unwrap_or_default();
                let named = format!("node {name}, {words} difference from {against} in {unit}");
                add(named, &node[key][figure], least);
            }
        }
    }
    for (key, against) in [("attitude", "truth"), ("attitude_vs_golden", "golden")] {
        for angle in ["total", "yaw", "pitch", "roll"] {
            for figure in ["rms_deg", "p99_deg", "max_deg"] {
                let words = figure.trim_end_matches("_deg");
                let named = format!("attitude, {words} of {angle} against {against} in degrees");
                add(named, &document[key][angle][figure], LEAST_DEG);
            }
        }
    }
    for (part, value) in document["error_budget"].as_object().into_iter().flatten() {
        add(
            format!("error budget, {part} in degrees rms"),
            value,
            LEAST_DEG,
        );
    }
    let count = |key: &str| document[key].as_f64();
    if let (Some(solutions), Some(unflagged)) = (count("solutions"), count("unflagged_solutions"))
        && solutions > 0.0
    {
        let share = Value::from(1.0 - unflagged / solutions);
        add(
            "share of solutions with status bits".to_owned(),
            &share,
            LEAST_SHARE,
        );
    }
    all
}
