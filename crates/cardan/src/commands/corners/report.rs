//! What a run over corners and units found.

use std::path::Path;
use std::process::ExitCode;

use cardan_page::format::percent;
use cardan_page::text::{Style, Tone, column, grid, prose};
use serde::Serialize;
use serde_json::{Map, Value};

use super::Job;
use crate::failure::code;
use crate::run_options::Setup;

/// One variant's comparison.
#[derive(Debug, Serialize)]
pub(super) struct Run {
    pub(super) name: String,
    /// Parameters that differ from the scenario's.
    set: Map<String, Value>,
    seed: u64,
    verdict: &'static str,
    /// What the errors are against: `truth`, or `golden` where the run has no reference attitude.
    against: &'static str,
    /// Rotation error over unflagged solutions, in degrees; `null` without any.
    pub(super) rms_deg: Option<f64>,
    pub(super) max_deg: Option<f64>,
    /// Solutions.
    pub(super) solutions: u64,
    /// Solutions without status flags.
    unflagged: u64,
    /// Share of solutions with status flags.
    pub(super) flagged_share: Option<f64>,
    /// The error against truth is beyond its limit, or there is no solution to judge it by.
    truth_missed: bool,
    /// Status bits are wrong, or set in too many solutions.
    too_flagged: bool,
    /// Why it fails: the reason named first.
    pub(super) reason: Option<String>,
    /// The node nearest to its tolerance or farthest beyond it, and its error over the tolerance.
    worst_node: Option<String>,
    pub(super) worst_node_share: Option<f64>,
    /// Why there was nothing to judge.
    pub(super) refused: Option<String>,
    /// The command that runs it again.
    pub(super) reproduce: String,
    #[serde(skip)]
    is_unit: bool,
}

impl Run {
    /// From the document of its comparison.
    pub(super) fn new(job: &Job, reproduce: String, document: &Value) -> Self {
        let count = |key: &str| document[key].as_u64().unwrap_or_default();
        // Without a reference attitude, golden on the same codes is the measure.
        let (against, errors) = match &document["attitude"] {
            Value::Null => ("golden", &document["attitude_vs_golden"]),
            errors => ("truth", errors),
        };
        let total = &errors["total"];
        let share = |node: &Value| {
            let used = |key: &str| node[key]["used"].as_f64();
            let used = used("golden_vs_native")
                .into_iter()
                .chain(used("real_vs_native"));
            let used = used.max_by(f64::total_cmp)?;
            Some((used, node["name"].as_str()?.to_owned()))
        };
        let nodes = document["nodes"].as_array();
        let worst = nodes
            .into_iter()
            .flatten()
            .filter_map(share)
            .max_by(|a, b| a.0.total_cmp(&b.0));
        let passed = document["verdict"] == "pass";
        let reasons = document["reasons"].as_array().into_iter().flatten();
        let reasons: Vec<String> = reasons
            .filter_map(|text| text.as_str().map(str::to_owned))
            .collect();
        let begins = |start: &str| reasons.iter().any(|reason| reason.starts_with(start));
        let (solutions, unflagged) = (count("solutions"), count("unflagged_solutions"));
        Self {
            verdict: if passed { "pass" } else { "fail" },
            against,
            rms_deg: total["rms_deg"].as_f64(),
            max_deg: total["max_deg"].as_f64(),
            solutions,
            unflagged,
            flagged_share: (solutions > 0).then(|| 1.0 - unflagged as f64 / solutions as f64),
            truth_missed: begins("attitude: "),
            too_flagged: begins("status: "),
            reason: reasons.first().cloned(),
            worst_node_share: worst.as_ref().map(|worst| worst.0),
            worst_node: worst.map(|worst| worst.1),
            refused: None,
            ..Self::refused(job, reproduce, String::new())
        }
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
            against: "truth",
            rms_deg: None,
            max_deg: None,
            solutions: 0,
            unflagged: 0,
            flagged_share: None,
            truth_missed: false,
            too_flagged: false,
            reason: None,
            worst_node: None,
            worst_node_share: None,
            refused: Some(why),
            reproduce,
            is_unit: job.is_unit,
        }
    }

    /// Worse is greater: refused, failed, then by the error against truth, then by the margin.
    fn badness(&self) -> (bool, bool, f64, f64) {
        (
            self.refused.is_some(),
            self.verdict == "fail",
            // Of a run that fails without any solution to judge, nothing is known to be good.
            self.rms_deg
                .unwrap_or(if self.passes() { 0.0 } else { f64::INFINITY }),
            self.worst_node_share.unwrap_or_default(),
        )
    }
}

/// Share of the random units that pass.
#[derive(Debug, Serialize)]
struct Yield {
    units: usize,
    passed: usize,
    /// Units that miss a limit of the error against truth.
    truth_missed: usize,
    /// Units whose status bits are wrong, or set too often.
    too_flagged: usize,
    /// Units in which the design cannot work at all.
    refused: usize,
    share: f64,
    /// Wilson's interval at 95 %: what the share may be, from so many units.
    interval: [f64; 2],
}

impl Yield {
    fn of(all: &[&Run]) -> Option<Self> {
        let count = |is: fn(&Run) -> bool| all.iter().filter(|run| is(run)).count();
        let (units, passed) = (all.len(), count(|run| run.verdict == "pass"));
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
            truth_missed: count(|run| run.truth_missed),
            too_flagged: count(|run| run.too_flagged),
            refused: count(|run| run.refused.is_some()),
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
        let units: Vec<&Run> = runs.iter().filter(|run| run.is_unit).collect();
        let of_units = Yield::of(&units);
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
            of_units,
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

impl Report {
    /// Named corners, and the units from the worst on.
    pub(super) fn shown(&self, most_units: usize) -> Vec<&Run> {
        let mut units: Vec<&Run> = self.runs.iter().filter(|run| run.is_unit).collect();
        units.sort_by(|a, b| {
            b.badness()
                .partial_cmp(&a.badness())
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        units.truncate(most_units);
        let named = self.runs.iter().filter(|run| !run.is_unit);
        named.chain(units).collect()
    }

    /// What the errors are against, in words.
    pub(super) fn measure(&self) -> &'static str {
        if self.runs.iter().all(|run| run.against == "golden") {
            "golden on the same codes: the run has no reference attitude"
        } else {
            "truth"
        }
    }

    /// The yield in a sentence.
    pub(super) fn yield_told(&self) -> Option<String> {
        let y = self.of_units.as_ref()?;
        Some(format!(
            "yield {} of {} units: {:.1} % (95 %: {:.1} to {:.1} %); {} miss a limit of truth, {} of status, \
             {} cannot work",
            y.passed,
            y.units,
            y.share * 100.0,
            y.interval[0] * 100.0,
            y.interval[1] * 100.0,
            y.truth_missed,
            y.too_flagged,
            y.refused,
        ))
    }

    /// What the page is called.
    pub(super) fn title(&self) -> String {
        format!("{} on {} and its corners", self.app, self.scenario)
    }

    /// Every comparison passes.
    pub(super) fn passes(&self) -> bool {
        self.verdict == "pass"
    }

    /// The worst comparison.
    pub(super) fn worst(&self) -> Option<&Run> {
        self.runs.get(self.worst)
    }

    /// The result in a sentence.
    pub(super) fn told(&self) -> String {
        let failed = self.runs.iter().filter(|run| run.verdict == "fail").count();
        match failed {
            0 => format!("{} comparisons", self.runs.len()),
            _ => format!("{failed} of {} comparisons", self.runs.len()),
        }
    }

    /// The result as text.
    pub(super) fn table(&self, style: Style) -> String {
        let style = style.legible();
        let columns = [
            column("variant", false, 0),
            column("verdict", false, 0),
            column("rms deg", true, 0),
            column("max deg", true, 1),
            column("flagged", true, 0),
            column("solutions", true, 3),
            column("nearest to its limit", false, 2),
        ];
        let shown = self.shown(MOST_UNIT_ROWS);
        let rows: Vec<Vec<String>> = shown.iter().map(|run| run.row()).collect();
        let tones: Vec<Tone> = shown
            .iter()
            .map(|run| Tone::of(run.verdict == "pass"))
            .collect();
        let mut out = String::new();
        grid(&mut out, &columns, &rows, Some((1, &tones)), style);
        prose(&mut out, "errors are against ", 2, self.measure(), style);
        for run in shown.iter().filter(|run| run.verdict == "fail") {
            let why = run.refused.as_ref().or(run.reason.as_ref());
            let why = why.map_or("the emulated program crashed", String::as_str);
            prose(&mut out, &format!("  {}: ", run.name), 4, why, style);
        }
        let units = self.runs.iter().filter(|run| run.is_unit).count();
        if units > MOST_UNIT_ROWS {
            let more = units - MOST_UNIT_ROWS;
            prose(
                &mut out,
                "",
                2,
                &format!("and {more} units that are better (all in --json)"),
                style,
            );
        }
        if let Some(told) = self.yield_told() {
            prose(&mut out, "", 2, &told, style);
        }
        if let Some(worst) = self.runs.get(self.worst) {
            out.push_str(&format!(
                "worst: {}; run it again with\n  {}\n",
                worst.name, worst.reproduce
            ));
        }
        let pass = self.verdict == "pass";
        let word = style.toned(Tone::of(pass), if pass { "PASS" } else { "FAIL" });
        out.push_str(&format!("{word}  {}\n", self.told()));
        out
    }
}

impl Run {
    /// Its verdict is pass.
    pub(super) fn passes(&self) -> bool {
        self.verdict == "pass"
    }

    /// What differs from the scenario.
    pub(super) fn settings(&self) -> impl Iterator<Item = (&str, f64)> {
        let known = self.set.iter();
        known.filter_map(|(key, value)| Some((key.as_str(), value.as_f64()?)))
    }

    /// The node nearest to its limit, and how much of it that takes.
    pub(super) fn nearest(&self) -> String {
        let node = self.worst_node.as_ref().zip(self.worst_node_share);
        node.map_or("–".to_owned(), |(node, share)| {
            format!("{node} ({})", percent(share))
        })
    }

    fn row(&self) -> Vec<String> {
        let number =
            |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.3}"));
        vec![
            self.name.clone(),
            self.verdict.to_owned(),
            number(self.rms_deg),
            number(self.max_deg),
            self.flagged_share.map_or("–".to_owned(), percent),
            self.solutions.to_string(),
            self.nearest(),
        ]
    }
}
