//! What a run over corners and units found.

use std::fmt;
use std::path::Path;
use std::process::ExitCode;

use serde::Serialize;
use serde_json::{Map, Value};

use super::Job;
use crate::failure::code;
use crate::run_options::Setup;

/// One variant's comparison.
#[derive(Debug, Serialize)]
pub(super) struct Run {
    name: String,
    /// Parameters that differ from the scenario's.
    set: Map<String, Value>,
    seed: u64,
    verdict: &'static str,
    /// Rotation error against truth over unflagged solutions, in degrees; `null` without any.
    rms_deg: Option<f64>,
    max_deg: Option<f64>,
    /// Solutions without status flags.
    unflagged: u64,
    /// The node nearest to its tolerance or farthest beyond it, and its error over the tolerance.
    worst_node: Option<String>,
    worst_node_share: Option<f64>,
    /// Why there was nothing to judge.
    refused: Option<String>,
    /// The command that runs it again.
    reproduce: String,
    #[serde(skip)]
    is_unit: bool,
}

impl Run {
    /// From the document of its comparison.
    pub(super) fn new(job: &Job, reproduce: String, document: &Value) -> Self {
        let total = &document["attitude"]["total"];
        let share = |node: &Value| {
            let error = node["golden_vs_native"]["max_abs"].as_f64()?;
            let tolerance = node["tolerance"].as_f64()?;
            Some((error / tolerance, node["name"].as_str()?.to_owned()))
        };
        let nodes = document["nodes"].as_array();
        let worst = nodes
            .into_iter()
            .flatten()
            .filter_map(share)
            .max_by(|a, b| a.0.total_cmp(&b.0));
        let passed = document["verdict"] == "pass";
        Self {
            verdict: if passed { "pass" } else { "fail" },
            rms_deg: total["rms_deg"].as_f64(),
            max_deg: total["max_deg"].as_f64(),
            unflagged: total["samples"].as_u64().unwrap_or_default(),
            worst_node_share: worst.as_ref().map(|worst| worst.0),
            worst_node: worst.map(|worst| worst.1),
            ..Self::refused(job, reproduce, String::new())
        }
        .judged()
    }

    /// A unit in which the design cannot work.
    pub(super) fn refused(job: &Job, reproduce: String, why: String) -> Self {
        let set = job.variant.set.iter();
        Self {
            name: job.variant.name.clone(),
            set: set
                .map(|(key, value)| (key.clone(), (*value).into()))
                .collect(),
            seed: job.run.seed,
            verdict: "fail",
            rms_deg: None,
            max_deg: None,
            unflagged: 0,
            worst_node: None,
            worst_node_share: None,
            refused: Some(why),
            reproduce,
            is_unit: job.is_unit,
        }
    }

    fn judged(self) -> Self {
        Self {
            refused: None,
            ..self
        }
    }

    /// Worse is greater: refused, failed, then by the error against truth, then by the margin.
    fn badness(&self) -> (bool, bool, f64, f64) {
        (
            self.refused.is_some(),
            self.verdict == "fail",
            self.rms_deg.unwrap_or_default(),
            self.worst_node_share.unwrap_or_default(),
        )
    }
}

/// Share of the random units that pass.
#[derive(Debug, Serialize)]
struct Yield {
    units: usize,
    passed: usize,
    share: f64,
    /// Wilson's interval at 95 %: what the share may be, from so many units.
    interval: [f64; 2],
}

impl Yield {
    fn of(units: usize, passed: usize) -> Option<Self> {
        if units == 0 {
            return None;
        }
        const Z: f64 = 1.959_963_984_540_054;
        let (n, share) = (units as f64, passed as f64 / units as f64);
        let centre = share + Z * Z / (2.0 * n);
        let half = Z * (share * (1.0 - share) / n + Z * Z / (4.0 * n * n)).sqrt();
        let whole = 1.0 + Z * Z / n;
        Some(Self {
            units,
            passed,
            share,
            interval: [
                ((centre - half) / whole).max(0.0),
                ((centre + half) / whole).min(1.0),
            ],
        })
    }
}

/// The whole run.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    verdict: &'static str,
    app: String,
    scenario: String,
    corners: String,
    seed: u64,
    seconds: f64,
    runs: Vec<Run>,
    #[serde(rename = "yield")]
    of_units: Option<Yield>,
    /// Index in `runs`.
    worst: usize,
}

impl Report {
    pub(super) fn new(setup: &Setup, file: &Path, seed: u64, runs: Vec<Run>) -> Self {
        let units = runs.iter().filter(|run| run.is_unit);
        let passed = units.clone().filter(|run| run.verdict == "pass").count();
        let all_pass = runs.iter().all(|run| run.verdict == "pass");
        let order = |a: &Run, b: &Run| {
            let (a, b) = (a.badness(), b.badness());
            (a.0, a.1)
                .cmp(&(b.0, b.1))
                .then(a.2.total_cmp(&b.2))
                .then(a.3.total_cmp(&b.3))
        };
        let worst = (0..runs.len()).max_by(|&a, &b| order(&runs[a], &runs[b]).then(b.cmp(&a)));
        Self {
            verdict: if all_pass { "pass" } else { "fail" },
            app: setup.app.name().to_owned(),
            scenario: setup.scenario.name.clone(),
            corners: file.display().to_string(),
            seed,
            seconds: setup.seconds,
            of_units: Yield::of(units.count(), passed),
            worst: worst.unwrap_or_default(),
            runs,
        }
    }

    pub(super) fn exit_code(&self) -> ExitCode {
        ExitCode::from(if self.verdict == "pass" {
            code::PASS
        } else {
            code::FAIL
        })
    }
}

/// Rows of the table at most: all named corners, and the worst units.
const MOST_UNIT_ROWS: usize = 10;

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.runs.iter().map(|run| run.name.len()).max();
        let width = width.unwrap_or_default().max("variant".len());
        writeln!(
            f,
            "{:width$}  verdict  rms_deg  max_deg  unflagged  worst node (error / tolerance)",
            "variant"
        )?;
        let mut units: Vec<&Run> = self.runs.iter().filter(|run| run.is_unit).collect();
        units.sort_by(|a, b| {
            b.badness()
                .partial_cmp(&a.badness())
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        let named = self.runs.iter().filter(|run| !run.is_unit);
        for run in named.chain(units.iter().copied().take(MOST_UNIT_ROWS)) {
            let number = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.3}"));
            let (rms, max) = (number(run.rms_deg), number(run.max_deg));
            let (name, verdict, unflagged) = (&run.name, run.verdict, run.unflagged);
            write!(
                f,
                "{name:width$}  {verdict:7}  {rms:>7}  {max:>7}  {unflagged:>9}  "
            )?;
            match (&run.refused, &run.worst_node, run.worst_node_share) {
                (Some(why), _, _) => writeln!(f, "{why}")?,
                (None, Some(node), Some(share)) => writeln!(f, "{node} ({:.0} %)", share * 100.0)?,
                _ => writeln!(f, "-")?,
            }
        }
        if units.len() > MOST_UNIT_ROWS {
            let more = units.len() - MOST_UNIT_ROWS;
            writeln!(f, "and {more} units that are better (all in --json)")?;
        }
        if let Some(y) = &self.of_units {
            writeln!(
                f,
                "yield {} of {} units: {:.1} % (95 %: {:.1} to {:.1} %)",
                y.passed,
                y.units,
                y.share * 100.0,
                y.interval[0] * 100.0,
                y.interval[1] * 100.0
            )?;
        }
        if let Some(worst) = self.runs.get(self.worst) {
            writeln!(
                f,
                "worst: {}; run it again with\n  {}",
                worst.name, worst.reproduce
            )?;
        }
        let failed = self.runs.iter().filter(|run| run.verdict == "fail").count();
        match failed {
            0 => write!(f, "PASS  {} comparisons", self.runs.len()),
            _ => write!(f, "FAIL  {failed} of {} comparisons", self.runs.len()),
        }
    }
}
