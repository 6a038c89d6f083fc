//! In which order a tape's operations run over many steps: what feeds back on itself is found as a
//! strongly connected component and runs step by step, all else in order of dependence.

use petgraph::algo::tarjan_scc;
use petgraph::graph::DiGraph;

use crate::tape::{Ref, Tape};

/// What runs next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Stage {
    /// One operation, all steps of a block at once.
    Lanes(usize),
    /// Operations that depend on each other's earlier results, in the order of a step.
    Loop(Vec<usize>),
}

/// The stages of the steady operations, operands before their users.
pub(super) fn stages(tape: &Tape) -> Vec<Stage> {
    let mut graph = DiGraph::<(), ()>::new();
    let nodes: Vec<_> = tape.steady.iter().map(|_| graph.add_node(())).collect();
    for (user, entry) in tape.steady.iter().enumerate() {
        for operand in entry.op.operands() {
            if let Ref::Here(index) | Ref::Ago { index, .. } = operand {
                graph.add_edge(nodes[user], nodes[index as usize], ());
            }
        }
    }
    // Components come with what they depend on first.
    let stage = |component: Vec<petgraph::graph::NodeIndex>| {
        let mut indices: Vec<usize> = component.iter().map(|node| node.index()).collect();
        indices.sort_unstable();
        let alone = indices.len() == 1 && !graph.contains_edge(component[0], component[0]);
        if alone {
            Stage::Lanes(indices[0])
        } else {
            Stage::Loop(indices)
        }
    };
    tarjan_scc(&graph).into_iter().map(stage).collect()
}
