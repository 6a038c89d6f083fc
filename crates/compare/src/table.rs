//! The report as text: verdict, nodes, errors of the group, error budget.
//!
//! Where the terminal is narrow, columns that matter less are left out, a line says which, and sentences
//! are wrapped.

use cardan_page::text::{Tone, column, grid, heading, prose};
use cardan_page::unit::reading;

use crate::chain::GroupErrors;
use crate::format::{count, number, optional, percent};
use crate::input::{NOT_JUDGED, OnOverflow};
use crate::nodes::{NodeReport, NodeStatus};
use crate::report::Report;
use crate::spread::Spread;
use crate::verdict::Verdict;

pub use cardan_page::text::Style;

/// The whole report as text, ending in a line break.
#[must_use]
pub fn render(report: &Report, style: Style) -> String {
    let style = style.legible();
    let mut out = String::new();
    nodes(&mut out, report, style);
    group(&mut out, report, style);
    budget(&mut out, report, style);
    machine(&mut out, report, style);
    verdict(&mut out, report, style);
    out
}

fn nodes(out: &mut String, report: &Report, style: Style) {
    let columns = [
        column("node", false, 0),
        column("unit", false, 4),
        column("format", true, 5),
        column("samples", true, 6),
        column("max error", true, 0),
        column("in LSB", true, 3),
        column("tolerance", true, 2),
        column("used", true, 0),
        column("SQNR dB", true, 7),
        column("overflows", true, 1),
        column("bits differ", true, 0),
        column("", false, 0),
    ];
    let rows: Vec<Vec<String>> = report.nodes.iter().map(node_row).collect();
    let tones: Vec<Tone> = report.nodes.iter().map(tone).collect();
    heading(out, "Nodes, native against golden", style);
    let last = columns.len() - 1;
    let left_out = grid(out, &columns, &rows, Some((last, &tones)), style);
    if left_out.contains(&"overflows") {
        overflows(out, report, style);
    }
    if report
        .nodes
        .iter()
        .any(|node| matches!(node.status, NodeStatus::Saturates | NodeStatus::Wraps))
    {
        let text =
            "sat, wrap: the node leaves the range of its format, within what its limit allows.";
        prose(out, "", 2, text, style);
    }
    if report
        .nodes
        .iter()
        .any(|node| node.golden_vs_native.is_none())
    {
        let text = "* against the same algorithm in f64: golden has no such node";
        prose(out, "", 2, text, style);
    }
    if !report.taps {
        let text = "The image has no taps: native and emulated are compared by frames alone.";
        prose(out, "", 2, text, style);
    }
    out.push('\n');
}

fn node_row(node: &NodeReport) -> Vec<String> {
    let judged = node.judged();
    let reading = reading(&node.unit);
    let shown = |value: Option<f64>| optional(value.map(|value| reading.scale * value));
    let own = if node.golden_vs_native.is_none() {
        "*"
    } else {
        ""
    };
    let max_abs = judged.and_then(|difference| difference.max_abs);
    let used = judged.and_then(|difference| difference.used);
    let used = used.map(|used| {
        if used == 0.0 {
            "0 %".to_owned()
        } else {
            percent(used)
        }
    });
    vec![
        format!("{}{own}", node.name),
        reading.short.to_owned(),
        node.format.as_ref().map_or_else(dash, ToString::to_string),
        count(node.samples),
        shown(max_abs),
        optional(judged.and_then(|difference| difference.max_lsb)),
        shown(node.tolerance),
        used.unwrap_or_else(dash),
        judged
            .and_then(|difference| difference.sqnr_db)
            .map_or_else(dash, |db| format!("{db:.1}")),
        count(node.overflows),
        node.native_vs_emulated
            .as_ref()
            .map_or_else(dash, |bits| count(bits.mismatches)),
        match node.status {
            NodeStatus::Ok => "ok",
            NodeStatus::Saturates => "sat",
            NodeStatus::Wraps => "wrap",
            NodeStatus::Fail => "FAIL",
        }
        .to_owned(),
    ]
}

/// How a node's mark looks.
fn tone(node: &NodeReport) -> Tone {
    match node.status {
        NodeStatus::Ok => Tone::Good,
        NodeStatus::Saturates | NodeStatus::Wraps => Tone::Odd,
        NodeStatus::Fail => Tone::Bad,
    }
}

/// Overflows in a sentence, where their column has no room.
fn overflows(out: &mut String, report: &Report, style: Style) {
    let found = report.nodes.iter().filter(|node| node.overflows > 0);
    let found: Vec<String> = found
        .map(|node| {
            let does = match node.on_overflow {
                OnOverflow::Saturates => "saturates",
                OnOverflow::Wraps => "wraps",
                OnOverflow::Turns => "wraps as angles do",
            };
            format!("{} {} ({does})", node.name, count(node.overflows))
        })
        .collect();
    let text = if found.is_empty() {
        "none".to_owned()
    } else {
        found.join(", ")
    };
    prose(out, "overflows: ", 2, &text, style);
}

fn group(out: &mut String, report: &Report, style: Style) {
    let group = &report.group;
    if group.members.is_empty() {
        outputs(out, report, style);
        return;
    }
    let mut rows = Vec::new();
    let mut add = |label: &str, errors: &GroupErrors| {
        rows.extend(
            errors
                .all()
                .map(|(name, spread)| spread_row(label, name, spread)),
        );
    };
    if let Some(errors) = &report.truth {
        add("truth", errors);
    }
    if let Some(errors) = &report.golden {
        add("golden", errors);
    }
    for (flag, errors) in &report.flagged {
        if let (Some(whole), Some(name)) = (errors.whole(), group.whole()) {
            rows.push(spread_row(&format!("truth, {flag}"), name, whole));
        }
    }
    let columns = [
        column("against", false, 0),
        column(&group.member, false, 0),
        column("rms", true, 0),
        column("99 %", true, 1),
        column("max", true, 0),
        column("solutions", true, 2),
    ];
    let title = format!("{} error in {}", group.title, group.unit.words);
    heading(out, &title, style);
    grid(out, &columns, &rows, None, style);
    if report.truth.is_none() {
        let text = format!("No reference {}: nothing to compare with truth.", group.key);
        prose(out, "", 2, &text, style);
    }
    if let Some(truth) = &report.limits.truth {
        let limits = [("rms", truth.rms), ("99 %", truth.p99), ("max", truth.max)];
        let limits = limits
            .iter()
            .filter_map(|&(name, limit)| Some((name, limit?)));
        let of = format!("limits of truth, {}", group.whole().unwrap_or_default());
        stated(out, &of, limits, report, style);
    }
    out.push('\n');
}

/// Outputs of a product of which none is followed along the chain.
fn outputs(out: &mut String, report: &Report, style: Style) {
    if report.outputs.is_empty() {
        return;
    }
    let mut rows = Vec::new();
    for output in &report.outputs {
        let against = [
            ("golden", Some(output.against.golden)),
            ("truth", output.against.truth),
        ];
        for (label, found) in against {
            let Some(found) = found.filter(|found| found.samples > 0) else {
                continue;
            };
            let mut row = vec![output.name.clone(), output.unit.clone(), label.to_owned()];
            row.extend([found.rms, found.p99, found.max, found.bias].map(optional));
            row.push(count(found.samples));
            rows.push(row);
        }
    }
    let columns = [
        column("output", false, 0),
        column("unit", false, 0),
        column("against", false, 0),
        column("rms", true, 0),
        column("99 %", true, 1),
        column("max", true, 0),
        column("mean", true, 2),
        column("values", true, 3),
    ];
    heading(out, "Outputs", style);
    grid(out, &columns, &rows, None, style);
    out.push('\n');
}

/// The limits by which figures were judged.
fn stated<'a>(
    out: &mut String,
    of: &str,
    limits: impl Iterator<Item = (&'a str, f64)>,
    report: &Report,
    style: Style,
) {
    let limits: Vec<String> = limits
        .map(|(name, limit)| format!("{name} {}", number(limit)))
        .collect();
    if limits.is_empty() {
        return;
    }
    let widening = report.limits.widening;
    let wider = if widening > 1.0 {
        format!(
            " (the scenario's own are wider by {} here, since the run is shorter than it)",
            number(widening)
        )
    } else {
        String::new()
    };
    prose(
        out,
        "",
        2,
        &format!("{of}: {}{wider}", limits.join(", ")),
        style,
    );
}

fn spread_row(against: &str, angle: &str, spread: &Spread) -> Vec<String> {
    vec![
        against.to_owned(),
        angle.to_owned(),
        optional(spread.rms),
        optional(spread.p99),
        optional(spread.max),
        count(spread.samples),
    ]
}

fn budget(out: &mut String, report: &Report, style: Style) {
    let (detail, group) = (&report.error_budget_detail, &report.group);
    if detail.parts.is_empty() && group.members.is_empty() {
        return;
    }
    let what = group
        .combined
        .as_ref()
        .map(|combined| combined.what.as_str());
    let mut columns = vec![column("part", false, 0)];
    columns.extend(what.map(|what| column(what, true, 0)));
    for (at, member) in group.members.iter().enumerate() {
        let rank = if at == 0 { 1 } else { 2 };
        columns.push(column(&member.name, true, rank));
    }
    columns.push(column("share", true, 3));
    let rows: Vec<Vec<String>> = detail
        .parts
        .iter()
        .chain(&detail.whole)
        .map(|part| {
            let combined = part.combined.iter().chain(&part.members);
            std::iter::once(part.part.clone())
                .chain(combined.map(|(_, spread)| optional(spread.rms)))
                .chain([part.share.map_or_else(dash, percent)])
                .collect()
        })
        .collect();
    heading(
        out,
        &format!("Error budget, {} rms", group.unit.words),
        style,
    );
    grid(out, &columns, &rows, None, style);
    if let Some(open) = detail.closure {
        let text = format!(
            "The parts are steps of one chain and add up to the whole by construction (within {} {} \
             in each of {} solutions); share is each part's of the whole's mean square, negative where it \
             takes error off.",
            number(open),
            group.unit.words,
            count(detail.closure_samples)
        );
        prose(out, "", 2, &text, style);
    }
    let limits = report.limits.stages.iter();
    let limits = limits.map(|(name, limit)| (name.as_str(), *limit));
    let of = format!("limits of {}", what.unwrap_or("parts"));
    stated(out, &of, limits, report, style);
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
    if let Some(most) = report.limits.most_flagged {
        let flagged = report.solutions - report.unflagged_solutions;
        let share = flagged as f64 / (report.solutions as f64).max(1.0);
        let text = format!(
            "flagged solutions {}, {}; at most {}",
            count(flagged),
            percent(share),
            percent(most)
        );
        prose(out, "", 2, &text, style);
    }
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
    out.push_str(&lines.replacen(word, &style.toned(Tone::of(pass), word), 1));
    for (_, what) in (report.reproduce.provenance.iter()).filter(|(key, _)| key == NOT_JUDGED) {
        prose(out, "  not judged: ", 4, what, style);
    }
    if let (Some(what), true) = (&report.stale, pass) {
        prose(out, "  note: ", 4, what, style);
    }
    for reason in &report.reasons {
        prose(out, "  - ", 4, &reason.to_string(), style);
    }
}

fn dash() -> String {
    "–".to_owned()
}
