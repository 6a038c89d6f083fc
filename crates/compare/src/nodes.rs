//! One node: its range, its differences from the models, its bits, and whether it passes.

use serde::Serialize;

use crate::bits::BitComparison;
use crate::input::{Format, Node};
use crate::metrics::{Against, Difference, Pair, Rule, WRAPPING_UNIT};
use crate::verdict::Reason;

/// A node in the report.
#[derive(Clone, Debug, Serialize)]
pub struct NodeReport {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// The deployed format.
    pub format: Option<Format>,
    /// Values that native wrote.
    pub samples: u64,
    /// Smallest of them, in the unit.
    pub min: Option<f64>,
    /// Largest of them.
    pub max: Option<f64>,
    /// Overflows that native counted.
    pub overflows: u64,
    /// Native against golden on the same codes, over solutions without status flags.
    pub golden_vs_native: Option<Difference>,
    /// Native against the same algorithm in f64, over solutions without status flags.
    pub real_vs_native: Option<Difference>,
    /// Native against emulated, every value; `None` for an image without taps.
    pub native_vs_emulated: Option<BitComparison>,
    /// Largest permitted difference.
    pub tolerance: Option<f64>,
    /// Within the tolerance, equal bits, equal lengths.
    pub pass: bool,
    /// Why the tolerance is what it is.
    pub tolerance_reason: Option<String>,
    /// Values beyond the last complete solution, which are not judged against golden.
    pub unfinished: u64,
}

impl NodeReport {
    /// The comparison that the tolerance judges: golden where it knows the node, else real.
    #[must_use]
    pub fn judged(&self) -> Option<&Difference> {
        self.golden_vs_native
            .as_ref()
            .or(self.real_vs_native.as_ref())
    }
}

/// Reports a node and adds what is wrong with it to `reasons`.
pub(crate) fn report(node: &Node, flags: &[u16], reasons: &mut Vec<Reason>) -> NodeReport {
    let before = reasons.len();
    let judged = if node.golden.is_some() {
        Against::Golden
    } else {
        Against::Real
    };
    let compare = |values: &Option<Vec<f64>>, against: Against| {
        let rule = Rule {
            against,
            wrap: node.unit == WRAPPING_UNIT,
            lsb: node.lsb,
            per_solution: node.per_solution.max(1),
            tolerance: node
                .tolerance
                .as_ref()
                .filter(|_| judged == against)
                .map(|tolerance| tolerance.max_abs),
        };
        let pairs = |reference: &Vec<f64>| Difference::of(unflagged(node, reference, flags), rule);
        values.as_ref().map(pairs)
    };
    let golden_vs_native = compare(&node.golden, Against::Golden);
    let real_vs_native = compare(&node.real, Against::Real);
    let native_vs_emulated = node
        .emulated
        .as_ref()
        .map(|emulated| BitComparison::of(&node.native, emulated, node.per_solution.max(1)));
    let finished = flags.len() * node.per_solution.max(1);
    let mut report = NodeReport {
        name: node.name.clone(),
        unit: node.unit.clone(),
        format: node.format.clone(),
        samples: node.native.len() as u64,
        min: node.native.iter().min().map(|&raw| raw as f64 * node.lsb),
        max: node.native.iter().max().map(|&raw| raw as f64 * node.lsb),
        overflows: node.overflows,
        golden_vs_native,
        real_vs_native,
        native_vs_emulated,
        tolerance: node.tolerance.as_ref().map(|tolerance| tolerance.max_abs),
        pass: true,
        tolerance_reason: node
            .tolerance
            .as_ref()
            .map(|tolerance| tolerance.reason.clone()),
        unfinished: node.native.len().saturating_sub(finished) as u64,
    };
    check_lengths(node, finished, reasons);
    check_tolerance(&report, judged, reasons);
    check_bits(&report, reasons);
    report.pass = reasons.len() == before;
    report
}

/// The values of solutions without status flags.
fn unflagged<'a>(
    node: &'a Node,
    reference: &'a [f64],
    flags: &'a [u16],
) -> impl Iterator<Item = Pair> + 'a {
    let pairs = reference.iter().zip(&node.native).enumerate();
    pairs
        .filter(|(sample, _)| flags.get(node.solution_of(*sample)) == Some(&0))
        .map(|(sample, (&reference, &raw))| Pair {
            sample,
            reference,
            native: raw as f64 * node.lsb,
        })
}

fn check_lengths(node: &Node, finished: usize, reasons: &mut Vec<Reason>) {
    let native = node.native.len();
    if native < finished {
        reasons.push(Reason::LengthsDiffer {
            what: format!("node {}", node.name),
            names: ["native's solutions", "native"],
            lengths: [finished, native],
        });
    }
    let others = [
        ("golden", node.golden.as_ref().map(Vec::len)),
        ("real", node.real.as_ref().map(Vec::len)),
        ("emulated", node.emulated.as_ref().map(Vec::len)),
    ];
    for (name, length) in others {
        if let Some(length) = length
            && length != native
        {
            reasons.push(Reason::LengthsDiffer {
                what: format!("node {}", node.name),
                names: ["native", name],
                lengths: [native, length],
            });
        }
    }
}

fn check_tolerance(report: &NodeReport, against: Against, reasons: &mut Vec<Reason>) {
    let Some(tolerance) = report.tolerance else {
        return;
    };
    let Some((difference, max_abs)) = report
        .judged()
        .and_then(|difference| Some((difference, difference.max_abs?)))
    else {
        reasons.push(Reason::NothingJudged {
            node: report.name.clone(),
        });
        return;
    };
    if let Some(first) = &difference.first_violation {
        reasons.push(Reason::ToleranceMissed {
            node: report.name.clone(),
            unit: report.unit.clone(),
            against: match against {
                Against::Golden => "golden",
                Against::Real => "real",
            },
            max_abs,
            tolerance,
            first: first.clone(),
        });
    }
}

fn check_bits(report: &NodeReport, reasons: &mut Vec<Reason>) {
    let Some(bits) = &report.native_vs_emulated else {
        return;
    };
    if let Some(first) = &bits.first_mismatch {
        reasons.push(Reason::BitsDiffer {
            node: report.name.clone(),
            mismatches: bits.mismatches,
            compared: bits.compared,
            first: first.clone(),
        });
    }
}
