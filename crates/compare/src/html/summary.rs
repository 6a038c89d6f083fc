//! The head of the page: verdict, what it rests on, and the figures a reviewer asks for first.

use maud::{Markup, html};

use crate::format::{count, number, optional, percent};
use crate::nodes::NodeReport;
use crate::report::Report;
use crate::verdict::Verdict;

pub(super) fn section(report: &Report) -> Markup {
    let pass = report.verdict == Verdict::Pass;
    html! {
        header.masthead {
            p.eyebrow { "Cardan · compare" }
            div.verdict .pass[pass] .fail[!pass] {
                span.badge { @if pass { "✓ Pass" } @else { "✗ Fail" } }
                h1 { (report.app) " on " (report.scenario) }
            }
            p.statement { (statement(report)) }
            @if !report.reasons.is_empty() {
                ol.reasons { @for reason in &report.reasons { li { (reason) } } }
            }
            dl.facts {
                div { dt { "Simulated" } dd { (number(report.seconds)) " s" } }
                div { dt { "Conversions" } dd { (count(report.samples)) } }
                div { dt { "Solutions" } dd { (count(report.solutions)) } }
                div { dt { "without flags" } dd { (count(report.unflagged_solutions)) } }
                div { dt { "Seed" } dd { (report.seed) } }
                div { dt { "Session" } dd { (report.session) } }
            }
        }
        div.tiles {
            (error(report))
            (tolerance(report))
            (bits(report))
            (timing(report))
        }
    }
}

fn statement(report: &Report) -> String {
    if report.verdict == Verdict::Fail {
        let count = report.reasons.len();
        let noun = if count == 1 { "reason" } else { "reasons" };
        return format!("The verdict has {count} {noun}:");
    }
    let judged = report
        .nodes
        .iter()
        .filter(|node| node.tolerance.is_some())
        .count();
    if report.taps {
        format!(
            "The compiled firmware on the emulated controller and the native firmware agree in \
             every bit, and {judged} nodes stay within their tolerances."
        )
    } else {
        format!(
            "The image has no taps: its frames agree in every byte with the native firmware's, \
             whose {judged} judged nodes stay within their tolerances."
        )
    }
}

fn tile(title: &str, figure: &str, unit: &str, detail: &str, good: Option<bool>) -> Markup {
    html! {
        div.tile .good[good == Some(true)] .bad[good == Some(false)] {
            h3 { (title) }
            p.figure { (figure) @if !unit.is_empty() { small { (unit) } } }
            p { (detail) }
        }
    }
}

fn error(report: &Report) -> Markup {
    let group = &report.group;
    let title = format!("{} error", group.title);
    let (errors, against) = match (&report.truth, &report.golden) {
        (Some(errors), _) => (errors, "truth"),
        (None, Some(errors)) => (errors, "golden, no reference given"),
        (None, None) => return tile(&title, "–", "", "nothing to compare with", None),
    };
    let Some(whole) = errors.whole() else {
        return html! {
            @for (name, spread) in errors.all() {
                (tile(name, &optional(spread.rms), " rms", &format!("against {against}"), None))
            }
        };
    };
    let symbol = &group.unit.symbol;
    let detail = format!(
        "99 % under {}{symbol}, largest {}{symbol}, against {against}",
        optional(whole.p99),
        optional(whole.max)
    );
    tile(
        &title,
        &optional(whole.rms),
        &format!("{symbol} rms"),
        &detail,
        None,
    )
}

/// The node that uses most of its tolerance.
fn tolerance(report: &Report) -> Markup {
    let used = |node: &NodeReport| Some((node.judged()?.used?, node.name.clone()));
    let most = report
        .nodes
        .iter()
        .filter_map(used)
        .max_by(|left, right| left.0.total_cmp(&right.0));
    match most {
        Some((part, name)) => {
            let detail = format!("of its tolerance is used by {name}, the tightest node");
            let good = part <= 1.0;
            tile("Tolerance", &percent(part), "", &detail, Some(good))
        }
        None => tile("Tolerance", "–", "", "no node has a tolerance", None),
    }
}

fn bits(report: &Report) -> Markup {
    let tapped = || {
        report
            .nodes
            .iter()
            .filter_map(|node| node.native_vs_emulated.as_ref())
    };
    let mismatches: u64 = tapped().map(|bits| bits.mismatches).sum();
    let compared: u64 = tapped().map(|bits| bits.compared).sum();
    let differing = mismatches + report.frames.mismatches;
    let detail = format!(
        "among {} node values and {} frames, native against emulated",
        count(compared),
        count(report.frames.compared)
    );
    let unit = if differing == 1 {
        " difference"
    } else {
        " differences"
    };
    tile(
        "Compiled code",
        &count(differing),
        unit,
        &detail,
        Some(differing == 0),
    )
}

fn timing(report: &Report) -> Markup {
    let emulator = &report.emulator;
    let missed = emulator.missed_deadlines + emulator.late_conversions + emulator.lost_conversions;
    let detail = format!(
        "{} late and {} lost conversions, {} missed deadlines; interrupt latency at most {} cycles",
        emulator.late_conversions,
        emulator.lost_conversions,
        emulator.missed_deadlines,
        emulator.isr_latency_max_cycles
    );
    if missed > 0 {
        return tile(
            "Controller",
            &count(missed),
            " too late",
            &detail,
            Some(false),
        );
    }
    tile(
        "Controller",
        &percent(emulator.cpu_load),
        " load",
        &detail,
        Some(true),
    )
}
