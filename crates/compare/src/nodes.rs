//! One node: its range, its differences from the models, its bits, and whether it passes.

use serde::Serialize;

use crate::bits::BitComparison;
use crate::input::{Format, Node, NodeInput, OnOverflow};
use crate::limit::{most_bias, most_deviations, most_rms};
use crate::metrics::{Against, Difference, Limits, Pair, Rule, WRAPPING_UNIT, exceeds};
use crate::reason::Reason;

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
    /// Largest permitted difference; where it differs from value to value, scaled to the largest.
    pub tolerance: Option<f64>,
    /// Within the tolerance, equal bits, equal lengths.
    pub pass: bool,
    /// Why the tolerance is what it is.
    pub tolerance_reason: Option<String>,
    /// Values beyond the last complete solution, which are not judged against golden.
    pub unfinished: u64,
    /// What it is, in one line.
    pub meaning: String,
    /// The nodes whose values enter it.
    pub inputs: Vec<NodeInput>,
    /// What an overflow does to it.
    pub on_overflow: OnOverflow,
    /// The first value beyond its range by itself, in a solution without golden's status flags.
    pub first_overflow: Option<Occurrence>,
    /// What the table says of it.
    pub status: NodeStatus,
}

/// A node in one word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum NodeStatus {
    /// Nothing is wrong.
    Ok,
    /// It leaves its range and stays at the end, and nothing that is judged is wrong.
    Saturates,
    /// It leaves its range and wraps, which its unit does not do, and nothing that is judged is wrong.
    Wraps,
    /// Something is wrong.
    Fail,
}

/// A value that a node's format does not hold.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Occurrence {
    /// Index of the value in the node's stream.
    pub sample: usize,
    /// Index of the solution.
    pub solution: usize,
    /// The value of the same algorithm in f64.
    pub real: f64,
}

impl NodeReport {
    /// The comparison that the tolerance judges: golden where it knows the node, else real.
    #[must_use]
    pub fn judged(&self) -> Option<&Difference> {
        let golden = self.golden_vs_native.as_ref();
        // Golden may be there without judging.
        let judges = golden.filter(|golden| golden.used.is_some());
        judges.or(self.real_vs_native.as_ref()).or(golden)
    }
}

/// Reports a node and adds what is wrong with it to `reasons`; that it has no value to judge, which
/// follows from something else, to `unjudged`.
///
/// `flags` are both sides' status words together, `golden_flags` golden's alone: what the device flags for
/// an overflow of its own is no excuse for it.
pub(crate) fn report(
    node: &Node,
    flags: &[u16],
    golden_flags: &[u16],
    reasons: &mut Vec<Reason>,
    unjudged: &mut Vec<Reason>,
) -> NodeReport {
    let before = reasons.len() + unjudged.len();
    let on_overflow = node.on_overflow();
    let per_solution = node.per_solution.max(1);
    let compare = |values: &Option<Vec<f64>>, against: Against| {
        let rule = Rule {
            against,
            wrap: node.unit == WRAPPING_UNIT,
            lsb: node.lsb,
            per_solution,
            limit: limits(node, against, flags),
        };
        let pairs = |reference: &Vec<f64>| Difference::of(unflagged(node, reference, flags), rule);
        values.as_ref().map(pairs)
    };
    let golden_vs_native = compare(&node.golden, Against::Golden);
    let real_vs_native = compare(&node.real, Against::Real);
    let native_vs_emulated = node
        .emulated
        .as_ref()
        .map(|emulated| BitComparison::of(&node.native, emulated, per_solution));
    let finished = flags.len() * per_solution;
    let mut report = NodeReport {
        name: node.name.clone(),
        unit: node.unit.clone(),
        format: node.format.clone(),
        samples: node.native.len() as u64,
        min: node.native.iter().min().map(|&raw| raw as f64 * node.lsb),
        max: node.native.iter().max().map(|&raw| raw as f64 * node.lsb),
        meaning: node.meaning.clone(),
        inputs: node.inputs.clone(),
        overflows: node.overflows,
        on_overflow,
        first_overflow: first_overflow(node, golden_flags),
        status: NodeStatus::Ok,
        golden_vs_native,
        real_vs_native,
        native_vs_emulated,
        tolerance: None,
        pass: true,
        tolerance_reason: node
            .tolerance
            .as_ref()
            .or(node.tuned.as_ref())
            .or(node.allowance.as_ref())
            .map(|tolerance| tolerance.reason.clone()),
        unfinished: node.native.len().saturating_sub(finished) as u64,
    };
    report.tolerance = report.judged().and_then(|judged| judged.limit);
    check_lengths(node, finished, reasons);
    check_tolerance(node, &report, reasons, unjudged);
    check_bits(&report, reasons);
    report.pass = reasons.len() + unjudged.len() == before;
    report.status = match (report.pass, node.overflows, on_overflow) {
        (false, ..) => NodeStatus::Fail,
        (true, 0, _) | (true, _, OnOverflow::Turns) => NodeStatus::Ok,
        (true, _, OnOverflow::Saturates) => NodeStatus::Saturates,
        (true, _, OnOverflow::Wraps) => NodeStatus::Wraps,
    };
    report
}

/// The first word at an end of its range where the same algorithm in f64 is beyond that end: by itself, not
/// because what it is made of is wrong.
fn first_overflow(node: &Node, golden_flags: &[u16]) -> Option<Occurrence> {
    let (format, reals) = (node.format.as_ref()?, node.real.as_ref()?);
    if node.overflows == 0 || node.on_overflow() == OnOverflow::Turns {
        return None;
    }
    let (least, most) = format.raw_range();
    // Half a step beyond the end still rounds to it.
    let beyond = |real: f64| {
        let steps = real / node.lsb;
        steps >= most as f64 + 0.5 || steps < least as f64 - 0.5
    };
    let clean = |sample: usize| golden_flags.get(node.solution_of(sample)) == Some(&0);
    let (sample, &real) = reals
        .iter()
        .enumerate()
        .find(|&(sample, &real)| clean(sample) && beyond(real))?;
    Some(Occurrence {
        sample,
        solution: node.solution_of(sample),
        real,
    })
}

impl NodeReport {
    /// Its overflow as a reason to fail.
    pub(crate) fn overflow_reason(&self, lsb: f64) -> Option<Reason> {
        let (least, most) = self.format.as_ref()?.raw_range();
        Some(Reason::Overflows {
            node: self.name.clone(),
            unit: self.unit.clone(),
            count: self.overflows,
            does: self.on_overflow,
            range: (least as f64 * lsb, most as f64 * lsb),
            first: self.first_overflow.clone()?,
        })
    }
}

/// What judges a node: the tolerance that was set for it, or else what rounding explains, against
/// golden (where it has the node) and against the real interpretation.
fn limits(node: &Node, against: Against, flags: &[u16]) -> Limits {
    let unflagged = flags.iter().filter(|&&word| word == 0).count();
    let most = most_deviations(unflagged * node.per_solution.max(1));
    if let (Some(tuned), None) = (&node.tuned, &node.tolerance) {
        return match against {
            Against::Real => Limits::Absolute(tuned.max_abs),
            Against::Golden => Limits::None,
        };
    }
    match (&node.tolerance, against) {
        (Some(tolerance), Against::Real) if node.golden.is_none() => {
            Limits::Absolute(tolerance.max_abs)
        }
        (Some(tolerance), Against::Golden) => Limits::Absolute(tolerance.max_abs),
        (Some(_), Against::Real) => Limits::None,
        (None, _) if node.expected.is_none() => Limits::None,
        (None, Against::Real) => Limits::Expected {
            allowance: 0.0,
            most,
        },
        (None, Against::Golden) => match &node.allowance {
            Some(allowance) => Limits::Expected {
                allowance: allowance.max_abs,
                most,
            },
            None => Limits::None,
        },
    }
}

/// The values of solutions in which neither native nor golden set a status bit.
fn unflagged<'a>(
    node: &'a Node,
    reference: &'a [f64],
    flags: &'a [u16],
) -> impl Iterator<Item = Pair> + 'a {
    let expected = |sample: usize| {
        let all = node.expected.as_ref()?;
        all.get(sample).copied()
    };
    let pairs = reference.iter().zip(&node.native).enumerate();
    pairs
        .filter(|(sample, _)| flags.get(node.solution_of(*sample)) == Some(&0))
        .map(move |(sample, (&reference, &raw))| Pair {
            sample,
            reference,
            native: raw as f64 * node.lsb,
            expectation: expected(sample).unwrap_or_default(),
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

fn check_tolerance(
    node: &Node,
    report: &NodeReport,
    reasons: &mut Vec<Reason>,
    unjudged: &mut Vec<Reason>,
) {
    let comparisons = [
        ("golden", &report.golden_vs_native),
        ("real", &report.real_vs_native),
    ];
    for (against, comparison) in comparisons {
        let Some(difference) = comparison else {
            continue;
        };
        check_difference(report, against, difference, reasons);
    }
    let is_judged = comparisons.iter().any(|(_, comparison)| {
        comparison
            .as_ref()
            .is_some_and(|found| found.used.is_some())
    });
    if !is_judged && (node.tolerance.is_some() || node.expected.is_some()) {
        unjudged.push(Reason::NothingJudged {
            node: report.name.clone(),
        });
    }
}

fn check_difference(
    report: &NodeReport,
    against: &'static str,
    difference: &Difference,
    reasons: &mut Vec<Reason>,
) {
    if let (Some(first), Some(max_abs)) = (&difference.first_violation, difference.max_abs) {
        reasons.push(Reason::ToleranceMissed {
            node: report.name.clone(),
            unit: report.unit.clone(),
            against,
            max_abs,
            tolerance: difference.limit.unwrap_or_default(),
            first: first.clone(),
        });
        return;
    }
    let Some(normalised) = difference.normalised else {
        return;
    };
    let count = normalised.samples as usize;
    for (statistic, value, limit) in [
        ("root mean square", normalised.rms, most_rms(count)),
        ("mean", normalised.bias.abs(), most_bias(count)),
    ] {
        if exceeds(value, limit) {
            reasons.push(Reason::NotRounding {
                node: report.name.clone(),
                against,
                statistic,
                value,
                limit,
            });
        }
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
