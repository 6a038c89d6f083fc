//! The error budget as bars and as a table per angle, and the rounding per node.

use maud::{Markup, html};

use crate::budget::{AngleSpread, PartDetail};
use crate::format::{count, number, optional};
use crate::report::Report;
use cardan_page::framed;
use cardan_page::plot::{Bar, bars};

/// The parts in signal order, with what each of them is.
const PARTS: [(&str, &str, &str); 7] = [
    ("latency", "Latency and skew", "sampling instants and delay"),
    (
        "motion",
        "Motion and environment",
        "acceleration, disturbed field: the method's own error",
    ),
    (
        "sensor_frontend",
        "Sensor and front end",
        "physics, noise, filters",
    ),
    ("adc", "ADC quantisation", "ten bits"),
    ("algorithm", "Algorithm", "series and iterations, in f64"),
    ("rounding", "Rounding", "word lengths"),
    ("compiled", "Compiled code", "must be zero"),
];

pub(super) fn section(report: &Report) -> Markup {
    let detail = &report.error_budget_detail;
    let known = |name: &str| detail.parts.iter().find(|part| part.part == name);
    let parts: Vec<Bar> = PARTS
        .iter()
        .map(|(name, title, remark)| Bar {
            name: (*title).to_owned(),
            remark: (*remark).to_owned(),
            size: known(name).and_then(|part| part.rotation.rms_deg),
            class: if *name == "compiled" { "alarm" } else { "part" },
        })
        .chain(detail.whole.as_ref().map(|whole| Bar {
            name: "Whole".to_owned(),
            remark: "emulated against truth".to_owned(),
            size: whole.rotation.rms_deg,
            class: "whole",
        }))
        .collect();
    let content = html! {
        h3 { "Size of each part, degrees rms of its rotation, logarithmic" }
        (bars(&parts, "°"))
        @if let Some(open) = detail.closure_deg {
            p.note {
                "Per angle and solution the parts add up to the whole error within "
                strong { (number(open)) "°" }
                ", checked in " (count(detail.closure_samples)) " solutions."
            }
        } @else {
            p.muted { "No solution knows every part, so their sum could not be checked." }
        }
        (table(report))
        @if !detail.rounding_shares.is_empty() {
            h3 { "Rounding by node, degrees rms, logarithmic" }
            (bars(&shares(report), "°"))
        }
    };
    framed(
        "budget",
        "Error budget",
        "The way from truth to the emulated output in steps: each part is what one stage adds to \
         the attitude.",
        &content,
    )
}

fn shares(report: &Report) -> Vec<Bar> {
    let shares = report.error_budget_detail.rounding_shares.iter();
    shares
        .map(|share| Bar {
            name: share.node.clone(),
            remark: String::new(),
            size: share.rms_deg,
            class: "part",
        })
        .collect()
}

fn table(report: &Report) -> Markup {
    let detail = &report.error_budget_detail;
    html! {
        div.scroll {
            table.angles {
                thead {
                    tr {
                        th scope="col" rowspan="2" { "degrees" }
                        @for angle in ["yaw", "pitch", "roll", "rotation"] {
                            th.number.over scope="colgroup" colspan="3" { (angle) }
                        }
                    }
                    tr {
                        @for _ in 0..3 {
                            th.number.first scope="col" { "bias" }
                            th.number scope="col" { "rms" }
                            th.number scope="col" { "max" }
                        }
                        th.number.first scope="col" { "rms" }
                        th.number scope="col" { "99 %" }
                        th.number scope="col" { "max" }
                    }
                }
                tbody {
                    @for (name, title, _) in PARTS {
                        @if let Some(part) = detail.parts.iter().find(|part| part.part == name) {
                            tr { th scope="row" { (title) } (cells(part)) }
                        }
                    }
                    @if let Some(whole) = &detail.whole {
                        tr.total { th scope="row" { "Whole" } (cells(whole)) }
                    }
                }
            }
        }
    }
}

fn cells(part: &PartDetail) -> Markup {
    html! {
        @for AngleSpread { bias_deg, rms_deg, max_deg } in [part.yaw, part.pitch, part.roll] {
            td.number.first { (optional(bias_deg)) }
            td.number { (optional(rms_deg)) }
            td.number { (optional(max_deg)) }
        }
        td.number.first { (optional(part.rotation.rms_deg)) }
        td.number { (optional(part.rotation.p99_deg)) }
        td.number { (optional(part.rotation.max_deg)) }
    }
}
