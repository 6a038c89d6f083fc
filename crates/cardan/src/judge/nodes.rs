//! Each node with all that was published of it.

use cardan_compare::{Format, Node, NodeInput};
use cardan_datapath::NodeInfo;
use cardan_numerics::tape::Flow;
use cardan_spec::nodes::SHARED;

use super::limits::{allowance, set_tolerance, tuned_tolerance};
use crate::failure::Failure;
use crate::participants::diff::Collected;
use crate::run_options::Setup;

pub(super) fn nodes(
    setup: &Setup,
    collected: &Collected,
    solutions: usize,
) -> Result<Vec<Node>, Failure> {
    let app = setup.app;
    let flow = app.flow(&collected.configuration).map_err(Failure::input)?;
    let averaging = collected.configuration.averaging();
    let bundled = app.tolerances();
    let golden_of = |node: usize| {
        let shared = app.golden_nodes().iter().position(|&index| index == node)?;
        collected.golden.get(&shared).cloned()
    };
    let listed = |(index, info): (usize, &NodeInfo)| {
        let native = collected.native.get(&index)?.clone();
        let format = setup
            .formats
            .as_ref()
            .map_or(info.format, |formats| formats[index]);
        let per_solution = SHARED
            .iter()
            .find(|shared| shared.name == info.name)
            .map_or(native.len() / solutions.max(1), |shared| {
                shared.per_solution(averaging)
            });
        Some(Node {
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
            per_solution,
            format: Some(Format {
                word: format.word,
                frac: format.frac as i32,
                rounding: format.rounding.name().to_owned(),
                overflow: format.overflow.name().to_owned(),
            }),
            lsb: format.lsb(),
            native,
            emulated: setup
                .firmware
                .taps
                .map(|_| collected.emulated.get(&index).cloned().unwrap_or_default()),
            real: collected.real.get(&index).cloned(),
            expected: collected.expected.get(&index).cloned(),
            golden: golden_of(index),
            overflows: collected
                .native_summary
                .overflows
                .get(index)
                .copied()
                .unwrap_or(0),
            tolerance: set_tolerance(setup, info.name),
            tuned: tuned_tolerance(setup, info.name),
            allowance: allowance(&bundled, info.name),
        })
    };
    Ok(app.nodes().iter().enumerate().filter_map(listed).collect())
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
