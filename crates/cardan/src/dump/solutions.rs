//! One row per solution: time, truth, status, and for each node that takes one value per solution
//! native's, golden's and the real interpretation's value and the emulated raw word.

use std::io;

use cardan_compare::{Comparison, Node};
use cardan_outputs::Is;

use super::table::{Cell, Columns, Kind, Table};
use crate::participants::diff::Collected;

/// The rows, of which so many are written.
#[derive(Debug, Default)]
pub(super) struct Solutions(u64);

/// Nodes that take one value per solution.
fn nodes(comparison: &Comparison) -> impl Iterator<Item = &Node> {
    comparison
        .nodes
        .iter()
        .filter(|node| node.per_solution == 1)
}

/// The columns of a run.
pub(super) fn columns(facts: &Comparison) -> Columns {
    let fixed = [
        ("solution", Kind::Whole),
        ("t_s", Kind::Real),
        ("flags", Kind::Whole),
    ];
    let fixed = fixed.map(|(name, kind)| (name.to_owned(), kind));
    let truth = facts.outputs.group.iter().flat_map(|group| {
        let suffix = &group.unit.suffix;
        let members = group.members.iter();
        members.map(move |member| (format!("truth_{}_{suffix}", member.name), Kind::Real))
    });
    let of_nodes = nodes(facts).flat_map(|node| node_columns(&node.name));
    let of_nodes = of_nodes.map(|name| (name, Kind::Real));
    fixed.into_iter().chain(truth).chain(of_nodes).collect()
}

impl Solutions {
    pub(super) fn add(
        &mut self,
        window: &Comparison,
        collected: &Collected,
        table: &mut Table,
    ) -> io::Result<()> {
        for (at, flags) in window.flags.iter().enumerate() {
            let instant = collected.instants.get(at);
            let mut row = vec![
                Cell::Whole(self.0),
                Cell::real(instant.map(|instant| instant.time_s)),
                Cell::Whole((*flags).into()),
            ];
            let truth = window
                .chain
                .values(Is::Truth)
                .and_then(|truth| truth.at(at));
            let members = window.outputs.group.iter().flat_map(|group| &group.members);
            for (place, member) in members.enumerate() {
                let value = truth.map(|values| member.scale * values[place]);
                row.push(Cell::real(value));
            }
            row.extend(nodes(window).flat_map(|node| node_cells(node, at)));
            table.row(&row)?;
            self.0 += 1;
        }
        Ok(())
    }
}

/// Columns of a node.
pub(super) fn node_columns(name: &str) -> [String; 4] {
    ["native", "emulated_raw", "golden", "real"].map(|of| format!("{name}_{of}"))
}

/// Cells of a node's value number `index`.
pub(super) fn node_cells(node: &Node, index: usize) -> [Cell; 4] {
    let of = |values: &Option<Vec<f64>>| {
        let values = values.as_ref();
        Cell::real(values.and_then(|values| values.get(index).copied()))
    };
    let emulated = node.emulated.as_ref().and_then(|words| words.get(index));
    [
        Cell::real(node.native.get(index).map(|&raw| raw as f64 * node.lsb)),
        // A tap's word has at most 32 bits.
        Cell::real(emulated.map(|&raw| raw as f64)),
        of(&node.golden),
        of(&node.real),
    ]
}
