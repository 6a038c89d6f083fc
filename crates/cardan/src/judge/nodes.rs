//! Each node with what holds for the whole run.

use cardan_bench::app::Configuration;
use cardan_compare::{Format, Node, NodeInput};
use cardan_datapath::NodeInfo;
use cardan_numerics::tape::Flow;

use super::limits::{allowance, set_tolerance, tuned_tolerance};
use crate::failure::Failure;
use crate::run_options::Setup;

/// Every node that takes values with these settings, without the values; and which of the application's it is.
pub(super) fn facts(
    setup: &Setup,
    configuration: &Configuration,
) -> Result<(Vec<Node>, Vec<usize>), Failure> {
    let app = setup.app;
    let flow = app.flow(configuration).map_err(Failure::input)?;
    let per_solution = app
        .values_per_solution(configuration)
        .map_err(Failure::input)?;
    let bundled = app.tolerances();
    let golden_nodes = app.golden_nodes();
    let facts = |(index, info): (usize, &NodeInfo)| {
        let format = setup
            .formats
            .as_ref()
            .map_or(info.format, |formats| formats[index]);
        Node {
            name: info.name.to_owned(),
            unit: info.unit.to_owned(),
            meaning: info.meaning.to_owned(),
            inputs: inputs_of(&flow, index, app.nodes()),
            operations: operations_of(&flow, index),
            position: flow.position(index),
            writes: flow
                .position(index)
                .map(|at| flow.writes[at].clone())
                .unwrap_or_default(),
            per_solution: per_solution[index],
            format: Some(Format {
                word: format.word,
                frac: format.frac as i32,
                rounding: format.rounding.name().to_owned(),
                overflow: format.overflow.name().to_owned(),
            }),
            lsb: format.lsb(),
            native: Vec::new(),
            emulated: setup.firmware.taps.map(|_| Vec::new()),
            real: Some(Vec::new()),
            expected: Some(Vec::new()),
            golden: golden_nodes.contains(&index).then(Vec::new),
            overflows: 0,
            tolerance: set_tolerance(setup, info.name),
            tuned: tuned_tolerance(setup, info.name),
            allowance: allowance(&bundled, info.name),
        }
    };
    let listed = app.nodes().iter().enumerate();
    let listed = listed.filter(|(index, _)| per_solution[*index] > 0);
    let indices = listed.clone().map(|(index, _)| index).collect();
    Ok((listed.map(facts).collect(), indices))
}

/// The nodes whose values enter a node.
fn inputs_of(flow: &Flow, node: usize, nodes: &[NodeInfo]) -> Vec<NodeInput> {
    let entering = flow.edges.iter().filter(|edge| edge.to == node);
    let named = entering.filter_map(|edge| {
        Some(NodeInput {
            node: nodes.get(edge.from)?.name.to_owned(),
            earlier: edge.earlier,
        })
    });
    named.collect()
}

/// What writes a node, in words.
pub(crate) fn operations_of(flow: &Flow, node: usize) -> Vec<String> {
    let words = flow.position(node).map(|at| &flow.operations[at]);
    let words = words.into_iter().flatten();
    words.map(|&word| word.to_owned()).collect()
}
