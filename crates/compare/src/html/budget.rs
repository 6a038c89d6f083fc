//! The error budget as bars and as a table per member, and the rounding per node.

use cardan_outputs::Is;
use cardan_page::framed;
use cardan_page::plot::{Bar, bars};
use maud::{Markup, html};

use crate::chain::PartDetail;
use crate::format::{count, number, optional, percent};
use crate::input::Comparison;
use crate::report::Report;
use crate::spread::Spread;

pub(super) fn section(report: &Report, facts: &Comparison) -> Markup {
    let (detail, group) = (&report.error_budget_detail, &report.group);
    if group.members.is_empty() {
        return html! {};
    }
    let unit = &group.unit;
    let known = |name: &str| detail.parts.iter().find(|part| part.part == name);
    let size = |part: &PartDetail| part.size().and_then(|size| size.rms);
    let parts: Vec<Bar> = (facts.chain.stages.iter().skip(1))
        .map(|stage| Bar {
            name: stage.stage.title.to_string(),
            remark: stage.stage.remark.to_string(),
            size: known(&stage.stage.part).and_then(size),
            class: if stage.stage.is == Is::Emulated {
                "alarm"
            } else {
                "part"
            },
        })
        .chain(detail.whole.as_ref().map(|whole| Bar {
            name: whole.title.clone(),
            remark: whole.remark.clone(),
            size: size(whole),
            class: "whole",
        }))
        .collect();
    let of = (group.combined.as_ref()).map_or("error", |combined| combined.what.as_str());
    let content = html! {
        h3 { "Size of each part, " (unit.words) " rms of its " (of) ", logarithmic" }
        (bars(&parts, &unit.symbol))
        @if let Some(open) = detail.closure {
            p.note {
                "Per " (group.member) " and solution the parts add up to the whole error within "
                strong { (number(open)) (unit.symbol) }
                ", checked in " (count(detail.closure_samples)) " solutions. The share is each part's of the "
                "whole's mean square, which adds to 100 % also where parts are correlated; a negative one "
                "takes error off."
            }
        } @else {
            p.muted { "No solution knows every part, so their sum could not be checked." }
        }
        (table(report))
        @if !detail.rounding_shares.is_empty() {
            h3 { "Rounding by node, " (unit.words) " rms, logarithmic" }
            (bars(&shares(report), &unit.symbol))
        }
    };
    framed(
        "budget",
        "Error budget",
        "The way from truth to the emulated output in steps: each part is what one stage adds.",
        &content,
    )
}

fn shares(report: &Report) -> Vec<Bar> {
    let shares = report.error_budget_detail.rounding_shares.iter();
    shares
        .map(|share| Bar {
            name: share.node.clone(),
            remark: String::new(),
            size: share.size.rms,
            class: "part",
        })
        .collect()
}

fn table(report: &Report) -> Markup {
    let (detail, group) = (&report.error_budget_detail, &report.group);
    html! {
        div.scroll {
            table.angles {
                thead {
                    tr {
                        th scope="col" rowspan="2" { (group.unit.words) }
                        @for member in &group.members {
                            th.number.over scope="colgroup" colspan="3" { (member.name) }
                        }
                        @if let Some(combined) = &group.combined {
                            th.number.over scope="colgroup" colspan="3" { (combined.what) }
                        }
                        th.number scope="col" rowspan="2" { "share" }
                    }
                    tr {
                        @for _ in &group.members {
                            th.number.first scope="col" { "bias" }
                            th.number scope="col" { "rms" }
                            th.number scope="col" { "max" }
                        }
                        @if group.combined.is_some() {
                            th.number.first scope="col" { "rms" }
                            th.number scope="col" { "99 %" }
                            th.number scope="col" { "max" }
                        }
                    }
                }
                tbody {
                    @for part in &detail.parts {
                        tr { th scope="row" { (part.title) } (cells(part)) }
                    }
                    @if let Some(whole) = &detail.whole {
                        tr.total { th scope="row" { (whole.title) } (cells(whole)) }
                    }
                }
            }
        }
    }
}

fn cells(part: &PartDetail) -> Markup {
    html! {
        @for (_, Spread { bias, rms, max, .. }) in &part.members {
            td.number.first { (optional(*bias)) }
            td.number { (optional(*rms)) }
            td.number { (optional(*max)) }
        }
        @if let Some((_, combined)) = &part.combined {
            td.number.first { (optional(combined.rms)) }
            td.number { (optional(combined.p99)) }
            td.number { (optional(combined.max)) }
        }
        td.number { (part.share.map_or_else(|| "–".to_owned(), percent)) }
    }
}
