//! Ranges as a page of their own: simulated, interval and affine bounds side by side, and the
//! simulated values against the formats.

use cardan_datapath::{Format, Overflow, Rounding};
use cardan_page::unit::reading;
use cardan_page::{document, framed, masthead, reproduce};
use maud::{Markup, html};

use crate::page::histograms;
use crate::ranges::{NodeRange, Ranges};

/// The page, self-contained.
#[must_use]
pub fn ranges_page(found: &Ranges, title: &str, command: &str) -> String {
    let proven = found.nodes.iter().filter(|node| node.proven).count();
    let statement = format!(
        "{} solutions simulated; {proven} of {} nodes proven never to overflow, whatever the inputs.",
        found.steps,
        found.nodes.len()
    );
    let content = html! {
        (masthead("ranges", title, None, &statement))
        (framed(
            "ranges",
            "Ranges",
            "What values take in simulation, and what they can take by interval and by affine arithmetic, in the \
             unit that is named; the integer bits that follow.",
            &ranges_table(&found.nodes),
        ))
        (histograms(found.nodes.iter().map(|range| (range, format(range)))))
        (reproduce(command))
    };
    document(title, &content)
}

/// Per node what is simulated, derived and proven.
pub(crate) fn ranges_table(nodes: &[NodeRange]) -> Markup {
    let row = |node: &NodeRange| {
        let reading = reading(&node.unit);
        let span = |lo: Option<f64>, hi: Option<f64>| {
            // Whether a range ends at 1 or right below it is what a format is chosen by.
            let shown = |value: Option<f64>| {
                let digits = |value: f64| format!("{:.5}", reading.scale * value);
                value.map_or("–".to_owned(), digits)
            };
            format!("{} … {}", shown(lo), shown(hi))
        };
        let is_safe = node.proven || node.wraps_by_design;
        html! {
            tr {
                th scope="row" { (node.name) }
                td { (reading.short) }
                td.number { (i64::from(node.word) - i64::from(node.frac)) "." (node.frac) }
                td.number { (span(node.min, node.max)) }
                td.number { (span(node.derived.lo, node.derived.hi)) }
                td.number { (span(node.derived_affine.lo, node.derived_affine.hi)) }
                td.number { (node.integer) }
                td .good-text[is_safe] .bad-text[!is_safe && node.overflows > 0] { (node.verdict()) }
            }
        }
    };
    html! {
        div.scroll { table {
            thead { tr {
                th scope="col" { "node" }
                th scope="col" { "unit" }
                th.number scope="col" { "format" }
                th.number scope="col" { "simulated" }
                th.number scope="col" { "interval" }
                th.number scope="col" { "affine" }
                th.number scope="col" { "integer bits" }
                th scope="col" { "overflow" }
            } }
            tbody { @for node in nodes { (row(node)) } }
        } }
    }
}

/// The node's word; rounding and overflow make no difference to a histogram.
const fn format(range: &NodeRange) -> Format {
    Format::new(range.word, range.frac, Rounding::Floor, Overflow::Wrap)
}
