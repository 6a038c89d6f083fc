//! Ranges as a page of their own: simulated, interval and affine bounds side by side, and the
//! simulated values against the formats.

use cardan_datapath::{Format, Overflow, Rounding};
use maud::{Markup, html};

use crate::page::{document, histograms};
use crate::ranges::{NodeRange, Ranges};

/// The page, self-contained.
#[must_use]
pub fn ranges_page(found: &Ranges, title: &str, command: &str) -> String {
    let proven = found.nodes.iter().filter(|node| node.proven).count();
    let content = html! {
        p { (found.steps) " solutions simulated; " (proven) " of " (found.nodes.len())
            " nodes proven never to overflow, whatever the inputs." }
        (ranges_table(&found.nodes))
        (histograms(found.nodes.iter().map(|range| (range, format(range)))))
    };
    document(title, command, &content)
}

/// Per node what is simulated, derived and proven.
pub(crate) fn ranges_table(nodes: &[NodeRange]) -> Markup {
    html! {
        table {
            tr {
                th { "node" } th { "unit" } th { "format" } th { "simulated" } th { "interval" }
                th { "affine" } th { "integer bits" } th { "overflow" }
            }
            @for node in nodes {
                tr {
                    td { (node.name) } td { (node.unit) }
                    td { (i64::from(node.word) - i64::from(node.frac)) "." (node.frac) }
                    td { (span(node.min, node.max)) }
                    td { (span(node.derived.lo, node.derived.hi)) }
                    td { (span(node.derived_affine.lo, node.derived_affine.hi)) }
                    td { (node.integer) }
                    td { (node.verdict()) }
                }
            }
        }
    }
}

fn span(lo: Option<f64>, hi: Option<f64>) -> String {
    let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.5}"));
    format!("{} … {}", number(lo), number(hi))
}

/// The node's word; rounding and overflow make no difference to a histogram.
const fn format(range: &NodeRange) -> Format {
    Format::new(range.word, range.frac, Rounding::Floor, Overflow::Wrap)
}
