//! Which reason is named first: the cause, as far as the data flow tells, not the table's first row.
//!
//! A node fails because of itself unless a node that it is made of failed before it: in an earlier solution,
//! or in the same one at an earlier place of the data flow. Nodes without such an ancestor come first, the
//! earliest of them at the head; what follows from them comes after.

use std::collections::{BTreeMap, BTreeSet};

use crate::input::{Comparison, Node, OnOverflow};
use crate::nodes::NodeReport;
use crate::reason::Reason;

/// When and where a node fails: solution (none for statistics over the whole run) and place in the data flow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct At {
    solution: Option<usize>,
    position: usize,
}

impl At {
    /// True if what fails here may be why `other`, further down, fails.
    fn may_cause(self, other: Self) -> bool {
        match (self.solution, other.solution) {
            (None, None) => self.position < other.position,
            (None, Some(_)) | (Some(_), None) => true,
            (Some(_), Some(_)) => self < other,
        }
    }
}

/// The reasons of all nodes, causes first. Native against the models comes before native against emulated:
/// what both compute wrongly is told before what one of them does.
pub(crate) fn in_order(
    nodes: &[Node],
    reports: &[NodeReport],
    failures: Vec<Vec<Reason>>,
) -> Vec<Reason> {
    let (mut values, mut bits) = (Vec::new(), Vec::new());
    for (index, own) in failures.into_iter().enumerate() {
        let (of_bits, mut of_values): (Vec<Reason>, Vec<Reason>) =
            own.into_iter().partition(is_of_bits);
        // What a node does beyond its range explains what it differs by.
        if !of_values.is_empty()
            && let Some(overflow) = reports[index].overflow_reason(nodes[index].lsb)
        {
            of_values.insert(0, overflow);
        }
        values.push(of_values);
        bits.push(of_bits);
    }
    let ancestors = Ancestors::of(nodes);
    let mut all = sorted(nodes, values, &ancestors);
    all.extend(sorted(nodes, bits, &ancestors));
    all
}

/// Nodes of which neither they nor anything that they are made of left its range in the run: rounding alone
/// explains what they are, in every solution.
pub(crate) fn within_range(nodes: &[Node]) -> Vec<bool> {
    let ancestors = Ancestors::of(nodes);
    let leaves = |node: &Node| node.overflows > 0 && node.on_overflow() != OnOverflow::Turns;
    let leaving: Vec<usize> = (0..nodes.len()).filter(|&at| leaves(&nodes[at])).collect();
    let is_within = |at: usize| {
        let follows = |&other: &usize| other == at || ancestors.has(at, other);
        !leaving.iter().any(follows)
    };
    (0..nodes.len()).map(is_within).collect()
}

/// Where nothing else says so: a node that saturates, and is not judged, in a run that fails.
pub(crate) fn add_unjudged_overflows(
    nodes: &[Node],
    reports: &[NodeReport],
    reasons: &mut Vec<Reason>,
) {
    if reasons.is_empty() {
        return;
    }
    let is_judged = |report: &NodeReport| {
        let judged = [&report.golden_vs_native, &report.real_vs_native];
        judged
            .into_iter()
            .flatten()
            .any(|found| found.used.is_some())
    };
    let unjudged = |(node, report): (&Node, &NodeReport)| {
        (!is_judged(report))
            .then(|| report.overflow_reason(node.lsb))
            .flatten()
    };
    let found: Vec<Vec<Reason>> = nodes
        .iter()
        .zip(reports)
        .map(|pair| unjudged(pair).into_iter().collect())
        .collect();
    let found = sorted(nodes, found, &Ancestors::of(nodes));
    let place = reasons
        .iter()
        .position(|reason| is_of_node(reason) || is_late(reason));
    let place = place.unwrap_or(reasons.len());
    reasons.splice(place..place, found);
}

/// An image of other sources explains what the comparison of it with this program's firmware finds.
pub(crate) fn put_stale_first(comparison: &Comparison, reasons: &mut Vec<Reason>) {
    if let Some(what) = &comparison.stale
        && !reasons.is_empty()
    {
        reasons.insert(0, Reason::Stale(what.clone()));
    }
}

fn is_of_bits(reason: &Reason) -> bool {
    match reason {
        Reason::BitsDiffer { .. } => true,
        Reason::LengthsDiffer { names, .. } => names.iter().any(|name| name == "emulated"),
        _ => false,
    }
}

fn is_of_node(reason: &Reason) -> bool {
    matches!(
        reason,
        Reason::ToleranceMissed { .. }
            | Reason::NotRounding { .. }
            | Reason::NothingJudged { .. }
            | Reason::BitsDiffer { .. }
            | Reason::Overflows { .. }
    )
}

/// What follows from values: frames, status bits, figures of the whole run.
fn is_late(reason: &Reason) -> bool {
    matches!(
        reason,
        Reason::FramesDiffer { .. }
            | Reason::StatusDiffers { .. }
            | Reason::StatusDoubtful { .. }
            | Reason::TooManyFlagged { .. }
            | Reason::CompiledDiffers { .. }
            | Reason::TruthMissed { .. }
            | Reason::NoTruth { .. }
            | Reason::BudgetOpen { .. }
    )
}

/// Solution and sample in which it first shows; none for statistics of the whole run.
fn first_shown(reason: &Reason) -> Option<(usize, usize)> {
    match reason {
        Reason::ToleranceMissed { first, .. } => Some((first.solution, first.sample)),
        Reason::BitsDiffer { first, .. } => Some((first.solution, first.sample)),
        Reason::Overflows { first, .. } => Some((first.solution, first.sample)),
        _ => None,
    }
}

/// Where a node's first failure lies. A node that is used several times in a solution has a place for each
/// of its writes.
fn place(node: &Node, index: usize, own: &[Reason]) -> At {
    let shown = own.iter().filter_map(first_shown).min();
    let of_write = shown.and_then(|(_, sample)| {
        let known = node.writes.len() == node.per_solution.max(1);
        known.then(|| node.writes[sample % node.writes.len()])
    });
    let first = node.writes.first().copied().or(node.position);
    At {
        solution: shown.map(|(solution, _)| solution),
        position: of_write.or(first).unwrap_or(index),
    }
}

/// Causes in the order of their appearance, then what follows from them.
fn sorted(nodes: &[Node], failures: Vec<Vec<Reason>>, ancestors: &Ancestors) -> Vec<Reason> {
    let mut failing: Vec<(usize, At, Vec<Reason>)> = Vec::new();
    for (index, own) in failures.into_iter().enumerate() {
        if !own.is_empty() {
            let at = place(&nodes[index], index, &own);
            failing.push((index, at, own));
        }
    }
    let places: Vec<(usize, At)> = failing.iter().map(|(index, at, _)| (*index, *at)).collect();
    let follows = |index: usize, at: At| {
        let before = |&(other, earlier): &(usize, At)| {
            other != index && earlier.may_cause(at) && ancestors.has(index, other)
        };
        places.iter().any(before)
    };
    failing.sort_by_key(|(index, at, _)| (follows(*index, *at), *at));
    failing.into_iter().flat_map(|(_, _, own)| own).collect()
}

/// Per node, all nodes that it is made of.
struct Ancestors(Vec<BTreeSet<usize>>);

impl Ancestors {
    fn of(nodes: &[Node]) -> Self {
        let index: BTreeMap<&str, usize> = nodes
            .iter()
            .enumerate()
            .map(|(index, node)| (node.name.as_str(), index))
            .collect();
        let parents: Vec<Vec<usize>> = nodes
            .iter()
            .map(|node| {
                let inputs = node.inputs.iter();
                inputs
                    .filter_map(|input| index.get(input.node.as_str()).copied())
                    .collect()
            })
            .collect();
        let all = (0..nodes.len()).map(|node| {
            let mut found = BTreeSet::new();
            let mut open = vec![node];
            while let Some(next) = open.pop() {
                open.extend(parents[next].iter().filter(|&&parent| found.insert(parent)));
            }
            found
        });
        Self(all.collect())
    }

    fn has(&self, node: usize, ancestor: usize) -> bool {
        self.0[node].contains(&ancestor)
    }
}
