//! The result as a page of its own: front, shares of the error, histograms against the formats.

use cardan_datapath::Format;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::outcome::{Candidate, Outcome};
use crate::ranges::NodeRange;
use crate::ranges_page::ranges_table;

const STYLE: &str = "body{font:14px/1.45 system-ui,sans-serif;margin:2em auto;max-width:70em;color:#1d2733;\
background:#fff}table{border-collapse:collapse}td,th{padding:.2em .8em;text-align:right;border-bottom:1px \
solid #dde3ea}td:first-child,th:first-child{text-align:left}h2{margin-top:2em}.bar{fill:#3f78b5}.out{fill:\
#c4472f}.low{fill:#b9c3cf}.miss{color:#a3311d}.ok{color:#24713c}text{font:11px system-ui;fill:#46525f}\
@media(prefers-color-scheme:dark){body{background:#14181d;color:#dbe2ea}text{fill:#a9b4c0}td,th{border-color:\
#2b333c}}";

/// The page, self-contained.
#[must_use]
pub fn page(outcome: &Outcome, title: &str, command: &str) -> String {
    let pairs = outcome.ranges.iter().zip(&outcome.best.formats.0);
    let content = html! {
        (verdict(outcome))
        (candidates(outcome))
        h2 { "Cost against error" }
        (front(outcome))
        h2 { "Shares of the rounding error" }
        (shares(outcome))
        h2 { "Ranges" }
        p { "In the deployed formats." }
        (ranges_table(&outcome.ranges))
        (histograms(pairs.map(|(range, (_, format))| (range, *format))))
    };
    document(title, command, &content)
}

/// A whole page around its content.
pub(crate) fn document(title: &str, command: &str, content: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                p { code { (command) } }
                (content)
            }
        }
    };
    page.into_string()
}

/// The simulated values of nodes against their formats.
pub(crate) fn histograms<'a>(nodes: impl Iterator<Item = (&'a NodeRange, Format)>) -> Markup {
    html! {
        h2 { "Values against formats" }
        p { "Simulated magnitudes by bit weight. Blue: within the word; grey: under half its last \
             place; red: above its range." }
        @for (range, format) in nodes { (histogram(range, format)) }
    }
}

fn verdict(outcome: &Outcome) -> Markup {
    html! {
        @if let Some(binding) = &outcome.binding {
            p.miss { "Budget not met: " (binding) " is missed even by the closest point." }
        } @else if outcome.verified {
            p.ok { "Budget met, on held-out inputs too." }
        } @else {
            p.miss { "NOT VERIFIED: budget met on the inputs tuned on, missed on others." }
        }
        @if let Some(reason) = &outcome.reason { p.miss { (reason) } }
        @if let Some(found) = &outcome.statistics { p { (crate::output::told(found)) } }
        @for warning in &outcome.warnings { p.miss { (warning) } }
        table {
            tr { th { "case" } th { "limit" } th { "reached" } th { "of the limit" } th { "over tuning" } }
            @for case in &outcome.verification {
                @for reached in &case.reached {
                    tr {
                        td { (case.case) @if case.held_out { " (held out)" } }
                        td { (reached.constraint) }
                        td { (number(reached.value)) }
                        td { (number(reached.ratio)) }
                        td { (number(case.over_tuning)) }
                    }
                }
            }
        }
    }
}

fn number(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |value| format!("{value:.4}"))
}

fn candidates(outcome: &Outcome) -> Markup {
    let row = |candidate: &Candidate| {
        html! {
            tr {
                td { (candidate.name) } td { (candidate.bits) }
                td { (candidate.area.map_or("–".to_owned(), |area| format!("{area:.0}"))) }
                td { (candidate.cycles.map_or("–".to_owned(), |cycles| format!("{cycles:.0}"))) }
                td { (candidate.cycles_estimated.map_or("–".to_owned(), |cycles| format!("{cycles:.0}"))) }
                td { (candidate.error.map_or("–".to_owned(), |error| format!("{error:.3e}"))) }
            }
        }
    };
    html! {
        h2 { "Candidates" }
        table {
            tr {
                th { "" } th { "bits" } th { "area (estimate)" } th { "cycles (measured)" }
                th { "cycles (estimate)" } th { "error" }
            }
            (row(&outcome.baseline))
            @if let Some(uniform) = &outcome.best_uniform { (row(uniform)) }
            (row(&outcome.best))
            @for other in outcome.measured.iter().filter(|other| is_other(outcome, other)) {
                (row(other))
            }
        }
    }
}

/// Measured beside the result and the best uniform width.
fn is_other(outcome: &Outcome, candidate: &Candidate) -> bool {
    let shown = outcome.best_uniform.iter().chain([&outcome.best]);
    shown.into_iter().all(|shown| shown.name != candidate.name)
}

/// Bits over the logarithm of the error.
fn front(outcome: &Outcome) -> Markup {
    let known = outcome.pareto.iter().filter_map(|point| {
        let error = point.error.filter(|error| *error > 0.0)?;
        Some((libm::log10(error), point.bits as f64, point.limit_factor))
    });
    let points: Vec<(f64, f64, f64)> = known.collect();
    let span = |value: fn(&(f64, f64, f64)) -> f64| {
        let all = points.iter().map(value);
        let (lo, hi) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| {
            (lo.min(v), hi.max(v))
        });
        (lo, (hi - lo).max(1e-9))
    };
    let (x, y) = (span(|point| point.0), span(|point| point.1));
    let place = |point: &(f64, f64, f64)| {
        (
            60.0 + 560.0 * (point.0 - x.0) / x.1,
            230.0 - 190.0 * (point.1 - y.0) / y.1,
        )
    };
    html! {
        @if points.is_empty() { p { "No front was asked for." } } @else {
            svg viewBox="0 0 700 270" width="700" role="img" aria-label="Pareto front" {
                @for point in &points {
                    @let (px, py) = place(point);
                    circle.bar cx=(px) cy=(py) r="5" {
                        title { "limits x " (point.2) ": " (point.1) " bits" }
                    }
                    // Beside the point, on the side where there is room.
                    @let (at, anchor) = if px < 500.0 { (px + 8.0, "start") } else { (px - 8.0, "end") };
                    text x=(at) y=(py - 6.0) text-anchor=(anchor) {
                        (point.1) " bits, " (format!("{:.2e}", libm::pow(10.0, point.0)))
                    }
                }
                text x="60" y="262" { "error, logarithmic, growing to the right; bits upward" }
            }
        }
    }
}

fn shares(outcome: &Outcome) -> Markup {
    const SHOWN: usize = 24;
    let mut all: Vec<_> = outcome
        .sensitivities
        .iter()
        .filter(|noise| noise.share > 0.0)
        .collect();
    all.sort_by(|a, b| b.share.total_cmp(&a.share));
    all.truncate(SHOWN);
    let height = 20 * all.len() + 10;
    html! {
        svg viewBox=(format!("0 0 700 {height}")) width="700" role="img" aria-label="Shares of the error" {
            @for (at, noise) in all.iter().enumerate() {
                @let y = 20 * at + 5;
                text x="190" y=(y + 12) text-anchor="end" { (noise.node) " → " (noise.quantity) }
                rect.bar x="200" y=(y) height="15" width=(400.0 * noise.share) {}
                text x=(206.0 + 400.0 * noise.share) y=(y + 12) { (format!("{:.1} %", 100.0 * noise.share)) }
            }
        }
    }
}

fn histogram(range: &NodeRange, format: Format) -> Markup {
    let most = range
        .histogram
        .iter()
        .map(|bin| bin.count)
        .max()
        .unwrap_or(1) as f64;
    let top = format.word.cast_signed() - format.frac.cast_signed() - 1;
    let bottom = -format.frac.cast_signed();
    let first = range
        .histogram
        .iter()
        .map(|bin| bin.exponent)
        .min()
        .unwrap_or(0)
        .max(-40);
    let class = |exponent: i32| {
        if exponent >= top {
            "out"
        } else if exponent < bottom - 1 {
            "low"
        } else {
            "bar"
        }
    };
    html! {
        @if !range.histogram.is_empty() {
            svg viewBox="0 0 700 46" width="700" role="img" aria-label=(format!("Histogram of {}", range.name)) {
                text x="0" y="18" { (range.name) }
                text x="0" y="34" { (top + 1) "." (format.frac) " " (range.unit) }
                @for bin in range.histogram.iter().filter(|bin| bin.exponent >= first) {
                    @let height = 34.0 * (bin.count as f64 / most).sqrt();
                    rect class=(class(bin.exponent)) x=(150 + 11 * (bin.exponent - first))
                        y=(38.0 - height) width="9" height=(height) {
                        title { "2^" (bin.exponent) ": " (bin.count) }
                    }
                }
            }
        }
    }
}
