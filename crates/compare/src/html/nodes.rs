//! The nodes: a table, the reasons of the tolerances, and the error of each over time.

use maud::{Markup, html};

use cardan_page::framed;
use cardan_page::plot::{Envelope, Layer, Plot, ticks};
use cardan_page::unit::reading;

use crate::format::{count, number, optional, percent};
use crate::html::group::flagged;
use crate::input::{Comparison, Node};
use crate::nodes::{NodeReport, NodeStatus};
use crate::plots::Plots;
use crate::report::Report;

pub(super) fn section(report: &Report, facts: &Comparison, plots: &Plots) -> Markup {
    let content = html! {
        div.scroll {
            table.nodes {
                thead { tr {
                    th scope="col" {}
                    th scope="col" { "node" }
                    th scope="col" { "unit" }
                    th.number scope="col" { "format" }
                    th.number scope="col" { "min" }
                    th.number scope="col" { "max" }
                    th.number scope="col" { "max error" }
                    th.number scope="col" { "in LSB" }
                    th.number scope="col" { "SQNR dB" }
                    th.used scope="col" { "tolerance used" }
                    th.number scope="col" { "overflows" }
                    th.number scope="col" { "bits differ" }
                } }
                tbody { @for node in &report.nodes { (row(node)) } }
            }
        }
        p.note {
            "Format: integer bits, sign included, and fractional bits. "
            "* judged against the same algorithm in f64, because golden has no such node. "
            "! leaves the range of its format, within what its limit allows."
        }
        (meanings(report))
        (reasons(report))
        h3 { "Error over time, in LSB of the node's format" }
        div.multiples {
            @for ((node, data), envelope) in report.nodes.iter().zip(&facts.nodes).zip(&plots.nodes) {
                (error(node, data, envelope, (facts, plots)))
            }
        }
    };
    framed(
        "nodes",
        "Nodes",
        "Every intermediate value of the datapath in signal order: native against golden on the \
         same codes over solutions without flags, and native against emulated in every bit.",
        &content,
    )
}

fn row(node: &NodeReport) -> Markup {
    let judged = node.judged();
    let max_abs = judged.and_then(|difference| difference.max_abs);
    let used = judged.and_then(|difference| difference.used);
    let reading = reading(&node.unit);
    let shown = |value: Option<f64>| value.map(|value| reading.scale * value);
    let is_odd = matches!(node.status, NodeStatus::Saturates | NodeStatus::Wraps);
    html! {
        tr .bad[!node.pass] .odd[is_odd] title=(node.meaning) {
            td.mark { @if is_odd { "!" } @else if node.pass { "✓" } @else { "✗" } }
            th scope="row" { (node.name) @if node.golden_vs_native.is_none() { "*" } }
            td { (reading.short) }
            td.number { (node.format.as_ref().map_or_else(|| "–".to_owned(), ToString::to_string)) }
            td.number { (optional(shown(node.min))) }
            td.number { (optional(shown(node.max))) }
            td.number { (optional(shown(max_abs))) }
            td.number { (optional(judged.and_then(|difference| difference.max_lsb))) }
            td.number {
                @match judged.and_then(|difference| difference.sqnr_db) {
                    Some(db) => (format!("{db:.1}")),
                    None => "–",
                }
            }
            td.used { (meter(used, shown(node.tolerance))) }
            td.number { (count(node.overflows)) }
            td.number {
                @match &node.native_vs_emulated {
                    Some(bits) => (count(bits.mismatches)),
                    None => "no taps",
                }
            }
        }
    }
}

fn meter(used: Option<f64>, tolerance: Option<f64>) -> Markup {
    let Some(((used, tolerance), shown)) = used.zip(tolerance).map(|pair| {
        let shown = (100.0 * pair.0).clamp(0.0, 100.0);
        (pair, shown)
    }) else {
        return html! { span.muted { "–" } };
    };
    let beyond = used.is_nan() || used > 1.0;
    html! {
        span.meter .beyond[beyond] { b style=(format!("width:{shown:.1}%")) {} }
        span.meter-text {
            @if tolerance == 0.0 { "must be exact" }
            @else { (percent(used)) " of " (number(tolerance)) }
        }
    }
}

/// What every node is.
fn meanings(report: &Report) -> Markup {
    if report.nodes.iter().all(|node| node.meaning.is_empty()) {
        return html! {};
    }
    html! {
        details {
            summary { "What the nodes are" }
            dl.reasons-of {
                @for node in &report.nodes {
                    dt { (node.name) " " span.muted { (reading(&node.unit).long) } }
                    dd { (node.meaning) }
                }
            }
        }
    }
}

fn reasons(report: &Report) -> Markup {
    let given = || {
        report.nodes.iter().filter_map(|node| {
            let reason = node.tolerance_reason.as_ref()?;
            (!reason.is_empty()).then_some((&node.name, node.tolerance?, &node.unit, reason))
        })
    };
    if given().next().is_none() {
        return html! {};
    }
    html! {
        details {
            summary { "Reasons of the tolerances" }
            dl.reasons-of {
                @for (name, tolerance, unit, reason) in given() {
                    dt { (name) " " span.muted { (number(reading(unit).scale * tolerance)) " " (reading(unit).short) } }
                    dd { (reason) }
                }
            }
        }
    }
}

/// The largest and smallest difference in each stretch of time, with the tolerance where it is near.
fn error(
    report: &NodeReport,
    node: &Node,
    envelope: &Envelope,
    (facts, plots): (&Comparison, &Plots),
) -> Markup {
    let name = match (&node.golden, &node.real) {
        (Some(_), _) => "golden",
        (None, Some(_)) => "real",
        (None, None) => return html! {},
    };
    let solutions = plots.flagged.len();
    if node.lsb <= 0.0 || facts.run.solution_seconds <= 0.0 || solutions == 0 {
        return html! {};
    }
    let seconds = solutions as f64 * facts.run.solution_seconds;
    let step_s = facts.run.solution_seconds / node.per_solution.max(1) as f64;
    let mut found = envelope.stretches(step_s);
    for stretch in found.iter_mut().flatten() {
        stretch.low /= node.lsb;
        stretch.high /= node.lsb;
    }
    let most = envelope.most() / node.lsb;
    let limit = node
        .tolerance
        .as_ref()
        .map(|tolerance| tolerance.max_abs / node.lsb);
    let caption = html! {
        figcaption {
            strong { (node.name) }
            span.muted { " native − " (name) }
        }
    };
    if most == 0.0 {
        let exact = report.judged().is_some_and(|judged| judged.samples > 0);
        return html! {
            figure.small {
                (caption)
                p.exact { @if exact { "exact: never differs" } @else { "nothing to compare" } }
            }
        };
    }
    let near = limit.filter(|limit| *limit <= 4.0 * most && *limit > 0.0);
    let reach = 1.1 * most.max(near.unwrap_or(0.0));
    let shade = flagged(facts, plots);
    let band = Layer::Band {
        class: "band",
        stretches: found,
    };
    let levels = near
        .into_iter()
        .flat_map(|at| [at, -at].map(|at| Layer::Level { class: "limit", at }));
    let plot = Plot {
        label: format!("difference of {} from {name} in LSB over time", node.name),
        seconds,
        low: -reach,
        high: reach,
        ticks: ticks(-reach, reach, 4),
        unit: String::new(),
        height: 90,
        layers: [shade, band].into_iter().chain(levels).collect(),
    };
    html! { figure.small { (caption) (plot.markup()) } }
}
