//! One row per solution: time, truth, status, and for each node that takes one value per solution
//! native's, golden's and the real interpretation's value and the emulated raw word.

use cardan_compare::{Comparison, Node};

use super::table::{Cell, Kind, Table};
use crate::participants::diff::Collected;

/// The table of a comparison.
pub(super) fn table(comparison: &Comparison, collected: &Collected) -> Table {
    let nodes: Vec<&Node> = comparison
        .nodes
        .iter()
        .filter(|node| node.per_solution == 1)
        .collect();
    let mut table = Table::default();
    for (name, kind) in [
        ("solution", Kind::Whole),
        ("t_s", Kind::Real),
        ("flags", Kind::Whole),
        ("truth_yaw_deg", Kind::Real),
        ("truth_pitch_deg", Kind::Real),
        ("truth_roll_deg", Kind::Real),
    ] {
        table.column(name, kind);
    }
    for node in &nodes {
        for column in node_columns(&node.name) {
            table.column(&column, Kind::Real);
        }
    }
    for (solution, flags) in comparison.flags.iter().enumerate() {
        let truth = collected.truths.get(solution);
        let degrees = |radians: Option<f64>| Cell::real(radians.map(f64::to_degrees));
        let mut row = vec![
            Cell::Whole(solution as u64),
            Cell::real(truth.map(|truth| truth.time_s)),
            Cell::Whole((*flags).into()),
            degrees(truth.map(|truth| truth.yaw_rad)),
            degrees(truth.map(|truth| truth.pitch_rad)),
            degrees(truth.map(|truth| truth.roll_rad)),
        ];
        for node in &nodes {
            row.extend(node_cells(node, solution));
        }
        table.rows.push(row);
    }
    table
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
