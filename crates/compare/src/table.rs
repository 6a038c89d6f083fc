//! The report as text: verdict, nodes, attitude, error budget.
//!
//! Where the terminal is narrow, columns that matter less are left out and sentences are wrapped.

use std::fmt::Write;

use crate::attitude::{AttitudeErrors, Spread};
use crate::format::{count, number, optional, percent};
use crate::input::NOT_JUDGED;
use crate::nodes::NodeReport;
use crate::report::Report;
use crate::verdict::Verdict;

/// How the text is laid out.
#[derive(Clone, Copy, Debug)]
pub struct Style {
    /// Whether terminal colours may be used.
    pub color: bool,
    /// Characters per line; at least 40 are used.
    pub width: usize,
}

impl Style {
    fn paint(self, code: &str, text: &str) -> String {
        if self.color {
            format!("\u{1b}[{code}m{text}\u{1b}[0m")
        } else {
            text.to_owned()
        }
    }

    fn bold(self, text: &str) -> String {
        self.paint("1", text)
    }

    fn good_or_bad(self, good: bool, text: &str) -> String {
        self.paint(if good { "32" } else { "1;31" }, text)
    }
}

/// A column: its title, whether it is aligned right, and how readily it is left out (0: never).
struct Column {
    title: &'static str,
    right: bool,
    dispensable: u8,
}

const fn column(title: &'static str, right: bool, dispensable: u8) -> Column {
    Column {
        title,
        right,
        dispensable,
    }
}

/// The whole report as text, ending in a line break.
#[must_use]
pub fn render(report: &Report, style: Style) -> String {
    let style = Style {
        width: style.width.max(40),
        ..style
    };
    let mut out = String::new();
    nodes(&mut out, report, style);
    attitude(&mut out, report, style);
    budget(&mut out, report, style);
    machine(&mut out, report, style);
    verdict(&mut out, report, style);
    out
}

fn nodes(out: &mut String, report: &Report, style: Style) {
    let columns = [
        column("node", false, 0),
        column("unit", false, 3),
        column("format", true, 4),
        column("samples", true, 6),
        column("max error", true, 0),
        column("in LSB", true, 2),
        column("tolerance", true, 1),
        column("used", true, 0),
        column("SQNR dB", true, 5),
        column("overflows", true, 7),
        column("bits differ", true, 0),
        column("", false, 0),
    ];
    let rows: Vec<Vec<String>> = report.nodes.iter().map(node_row).collect();
    let marks: Vec<bool> = report.nodes.iter().map(|node| node.pass).collect();
    heading(out, "Nodes, native against golden", style);
    grid(out, &columns, &rows, Some(&marks), style);
    if report
        .nodes
        .iter()
        .any(|node| node.golden_vs_native.is_none())
    {
        let _ = writeln!(
            out,
            "* against the same algorithm in f64: golden has no such node"
        );
    }
    if !report.taps {
        let text = "The image has no taps: native and emulated are compared by frames alone.";
        prose(out, "", 2, text, style);
    }
    out.push('\n');
}

fn node_row(node: &NodeReport) -> Vec<String> {
    let judged = node.judged();
    let own = if node.golden_vs_native.is_none() {
        "*"
    } else {
        ""
    };
    let max_abs = judged.and_then(|difference| difference.max_abs);
    let used = max_abs.zip(node.tolerance).map(|(error, tolerance)| {
        if error == 0.0 {
            "0 %".to_owned()
        } else {
            percent(error / tolerance)
        }
    });
    vec![
        format!("{}{own}", node.name),
        node.unit.clone(),
        node.format.as_ref().map_or_else(dash, ToString::to_string),
        count(node.samples),
        optional(max_abs),
        optional(judged.and_then(|difference| difference.max_lsb)),
        optional(node.tolerance),
        used.unwrap_or_else(dash),
        judged
            .and_then(|difference| difference.sqnr_db)
            .map_or_else(dash, |db| format!("{db:.1}")),
        count(node.overflows),
        node.native_vs_emulated
            .as_ref()
            .map_or_else(dash, |bits| count(bits.mismatches)),
        if node.pass { "ok" } else { "FAIL" }.to_owned(),
    ]
}

fn attitude(out: &mut String, report: &Report, style: Style) {
    let mut rows = Vec::new();
    let mut add = |label: &str, errors: &AttitudeErrors| {
        for (angle, spread) in [
            ("roll", &errors.roll),
            ("pitch", &errors.pitch),
            ("yaw", &errors.yaw),
            ("total", &errors.total),
        ] {
            rows.push(spread_row(label, angle, spread));
        }
    };
    if let Some(errors) = &report.attitude {
        add("truth", errors);
    }
    if let Some(errors) = &report.attitude_vs_golden {
        add("golden", errors);
    }
    for (flag, errors) in &report.attitude_flagged {
        rows.push(spread_row(
            &format!("truth, {flag}"),
            "total",
            &errors.total,
        ));
    }
    let columns = [
        column("against", false, 0),
        column("angle", false, 0),
        column("rms", true, 0),
        column("99 %", true, 1),
        column("max", true, 0),
        column("solutions", true, 2),
    ];
    heading(out, "Attitude error in degrees", style);
    grid(out, &columns, &rows, None, style);
    if report.attitude.is_none() {
        let text = "No reference attitude: nothing to compare with truth.";
        prose(out, "", 2, text, style);
    }
    out.push('\n');
}

fn spread_row(against: &str, angle: &str, spread: &Spread) -> Vec<String> {
    vec![
        against.to_owned(),
        angle.to_owned(),
        optional(spread.rms_deg),
        optional(spread.p99_deg),
        optional(spread.max_deg),
        count(spread.samples),
    ]
}

fn budget(out: &mut String, report: &Report, style: Style) {
    let detail = &report.error_budget_detail;
    let columns = [
        column("part", false, 0),
        column("rotation", true, 0),
        column("yaw", true, 1),
        column("pitch", true, 2),
        column("roll", true, 2),
    ];
    let rows: Vec<Vec<String>> = detail
        .parts
        .iter()
        .chain(&detail.whole)
        .map(|part| {
            vec![
                part.part.clone(),
                optional(part.rotation.rms_deg),
                optional(part.yaw.rms_deg),
                optional(part.pitch.rms_deg),
                optional(part.roll.rms_deg),
            ]
        })
        .collect();
    heading(out, "Error budget, degrees rms", style);
    grid(out, &columns, &rows, None, style);
    if let Some(open) = detail.closure_deg {
        let text = format!(
            "The parts are steps of one chain and add up to the whole by construction (within {} degrees \
             in each of {} solutions).",
            number(open),
            count(detail.closure_samples)
        );
        prose(out, "", 2, &text, style);
    }
    out.push('\n');
}

fn machine(out: &mut String, report: &Report, style: Style) {
    let (emulator, link) = (&report.emulator, &report.link);
    heading(out, "Controller and link", style);
    let stack = emulator.stack_peak.map_or_else(
        || "not measured".to_owned(),
        |bytes| format!("{bytes} bytes"),
    );
    let text = format!(
        "{} cycles, load {}, longest interrupt latency {} cycles, stack {stack}",
        count(emulator.cycles),
        percent(emulator.cpu_load),
        emulator.isr_latency_max_cycles,
    );
    prose(out, "", 2, &text, style);
    if let Some(latency) = emulator.output_latency_ms {
        let text = format!(
            "latency {latency:.1} ms from the instant that a solution stands for to the end of its frame"
        );
        prose(out, "", 2, &text, style);
    }
    let text = format!(
        "conversions late {}, lost {}; deadlines missed {}; frames compared {}, differing {}",
        emulator.late_conversions,
        emulator.lost_conversions,
        emulator.missed_deadlines,
        count(report.frames.compared),
        report.frames.mismatches,
    );
    prose(out, "", 2, &text, style);
    let text = format!(
        "link: {} messages, {} bytes, {} lost; {} times real time",
        count(link.messages),
        count(link.bytes),
        link.lost,
        number(emulator.realtime_factor),
    );
    prose(out, "", 2, &text, style);
    out.push('\n');
}

fn verdict(out: &mut String, report: &Report, style: Style) {
    let pass = report.verdict == Verdict::Pass;
    let word = if pass { "PASS" } else { "FAIL" };
    let text = format!(
        "{} on {}, seed {}: {} solutions, {} without status flags",
        report.app,
        report.scenario,
        report.seed,
        count(report.solutions),
        count(report.unflagged_solutions),
    );
    let mut lines = String::new();
    prose(&mut lines, &format!("{word}  "), 6, &text, style);
    out.push_str(&lines.replacen(word, &style.good_or_bad(pass, word), 1));
    for (_, what) in (report.reproduce.provenance.iter()).filter(|(key, _)| key == NOT_JUDGED) {
        prose(out, "  not judged: ", 4, what, style);
    }
    for reason in &report.reasons {
        prose(out, "  - ", 4, &reason.to_string(), style);
    }
}

/// Text broken between words to fit the width; lines after the first are indented by `indent`.
fn prose(out: &mut String, first: &str, indent: usize, text: &str, style: Style) {
    let (mut line, mut empty) = (first.to_owned(), true);
    for word in text.split(' ') {
        let needed = line.chars().count() + usize::from(!empty) + word.chars().count();
        if needed > style.width && !empty {
            let _ = writeln!(out, "{line}");
            (line, empty) = (" ".repeat(indent), true);
        }
        if !empty {
            line.push(' ');
        }
        line.push_str(word);
        empty = false;
    }
    let _ = writeln!(out, "{line}");
}

fn heading(out: &mut String, text: &str, style: Style) {
    let _ = writeln!(out, "{}", style.bold(text));
}

fn dash() -> String {
    "–".to_owned()
}

/// Rows under their titles; `marks` colours the last column.
fn grid(
    out: &mut String,
    columns: &[Column],
    rows: &[Vec<String>],
    marks: Option<&[bool]>,
    style: Style,
) {
    let widths: Vec<usize> = (0..columns.len())
        .map(|at| {
            let cells = rows.iter().map(|row| row[at].chars().count());
            cells
                .max()
                .unwrap_or(0)
                .max(columns[at].title.chars().count())
        })
        .collect();
    let shown = fitting(columns, &widths, style.width);
    let line = |cells: &dyn Fn(usize) -> String| {
        let parts: Vec<String> = shown
            .iter()
            .map(|&at| pad(&cells(at), widths[at], columns[at].right))
            .collect();
        parts.join("  ").trim_end().to_owned()
    };
    let titles = line(&|at| columns[at].title.to_owned());
    let _ = writeln!(out, "{}", style.paint("2", &titles));
    for (index, row) in rows.iter().enumerate() {
        let mut text = line(&|at| row[at].clone());
        if let (Some(marks), Some(last)) = (marks, row.last())
            && let Some(start) = text.strip_suffix(last.as_str())
        {
            text = format!("{start}{}", style.good_or_bad(marks[index], last));
        }
        let _ = writeln!(out, "{text}");
    }
}

/// The columns that fit, after leaving out the most dispensable ones.
fn fitting(columns: &[Column], widths: &[usize], width: usize) -> Vec<usize> {
    let mut shown: Vec<usize> = (0..columns.len()).collect();
    loop {
        let needed: usize = shown.iter().map(|&at| widths[at] + 2).sum();
        let least_needed = shown
            .iter()
            .copied()
            .filter(|&at| columns[at].dispensable > 0)
            .max_by_key(|&at| columns[at].dispensable);
        match least_needed {
            Some(at) if needed > width + 2 => shown.retain(|&other| other != at),
            _ => return shown,
        }
    }
}

fn pad(text: &str, width: usize, right: bool) -> String {
    let fill = " ".repeat(width.saturating_sub(text.chars().count()));
    if right {
        format!("{fill}{text}")
    } else {
        format!("{text}{fill}")
    }
}
