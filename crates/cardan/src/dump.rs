//! Node values of every solution as CSV, for other tools.

use std::fmt::Write as _;
use std::path::Path;

use cardan_compare::{Comparison, Node};

use crate::failure::Failure;
use crate::files::write_whole;
use crate::participants::diff::Collected;

/// Writes one row per solution: time, truth, status, and for each node that takes one value per
/// solution native's, golden's and the real interpretation's value and the emulated raw word.
pub(crate) fn write(
    comparison: &Comparison,
    collected: &Collected,
    file: &Path,
) -> Result<(), Failure> {
    let nodes: Vec<&Node> = comparison
        .nodes
        .iter()
        .filter(|node| node.per_solution == 1)
        .collect();
    let mut text = String::from("solution,t_s,flags,truth_yaw_deg,truth_pitch_deg,truth_roll_deg");
    for node in &nodes {
        let name = &node.name;
        let _ = write!(
            text,
            ",{name}_native,{name}_emulated_raw,{name}_golden,{name}_real"
        );
    }
    text.push('\n');
    for (solution, flags) in comparison.flags.iter().enumerate() {
        let truth = collected.truths.get(solution);
        let number = |value: Option<f64>| {
            value
                .filter(|value| value.is_finite())
                .map_or_else(String::new, |v| v.to_string())
        };
        let degrees = |radians: Option<f64>| number(radians.map(f64::to_degrees));
        let _ = write!(
            text,
            "{solution},{},{flags},{},{},{}",
            number(truth.map(|truth| truth.time_s)),
            degrees(truth.map(|truth| truth.yaw_rad)),
            degrees(truth.map(|truth| truth.pitch_rad)),
            degrees(truth.map(|truth| truth.roll_rad)),
        );
        for node in &nodes {
            let real = |values: &Option<Vec<f64>>| {
                number(
                    values
                        .as_ref()
                        .and_then(|values| values.get(solution).copied()),
                )
            };
            let raw = node.emulated.as_ref().and_then(|words| words.get(solution));
            let _ = write!(
                text,
                ",{},{},{},{}",
                number(node.native.get(solution).map(|&raw| raw as f64 * node.lsb)),
                raw.map_or_else(String::new, ToString::to_string),
                real(&node.golden),
                real(&node.real),
            );
        }
        text.push('\n');
    }
    write_whole(file, text)
}
