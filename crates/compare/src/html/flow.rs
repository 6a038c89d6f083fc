//! The data flow of the algorithm, as the tape has it.

use std::collections::BTreeMap;

use cardan_page::flow::{Edge, Node, detail, svg};
use cardan_page::framed;
use maud::{Markup, html};

use crate::input::Comparison;
use crate::report::Report;

/// The graph; nothing where the data flow is not known.
pub(super) fn section(report: &Report, comparison: &Comparison) -> Markup {
    let mut order: Vec<usize> = (0..comparison.nodes.len()).collect();
    order.retain(|&node| comparison.nodes[node].position.is_some());
    order.sort_by_key(|&node| comparison.nodes[node].position);
    if order.is_empty() {
        return html! {};
    }
    let index: BTreeMap<&str, usize> = order
        .iter()
        .enumerate()
        .map(|(at, &node)| (comparison.nodes[node].name.as_str(), at))
        .collect();
    let outputs: Vec<&str> = comparison
        .outputs
        .quantities
        .iter()
        .map(|quantity| quantity.node.as_str())
        .collect();
    let nodes: Vec<Node> = order
        .iter()
        .map(|&at| {
            let (node, found) = (&comparison.nodes[at], &report.nodes[at]);
            let is = |word: &str| node.operations.iter().any(|operation| operation == word);
            let operations: Vec<&str> = node.operations.iter().map(String::as_str).collect();
            let format = node
                .format
                .as_ref()
                .map(ToString::to_string)
                .unwrap_or_default();
            Node {
                name: node.name.clone(),
                detail: detail(&operations, &format),
                meaning: node.meaning.clone(),
                class: match () {
                    () if !found.pass => "bad",
                    () if outputs.contains(&node.name.as_str()) => "output",
                    () if is("input") => "input",
                    () => "",
                },
            }
        })
        .collect();
    let edges: Vec<Edge> = order
        .iter()
        .enumerate()
        .flat_map(|(to, &at)| {
            let index = &index;
            comparison.nodes[at].inputs.iter().filter_map(move |input| {
                Some(Edge {
                    from: *index.get(input.node.as_str())?,
                    to,
                    earlier: input.earlier,
                })
            })
        })
        .collect();
    framed(
        "flow",
        "Data flow",
        "What enters each node, recorded from the algorithm itself; formats as integer and fractional bits. \
         Dashed: values of the solution before, and nodes that are used again. Blue: inputs; green: what is \
         sent; red: nodes that fail. Settings and constants are not drawn.",
        &html! { div.scroll { (svg(&nodes, &edges, None)) } },
    )
}
