//! The group's values over time, their error, and the solutions that are reported apart.

use cardan_outputs::Member;
use cardan_page::framed;
use cardan_page::plot::{Envelope, Layer, Plot, ticks};
use maud::{Markup, html};

use crate::chain::GroupErrors;
use crate::format::{count, optional};
use crate::input::Comparison;
use crate::messages::Statistics;
use crate::plots::{MemberPlot, Plots};
use crate::report::Report;
use crate::spread::Spread;

/// Scales of a plot of values that have a period, as parts of half of it.
const PARTS_OF_TURN: [f64; 4] = [1.0 / 6.0, 1.0 / 3.0, 0.5, 1.0];

pub(super) fn section(report: &Report, facts: &Comparison, plots: &Plots) -> Markup {
    let group = &report.group;
    let at = usize::from(report.truth.is_none());
    let name = ["truth", "golden on the same inputs"][at];
    let is_drawn = facts.run.solution_seconds > 0.0
        && plots
            .members
            .iter()
            .any(|member| member.device.most() > 0.0);
    let content = html! {
        @if is_drawn {
            div.legend {
                span { i.reference {} (name) }
                span { i.device {} "device" }
                span { i.shade {} "solutions with a status flag" }
            }
            @for (member, plot) in group.members.iter().zip(&plots.members) {
                (curve(report, member, plot, at, facts, plots))
            }
            (error(report, name, &plots.error[at], facts, plots))
        } @else {
            p.muted { "This run has no " (group.title.to_lowercase()) " over time." }
        }
        div.columns {
            div { h3 { "Error over solutions without flags" } (table(report)) }
            div { h3 { "Status flags" } (flags(report)) }
        }
    };
    framed("group", &group.title, &group.note, &content)
}

fn seconds(facts: &Comparison, plots: &Plots) -> f64 {
    plots.flagged.len().max(1) as f64 * facts.run.solution_seconds
}

/// The stripes of solutions with a status bit.
pub(super) fn flagged(facts: &Comparison, plots: &Plots) -> Layer {
    Layer::Shade {
        class: "shade",
        spans: plots.flagged.spans(facts.run.solution_seconds),
    }
}

fn curve(
    report: &Report,
    member: &Member,
    plot: &MemberPlot,
    at: usize,
    facts: &Comparison,
    plots: &Plots,
) -> Markup {
    let step_s = facts.run.solution_seconds;
    let (device, reference) = (&plot.device, &plot.references[at]);
    let most = device.most().max(reference.most());
    let half = member.period.map(|period| member.scale * period / 2.0);
    let reach = match half {
        Some(half) => {
            let steps = PARTS_OF_TURN.map(|part| part * half);
            steps.into_iter().find(|step| most <= *step).unwrap_or(half)
        }
        None => ticks(0.0, 1.25 * most, 4)
            .into_iter()
            .find(|step| *step >= most)
            .unwrap_or(most),
    };
    let jump = half.unwrap_or(f64::INFINITY);
    let line = |class: &'static str, envelope: &Envelope| Layer::Line {
        class,
        points: envelope.points(step_s),
        jump,
    };
    // Where points are left out, what they reach shows as a band.
    let band = (!device.is_whole()).then(|| Layer::Band {
        class: "band",
        stretches: device.stretches(step_s),
    });
    let lines = [line("reference", reference), line("device", device)];
    let unit = &report.group.unit;
    let plot = Plot {
        label: format!(
            "{} in {} over time, device and reference",
            member.name, unit.words
        ),
        seconds: seconds(facts, plots),
        low: -1.08 * reach,
        high: 1.08 * reach,
        ticks: vec![-reach, 0.0, reach],
        unit: unit.symbol.to_string(),
        height: 110,
        layers: [flagged(facts, plots)]
            .into_iter()
            .chain(band)
            .chain(lines)
            .collect(),
    };
    html! { figure { figcaption { (member.name) } (plot.markup()) } }
}

/// The error of the whole group; the largest in each stretch of time is drawn.
fn error(
    report: &Report,
    name: &str,
    error: &Envelope,
    facts: &Comparison,
    plots: &Plots,
) -> Markup {
    let most = error.most();
    let (Some(whole), true) = (report.group.whole(), most > 0.0) else {
        return html! {};
    };
    let high = 1.1 * most;
    let unit = &report.group.unit;
    let plot = Plot {
        label: format!("{whole} error against {name} in {} over time", unit.words),
        seconds: seconds(facts, plots),
        low: 0.0,
        high,
        ticks: ticks(0.0, high, 3),
        unit: unit.symbol.to_string(),
        height: 140,
        layers: vec![
            flagged(facts, plots),
            Layer::Band {
                class: "band",
                stretches: error.stretches(facts.run.solution_seconds),
            },
        ],
    };
    html! {
        figure {
            figcaption { (whole) " error against " (name) }
            (plot.markup())
        }
    }
}

fn table(report: &Report) -> Markup {
    if report.group.members.is_empty() {
        return outputs(report);
    }
    html! {
        table {
            thead { tr {
                th scope="col" { (report.group.unit.words) }
                th.number scope="col" { "rms" }
                th.number scope="col" { "99 %" }
                th.number scope="col" { "max" }
                th.number scope="col" { "solutions" }
            } }
            @if let Some(errors) = &report.truth { (rows("against truth", errors)) }
            @if let Some(errors) = &report.golden { (rows("against golden on the same inputs", errors)) }
        }
        @if report.truth.is_none() {
            p.muted { "No reference in this run: no error against truth." }
        }
    }
}

fn rows(title: &str, errors: &GroupErrors) -> Markup {
    html! {
        tbody {
            tr.group { th scope="rowgroup" colspan="5" { (title) } }
            @for (name, spread) in errors.all() { (row(name, spread)) }
        }
    }
}

fn row(name: &str, spread: &Spread) -> Markup {
    html! {
        tr {
            th scope="row" { (name) }
            td.number { (optional(spread.rms)) }
            td.number { (optional(spread.p99)) }
            td.number { (optional(spread.max)) }
            td.number { (count(spread.samples)) }
        }
    }
}

/// Outputs of a product of which none is followed along the chain.
fn outputs(report: &Report) -> Markup {
    let row = |name: &str, unit: &str, found: &Statistics| {
        html! {
            tr {
                th scope="row" { (name) " " span.muted { (unit) } }
                td.number { (optional(found.rms)) }
                td.number { (optional(found.p99)) }
                td.number { (optional(found.max)) }
                td.number { (count(found.samples)) }
            }
        }
    };
    html! {
        table {
            thead { tr {
                th scope="col" { "against golden" }
                th.number scope="col" { "rms" }
                th.number scope="col" { "99 %" }
                th.number scope="col" { "max" }
                th.number scope="col" { "solutions" }
            } }
            tbody {
                @for output in &report.outputs { (row(&output.name, &output.unit, &output.against.golden)) }
            }
        }
    }
}

fn flags(report: &Report) -> Markup {
    let whole = |name: &str| {
        let entry = report.flagged.iter().find(|(flag, _)| flag == name);
        let whole = entry.and_then(|(_, errors)| errors.whole().copied());
        whole.unwrap_or_default()
    };
    html! {
        table {
            thead { tr {
                th scope="col" { "flag" }
                th.number scope="col" { "solutions" }
                th.number scope="col" { "golden" }
                th.number scope="col" { "differ" }
                th.number scope="col" { "error rms" }
                th.number scope="col" { "max" }
            } }
            tbody {
                @for flag in &report.flags {
                    tr .quiet[flag.native == 0 && flag.golden.unwrap_or(0) == 0] {
                        th scope="row" { (flag.name) }
                        td.number { (count(flag.native)) }
                        td.number { (flag.golden.map_or_else(|| "–".to_owned(), count)) }
                        td.number { (flag.differ.map_or_else(|| "–".to_owned(), count)) }
                        td.number { (optional(whole(&flag.name).rms)) }
                        td.number { (optional(whole(&flag.name).max)) }
                    }
                }
            }
        }
    }
}
