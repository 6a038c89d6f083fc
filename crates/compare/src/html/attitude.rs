//! Attitude over time, its error, and the solutions that are reported apart.

use cardan_golden::Angles;
use maud::{Markup, html};

use crate::attitude::{AttitudeErrors, Spread, rotation_error};
use crate::format::{count, optional};
use crate::input::{Comparison, Series};
use crate::report::Report;
use cardan_page::framed;
use cardan_page::plot::{Layer, Plot, spans, stretches, ticks};

/// Points of a curve at most; more cannot be told apart on a screen.
const POINTS: usize = 1200;
/// Stretches of an envelope or of the flagged stripes.
const STRETCHES: usize = 500;

pub(super) fn section(report: &Report, comparison: &Comparison) -> Markup {
    let attitudes = &comparison.attitudes;
    let device = attitudes.device();
    let with_truth = report.attitude.is_some();
    let (reference, name) = if with_truth {
        (&attitudes.truth, "truth")
    } else {
        (&attitudes.codes, "golden on the same codes")
    };
    let content = html! {
        @if device.is_absent() || comparison.run.solution_seconds <= 0.0 {
            p.muted { "This run has no attitude over time." }
        } @else {
            div.legend {
                span { i.reference {} (name) }
                span { i.device {} "device" }
                span { i.shade {} "solutions with a status flag" }
            }
            (curve("yaw", device, reference, comparison, |angles| angles.yaw.wrapped().degrees()))
            (curve("pitch", device, reference, comparison, |angles| angles.pitch.degrees()))
            (curve("roll", device, reference, comparison, |angles| angles.roll.wrapped().degrees()))
            (error(name, device, reference, comparison))
        }
        div.columns {
            div { h3 { "Error over solutions without flags" } (table(report)) }
            div { h3 { "Status flags" } (flags(report)) }
        }
    };
    framed(
        "attitude",
        "Attitude",
        "Angles of set 1 (Z-Y-X); total is the angle of the rotation between two attitudes. \
         Solutions that the firmware flags are shown and counted apart; models do not judge them.",
        &content,
    )
}

fn seconds(comparison: &Comparison) -> f64 {
    comparison.flags.len().max(1) as f64 * comparison.run.solution_seconds
}

fn flagged(comparison: &Comparison) -> Layer {
    let flags = &comparison.flags;
    Layer::Shade {
        class: "shade",
        spans: spans(flags.len(), seconds(comparison), STRETCHES, |at| {
            flags[at] != 0
        }),
    }
}

fn curve(
    name: &str,
    device: &Series,
    reference: &Series,
    comparison: &Comparison,
    degrees: fn(Angles) -> f64,
) -> Markup {
    let points = |series: &Series| -> Vec<(f64, f64)> {
        let stride = series.0.len().div_ceil(POINTS).max(1);
        let known = series.0.iter().enumerate().step_by(stride);
        known
            .filter_map(|(at, angles)| {
                let time = (at as f64 + 0.5) * comparison.run.solution_seconds;
                Some((time, degrees((*angles)?)))
            })
            .collect()
    };
    let (shown, expected) = (points(device), points(reference));
    let all = shown.iter().chain(&expected);
    let most = all.fold(0f64, |most, (_, value)| most.max(value.abs()));
    let reach = [30.0, 60.0, 90.0]
        .into_iter()
        .find(|step| most <= *step)
        .unwrap_or(180.0);
    let plot = Plot {
        label: format!("{name} in degrees over time, device and reference"),
        seconds: seconds(comparison),
        low: -1.08 * reach,
        high: 1.08 * reach,
        ticks: vec![-reach, 0.0, reach],
        unit: "°",
        height: 110,
        layers: vec![
            flagged(comparison),
            Layer::Line {
                class: "reference",
                points: expected,
                jump: 180.0,
            },
            Layer::Line {
                class: "device",
                points: shown,
                jump: 180.0,
            },
        ],
    };
    html! { figure { figcaption { (name) } (plot.markup()) } }
}

/// The rotation between device and reference; the largest in each stretch of time is drawn.
fn error(name: &str, device: &Series, reference: &Series, comparison: &Comparison) -> Markup {
    let seconds = seconds(comparison);
    let errors = |wanted: bool| {
        let flags = &comparison.flags;
        let solutions = (0..device.0.len())
            .filter(move |&at| flags.get(at).is_some_and(|word| (*word != 0) == wanted));
        solutions.filter_map(|at| {
            let error = rotation_error(device.at(at)?, reference.at(at)?);
            Some(((at as f64 + 0.5) * comparison.run.solution_seconds, error))
        })
    };
    let count = STRETCHES.min(comparison.flags.len()).max(1);
    let judged = stretches(errors(false), seconds, count);
    let most = judged
        .iter()
        .flatten()
        .fold(0f64, |most, at| most.max(at.high));
    if most == 0.0 {
        return html! {};
    }
    let high = 1.1 * most;
    let plot = Plot {
        label: format!("total attitude error against {name} in degrees over time"),
        seconds,
        low: 0.0,
        high,
        ticks: ticks(0.0, high, 3),
        unit: "°",
        height: 140,
        layers: vec![
            flagged(comparison),
            Layer::Band {
                class: "band",
                stretches: judged,
            },
        ],
    };
    html! {
        figure {
            figcaption { "total error against " (name) }
            (plot.markup())
        }
    }
}

fn table(report: &Report) -> Markup {
    html! {
        table {
            thead { tr {
                th scope="col" { "degrees" }
                th.number scope="col" { "rms" }
                th.number scope="col" { "99 %" }
                th.number scope="col" { "max" }
                th.number scope="col" { "solutions" }
            } }
            @if let Some(errors) = &report.attitude { (rows("against truth", errors)) }
            @if let Some(errors) = &report.attitude_vs_golden { (rows("against golden on codes", errors)) }
        }
        @if report.attitude.is_none() {
            p.muted { "No reference attitude in this run: no error against truth." }
        }
    }
}

fn rows(title: &str, errors: &AttitudeErrors) -> Markup {
    html! {
        tbody {
            tr.group { th scope="rowgroup" colspan="5" { (title) } }
            (row("roll", &errors.roll))
            (row("pitch", &errors.pitch))
            (row("yaw", &errors.yaw))
            (row("total", &errors.total))
        }
    }
}

fn row(name: &str, spread: &Spread) -> Markup {
    html! {
        tr {
            th scope="row" { (name) }
            td.number { (optional(spread.rms_deg)) }
            td.number { (optional(spread.p99_deg)) }
            td.number { (optional(spread.max_deg)) }
            td.number { (count(spread.samples)) }
        }
    }
}

fn flags(report: &Report) -> Markup {
    let total = |name: &str| {
        let entry = report
            .attitude_flagged
            .iter()
            .find(|(flag, _)| flag == name);
        entry.map(|(_, errors)| errors.total).unwrap_or_default()
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
                        td.number { (optional(total(&flag.name).rms_deg)) }
                        td.number { (optional(total(&flag.name).max_deg)) }
                    }
                }
            }
        }
    }
}
