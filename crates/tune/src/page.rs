//! The result as a page of its own: verdict, candidates, front, what changes per node, shares of the error,
//! histograms against the formats.

use cardan_datapath::Format;
use cardan_page::format::number;
use cardan_page::histogram::{Bin, histogram};
use cardan_page::plot::{Bar, bars};
use cardan_page::scatter::{Point, Scatter};
use cardan_page::unit::reading;
use cardan_page::{document, framed, masthead, reproduce};
use maud::{Markup, html};

use crate::outcome::{Candidate, Outcome};
use crate::ranges::NodeRange;
use crate::ranges_page::ranges_table;

/// Contributions to the error that are shown.
const SHOWN: usize = 24;

/// The page, self-contained.
#[must_use]
pub fn page(outcome: &Outcome, title: &str, command: &str) -> String {
    let pairs = outcome.ranges.iter().zip(&outcome.best.formats.0);
    let good = outcome.binding.is_none() && outcome.verified;
    let content = html! {
        (masthead("tune", title, Some(good), &statement(outcome)))
        (framed(
            "verdict",
            "Budget",
            "Every limit of the budget on every run: those tuned on, and those held out. A share up to 1 is \
             within the limit.",
            &verdict(outcome),
        ))
        (framed(
            "candidates",
            "Candidates",
            "The same algorithm in different formats. Areas are estimates in gate equivalents.",
            &candidates(outcome),
        ))
        (framed(
            "front",
            "Cost against error",
            "Each point is the best that was found for limits that are looser or tighter by a factor. Red: the \
             formats in the firmware, the best uniform word length.",
            &front(outcome),
        ))
        (framed(
            "nodes",
            "From deployed to tuned",
            "Per node the format in the firmware and the tuned one: integer bits, the sign among them, and \
             fractional bits; what values take in simulation; the node's largest share of an output's rounding \
             error.",
            &changes(outcome),
        ))
        (framed(
            "shares",
            "Shares of the rounding error",
            "The noise model at the result: which node's rounding makes how much of an output's error, in \
             percent; logarithmic.",
            &shares(outcome),
        ))
        (framed("ranges", "Ranges", "In the formats of the firmware.", &ranges_table(&outcome.ranges)))
        (histograms(pairs.map(|(range, (_, format))| (range, *format))))
        (reproduce(command))
    };
    document(title, &content)
}

/// The simulated values of nodes against their formats.
pub(crate) fn histograms<'a>(nodes: impl Iterator<Item = (&'a NodeRange, Format)>) -> Markup {
    let one = |(range, format): (&NodeRange, Format)| {
        let top = format.word.cast_signed() - format.frac.cast_signed() - 1;
        let bottom = -format.frac.cast_signed();
        let bins: Vec<Bin> = range
            .histogram
            .iter()
            .map(|bin| Bin {
                exponent: bin.exponent,
                count: bin.count,
            })
            .collect();
        let caption = format!("{}.{} in {}", top + 1, format.frac, range.unit);
        histogram(&range.name, &caption, &bins, top, bottom)
    };
    framed(
        "values",
        "Values against formats",
        "Simulated magnitudes by bit weight, in the node's own unit, heaviest bit at the left; bar heights are \
         square roots of counts. Shaded: the word. Blue: within it; grey: under half its last place; red: beyond \
         its range.",
        &html! { div.multiples { @for node in nodes { (one(node)) } } },
    )
}

fn statement(outcome: &Outcome) -> String {
    let mut text = match (&outcome.binding, outcome.verified) {
        (Some(binding), _) => {
            format!("Budget not met: {binding} is missed even by the closest point.")
        }
        (None, true) => "Budget met, on held-out runs too.".to_owned(),
        (None, false) => {
            "NOT VERIFIED: the budget is met on the runs tuned on, and missed on others.".to_owned()
        }
    };
    if let Some(reason) = &outcome.reason {
        text.push(' ');
        text.push_str(reason);
    }
    text
}

fn verdict(outcome: &Outcome) -> Markup {
    html! {
        @if let Some(found) = &outcome.statistics { p { (crate::output::told(found)) } }
        @for warning in &outcome.warnings { p.bad-text { (warning) } }
        div.scroll { table {
            thead { tr {
                th scope="col" { "run" }
                th scope="col" { "limit" }
                th.number scope="col" { "reached" }
                th.number scope="col" { "of the limit" }
                th.number scope="col" { "over tuning" }
            } }
            tbody { @for case in &outcome.verification {
                @for reached in &case.reached {
                    tr {
                        th scope="row" { (case.case) @if case.held_out { span.muted { " held out" } } }
                        td { (reached.constraint) }
                        td.number { (optional(reached.value)) }
                        td.number .bad-text[reached.ratio.is_none_or(|ratio| ratio > 1.0)] {
                            (optional(reached.ratio))
                        }
                        td.number { (optional(case.over_tuning)) }
                    }
                }
            } }
        } }
    }
}

fn optional(value: Option<f64>) -> String {
    cardan_page::format::optional(value)
}

fn candidates(outcome: &Outcome) -> Markup {
    let row = |candidate: &Candidate| {
        let whole =
            |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.0}"));
        html! {
            tr {
                th scope="row" { (candidate.name) }
                td.number { (candidate.bits) }
                td.number { (whole(candidate.area)) }
                td.number { (whole(candidate.cycles)) }
                td.number { (whole(candidate.cycles_estimated)) }
                td.number { (optional(candidate.error)) }
            }
        }
    };
    html! {
        table {
            thead { tr {
                th scope="col" { "formats" }
                th.number scope="col" { "bits" }
                th.number scope="col" { "area (estimate)" }
                th.number scope="col" { "cycles (measured)" }
                th.number scope="col" { "cycles (estimate)" }
                th.number scope="col" { (measure(outcome)) }
            } }
            tbody {
                (row(&outcome.baseline))
                (row(&outcome.deployed))
                @if let Some(uniform) = &outcome.best_uniform { (row(uniform)) }
                (row(&outcome.best))
                @for other in outcome.measured.iter().filter(|other| is_other(outcome, other)) {
                    (row(other))
                }
            }
        }
    }
}

/// Measured beside the candidates that have a row anyway.
fn is_other(outcome: &Outcome, candidate: &Candidate) -> bool {
    let shown = [&outcome.baseline, &outcome.deployed, &outcome.best];
    let shown = shown.into_iter().chain(&outcome.best_uniform);
    shown.into_iter().all(|shown| shown.name != candidate.name)
}

/// What the first figure of the budget measures.
fn measure(outcome: &Outcome) -> String {
    let first = outcome.best.reached.first();
    let text = first.map_or("error", |reached| reached.constraint.as_str());
    let end = text.find(['<', '>', '=']).unwrap_or(text.len());
    text[..end].trim().to_owned()
}

/// Bits over the logarithm of the error, with the formats of the firmware.
fn front(outcome: &Outcome) -> Markup {
    let points = outcome.pareto.iter().filter_map(|point| {
        Some(Point {
            x: point.error?,
            y: point.bits as f64,
            label: format!("limits × {}: {} bits", point.limit_factor, point.bits),
            class: "device",
        })
    });
    let best = outcome.best.error.map(|error| Point {
        x: error,
        y: outcome.best.bits as f64,
        label: format!("result: {} bits", outcome.best.bits),
        class: "device",
    });
    let is_new = |best: &Point| {
        !outcome
            .pareto
            .iter()
            .any(|point| point.bits as f64 == best.y)
    };
    let points = points.chain(best.filter(is_new));
    let apart = [Some(&outcome.deployed), outcome.best_uniform.as_ref()];
    let apart = apart.into_iter().flatten().filter_map(|candidate| {
        Some(Point {
            x: candidate.error?,
            y: candidate.bits as f64,
            label: format!("{}: {} bits", candidate.name, candidate.bits),
            class: "marked",
        })
    });
    let chart = Scatter {
        label: "Pareto front: bits over error".to_owned(),
        x_title: format!("{}, in the budget's unit; logarithmic", measure(outcome)),
        y_title: "sum of word lengths in bits".to_owned(),
        points: points.chain(apart).collect(),
    };
    html! {
        @if outcome.pareto.is_empty() { p.muted { "No front was asked for." } }
        (chart.markup())
    }
}

/// Per node what is deployed and what it becomes.
fn changes(outcome: &Outcome) -> Markup {
    let written = |format: &Format| {
        format!(
            "{}.{}",
            i64::from(format.word) - i64::from(format.frac),
            format.frac
        )
    };
    let share = |name: &str| {
        let own = outcome
            .sensitivities
            .iter()
            .filter(|noise| noise.node == name);
        own.map(|noise| noise.share).max_by(f64::total_cmp)
    };
    let (mut before, mut after) = (0u64, 0u64);
    let rows: Vec<Markup> = outcome
        .deployed
        .formats
        .0
        .iter()
        .zip(&outcome.best.formats.0)
        .enumerate()
        .map(|(at, ((name, old), (_, new)))| {
            before += u64::from(old.word);
            after += u64::from(new.word);
            let range = outcome.ranges.get(at);
            let change = i64::from(new.word) - i64::from(old.word);
            html! {
                tr {
                    th scope="row" { (name) }
                    td { (range.map_or("", |range| reading(&range.unit).short)) }
                    td.number { (written(old)) }
                    td.number { (written(new)) }
                    td.number .good-text[change < 0] .bad-text[change > 0] {
                        @if change == 0 { "0" } @else { (format!("{change:+}")) }
                    }
                    td { (new.rounding.name()) @if old.rounding != new.rounding {
                        span.change { " (" (old.rounding.name()) ")" }
                    } }
                    td { (new.overflow.name()) @if old.overflow != new.overflow {
                        span.change { " (" (old.overflow.name()) ")" }
                    } }
                    td.number { (span(range)) }
                    td.number { (share(name).map_or("–".to_owned(), cardan_page::format::percent)) }
                }
            }
        })
        .collect();
    html! {
        div.scroll { table {
            thead { tr {
                th scope="col" { "node" }
                th scope="col" { "unit" }
                th.number scope="col" { "deployed" }
                th.number scope="col" { "tuned" }
                th.number scope="col" { "bits" }
                th scope="col" { "rounding (before)" }
                th scope="col" { "overflow (before)" }
                th.number scope="col" { "simulated" }
                th.number scope="col" { "share" }
            } }
            tbody {
                @for row in &rows { (row) }
                tr.total {
                    th scope="row" { "all" } td {}
                    td.number { (before) } td.number { (after) }
                    td.number { (format!("{:+}", after.cast_signed() - before.cast_signed())) }
                    td {} td {} td {} td {}
                }
            }
        } }
    }
}

/// What values take, in the unit that is shown.
fn span(range: Option<&NodeRange>) -> String {
    let ends = range.and_then(|range| Some((range.min?, range.max?, reading(&range.unit).scale)));
    ends.map_or("–".to_owned(), |(least, most, scale)| {
        format!("{} … {}", number(scale * least), number(scale * most))
    })
}

fn shares(outcome: &Outcome) -> Markup {
    let mut all: Vec<_> = outcome
        .sensitivities
        .iter()
        .filter(|noise| noise.share > 0.0)
        .collect();
    all.sort_by(|a, b| b.share.total_cmp(&a.share));
    all.truncate(SHOWN);
    let shown: Vec<Bar> = all
        .iter()
        .map(|noise| Bar {
            name: noise.node.clone(),
            remark: format!("in {}", noise.quantity),
            size: Some(100.0 * noise.share),
            class: "",
        })
        .collect();
    bars(&shown, " %")
}
