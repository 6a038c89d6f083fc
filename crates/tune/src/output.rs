//! What a result is written as: a word-length file with its reasons, the front as CSV, a page.

use std::fmt::Write as _;

use cardan_datapath::{Format, NodeInfo};

use crate::outcome::Outcome;

/// A word-length file of the result, with range, margin and share of the error of each node.
#[must_use]
pub fn wordlengths(outcome: &Outcome, nodes: &[NodeInfo], command: &str) -> String {
    let mut out = format!("# Word lengths tuned with: {command}\n");
    for reached in &outcome.best.reached {
        if let Some(value) = reached.value {
            let _ = writeln!(out, "# {}: reached {value:.4e}", reached.constraint);
        }
    }
    let bits = outcome.best.bits;
    let _ = writeln!(
        out,
        "# {bits} bits in all; uniform 32 bit: {}, best uniform: {}",
        outcome.baseline.bits,
        outcome
            .best_uniform
            .as_ref()
            .map_or("none".into(), |uniform| uniform.bits.to_string())
    );
    for (at, (node, (_, format))) in nodes.iter().zip(&outcome.best.formats.0).enumerate() {
        let _ = write!(
            out,
            "\n[[node]]\nname = {:?}\nunit = {:?}\nword = {}{}\nfrac = {}{}\nrounding = \"{}\"\noverflow = \"{}\"\n",
            node.name,
            node.unit,
            format.word,
            range_comment(outcome, at, *format),
            format.frac,
            share_comment(outcome, node.name),
            format.rounding.name(),
            format.overflow.name()
        );
    }
    out
}

/// The range of a node and how much of its word is left above it.
fn range_comment(outcome: &Outcome, node: usize, format: Format) -> String {
    let Some(range) = outcome.ranges.get(node) else {
        return String::new();
    };
    let (Some(min), Some(max)) = (range.min, range.max) else {
        return String::new();
    };
    let size = min.abs().max(max.abs());
    let whole = format.real(format.max_raw());
    let margin = if size > 0.0 {
        format!(", margin {:.1} bit", libm::log2(whole / size))
    } else {
        String::new()
    };
    let proven = if range.proven { ", proven" } else { "" };
    format!("  # range {min:.4} to {max:.4}{margin}{proven}")
}

/// The largest share of an output's rounding error.
fn share_comment(outcome: &Outcome, name: &str) -> String {
    let own = outcome
        .sensitivities
        .iter()
        .filter(|noise| noise.node == name);
    let largest = own.max_by(|a, b| a.share.total_cmp(&b.share));
    match largest {
        Some(noise) if noise.share > 0.0005 => {
            format!(
                "  # {:.1} % of the error of {}",
                noise.share * 100.0,
                noise.quantity
            )
        }
        _ => String::new(),
    }
}

/// The front as CSV.
#[must_use]
pub fn front_csv(outcome: &Outcome) -> String {
    let mut out = String::from("limit_factor,bits,cost,error\n");
    for point in &outcome.pareto {
        let error = point.error.map_or(String::new(), |error| error.to_string());
        let _ = writeln!(
            out,
            "{},{},{},{error}",
            point.limit_factor, point.bits, point.cost
        );
    }
    out
}
