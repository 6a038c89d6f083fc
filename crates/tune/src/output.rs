//! What a result is written as: a word-length file with its reasons, the front as CSV, a page.

use std::fmt::Write as _;

use cardan_datapath::wordlengths::Tuned;
use cardan_datapath::{Format, NodeInfo};

use crate::outcome::{Outcome, Statistics};

/// A word-length file of the result: what it was tuned to and on, then the nodes with range, margin
/// and share of the error of each.
#[must_use]
pub fn wordlengths(outcome: &Outcome, nodes: &[NodeInfo], command: &str) -> String {
    let mut out = header(outcome, command);
    out.push('\n');
    out.push_str(&tuned_table(outcome, command));
    for (at, (node, (_, format))) in nodes.iter().zip(&outcome.best.formats.0).enumerate() {
        let _ = write!(
            out,
            "\n[[node]]\nname = {:?}\n{}unit = {:?}\nword = {}{}\nfrac = {}{}\nrounding = \"{}\"\noverflow = \"{}\"\n",
            node.name,
            meaning_line(node.meaning),
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

/// The first lines: what was reached, in words.
pub(crate) fn header(outcome: &Outcome, command: &str) -> String {
    let mut out = format!("# Word lengths tuned with: {command}\n");
    if !outcome.verified {
        out.push_str("# NOT VERIFIED: the budget does not hold on all runs that were looked at\n");
    }
    for reached in &outcome.best.reached {
        if let Some(value) = reached.value {
            let _ = writeln!(out, "# {}: reached {value:.4e}", reached.constraint);
        }
    }
    let bits = outcome.best.bits;
    let _ = writeln!(
        out,
        "# {bits} bits in all; uniform 32 bit: {}, best uniform: {}\n\
         # proven: no inputs within the assumptions below make the node overflow in these formats",
        outcome.baseline.bits,
        outcome
            .best_uniform
            .as_ref()
            .map_or("none".into(), |uniform| uniform.bits.to_string())
    );
    out
}

/// The line that says what a node is; none where nothing does.
fn meaning_line(meaning: &str) -> String {
    match meaning {
        "" => String::new(),
        meaning => format!("meaning = {}\n", toml::Value::from(meaning)),
    }
}

/// The result as the table `[tuned]` of its word-length file.
#[must_use]
pub fn tuned_to(outcome: &Outcome, command: &str) -> Tuned {
    let named = |held_out: bool| {
        let own = outcome
            .verification
            .iter()
            .filter(|case| case.held_out == held_out);
        own.map(|case| case.case.clone()).collect()
    };
    let reached = &outcome.best.reached;
    let statistics = outcome.statistics.as_ref().filter(|_| outcome.verified);
    Tuned {
        command: command.to_owned(),
        budget: reached.iter().map(|one| one.constraint.clone()).collect(),
        reached: reached
            .iter()
            .map(|one| one.value.unwrap_or(f64::NAN))
            .collect(),
        tuned_on: named(false),
        verified_on: named(true),
        verified: outcome.verified,
        confidence: statistics.map_or(0.0, |found| found.confidence),
        content: statistics.map_or(0.0, |found| found.content),
        assumptions: outcome.assumptions.clone(),
        tolerance: outcome.tolerances.clone(),
    }
}

/// The table `[tuned]` as text.
pub(crate) fn tuned_table(outcome: &Outcome, command: &str) -> String {
    #[derive(serde::Serialize)]
    struct Table {
        tuned: Tuned,
    }
    let tuned = tuned_to(outcome, command);
    // Names, numbers and texts are all that it holds: TOML has a form for each.
    toml::to_string(&Table { tuned }).unwrap_or_default()
}

/// The range of a node and how much of its word is left above it.
pub(crate) fn range_comment(outcome: &Outcome, node: usize, format: Format) -> String {
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
    let is_proven = outcome.proven.contains(&range.name);
    let proven = if is_proven { ", proven" } else { "" };
    format!("  # range {min:.4} to {max:.4}{margin}{proven}")
}

/// The largest share of an output's rounding error.
pub(crate) fn share_comment(outcome: &Outcome, name: &str) -> String {
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

/// The statistics of fresh runs in words.
#[must_use]
pub fn told(found: &Statistics) -> String {
    let mut out = format!(
        "{} of {} fresh runs hold (round {})",
        found.holding, found.runs, found.rounds
    );
    for stretch in &found.stretches {
        let _ = write!(
            out,
            "; {}: {:.3} of the limit, deviation {:.3}, bound {:.3}",
            stretch.constraint, stretch.mean, stretch.deviation, stretch.bound
        );
    }
    let (content, confidence) = (100.0 * found.content, 100.0 * found.confidence);
    let _ = if found.by_count {
        write!(
            out,
            ". So many that hold without exception show with {confidence:.0} % confidence, over all \
             rounds, that {content:.0} % of all such runs do (no model of how they scatter)."
        )
    } else {
        write!(
            out,
            ". Bounds are not exceeded by {content:.0} % of all such runs with {confidence:.0} % \
             confidence (normal tolerance limit, factor {:.2}).",
            found.factor
        )
    };
    out
}
