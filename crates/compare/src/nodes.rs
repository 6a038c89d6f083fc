//! One node: its range, its differences from the models, its bits, and whether it passes.

use serde::Serialize;

use crate::bits::{BitComparison, Bits};
use crate::input::{Format, Node, NodeInput, OnOverflow};
use crate::limit::{most_bias, most_deviations, most_rms};
use crate::metrics::{
    Against, Difference, Differences, Limits, Pair, Rule, WRAPPING_UNIT, exceeds,
};
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

/// Looks at a node's values, window by window.
#[derive(Debug)]
pub(crate) struct NodeJudge {
    golden: Option<Differences>,
    real: Option<Differences>,
    /// Native against real in solutions with status bits. They count where nothing that the node is made of
    /// leaves its range.
    flagged: Option<Differences>,
    bits: Option<Bits>,
    range: Option<(i64, i64)>,
    first_overflow: Option<Occurrence>,
    /// How often native's word was another than the last: words that stand still tell nothing new.
    changes: usize,
    last: Option<i64>,
    /// Values of native, golden, real, emulated and of what is expected so far.
    lengths: [usize; 5],
}

/// Status words of the solutions of a window.
#[derive(Clone, Copy)]
pub(crate) struct Flags<'a> {
    /// Native's and golden's together.
    pub(crate) either: &'a [u32],
    /// Golden's alone: what the device flags for an overflow of its own is no excuse for it.
    pub(crate) golden: &'a [u32],
}

impl NodeJudge {
    /// `judged` is the number of solutions by which limits are set.
    pub(crate) fn new(node: &Node, judged: usize) -> Self {
        let differences = |against: Against| {
            Differences::new(Rule {
                against,
                wrap: node.unit == WRAPPING_UNIT,
                lsb: node.lsb,
                per_solution: node.per_solution.max(1),
                limit: limits(node, against, judged),
            })
        };
        Self {
            golden: node.golden.as_ref().map(|_| differences(Against::Golden)),
            real: node.real.as_ref().map(|_| differences(Against::Real)),
            flagged: node.real.as_ref().map(|_| differences(Against::Real)),
            bits: node.emulated.as_ref().map(|_| Bits::default()),
            range: None,
            first_overflow: None,
            changes: 0,
            last: None,
            lengths: [0; 5],
        }
    }

    /// Adds a window of the node, in which all its streams begin at the same value; `shown` takes the
    /// differences that are drawn: value of the window and difference.
    pub(crate) fn add(&mut self, node: &Node, flags: Flags<'_>, mut shown: impl FnMut(usize, f64)) {
        let per_solution = node.per_solution.max(1);
        let before = self.lengths[0];
        for &word in &node.native {
            self.changes += usize::from(self.last.replace(word) != Some(word));
        }
        if let (Some(least), Some(most)) = (node.native.iter().min(), node.native.iter().max()) {
            let (low, high) = self.range.unwrap_or((*least, *most));
            self.range = Some((low.min(*least), high.max(*most)));
        }
        let draws_golden = self.golden.is_some();
        let sides = [
            (&mut self.golden, &node.golden, true),
            (&mut self.real, &node.real, !draws_golden),
        ];
        for (found, reference, is_drawn) in sides {
            let (Some(found), Some(reference)) = (found, reference) else {
                continue;
            };
            for (at, pair) in of_solutions(node, reference, flags.either, true) {
                let sample = before + at;
                let difference = found.add(Pair { sample, ..pair });
                if is_drawn {
                    shown(at, difference);
                }
            }
        }
        if let (Some(found), Some(real)) = (&mut self.flagged, &node.real) {
            for (at, pair) in of_solutions(node, real, flags.either, false) {
                let sample = before + at;
                found.add(Pair { sample, ..pair });
            }
        }
        if let (Some(bits), Some(emulated)) = (&mut self.bits, &node.emulated) {
            bits.add(&node.native, emulated, per_solution);
        }
        if self.first_overflow.is_none() {
            self.first_overflow = first_overflow(node, flags.golden).map(|found| Occurrence {
                sample: before + found.sample,
                solution: (before + found.sample) / per_solution,
                ..found
            });
        }
        let count = |values: &Option<Vec<f64>>| values.as_ref().map_or(0, Vec::len);
        let emulated = node.emulated.as_ref().map_or(0, Vec::len);
        let expected = node.expected.as_ref().map_or(0, Vec::len);
        let (golden, real) = (count(&node.golden), count(&node.real));
        let added = [node.native.len(), golden, real, emulated, expected];
        for (length, added) in self.lengths.iter_mut().zip(added) {
            *length += added;
        }
    }

    /// Values over their expected deviations: their number and the sum of their squares.
    pub(crate) fn normalised(&self) -> (u64, f64) {
        let found = self.real.as_ref().and_then(|real| real.found().normalised);
        found.map_or((0, 0.0), |found| {
            (found.samples, found.samples as f64 * found.rms * found.rms)
        })
    }

    /// What is wrong in solutions with status bits.
    pub(crate) fn check_flagged(&self, report: &NodeReport, reasons: &mut Vec<Reason>) {
        let Some(found) = self.flagged.as_ref().map(Differences::found) else {
            return;
        };
        if let (Some(first), Some(max_abs)) = (&found.first_violation, found.max_abs) {
            reasons.push(Reason::ToleranceMissed {
                node: report.name.clone(),
                unit: report.unit.clone(),
                against: "real",
                max_abs,
                tolerance: found.limit.unwrap_or_default(),
                first: first.clone(),
            });
        }
    }

    /// The report, of `solutions`; what is wrong goes to `reasons`; that the node has no value to judge, which
    /// follows from something else, to `unjudged`.
    pub(crate) fn report(
        &self,
        node: &Node,
        solutions: usize,
        reasons: &mut Vec<Reason>,
        unjudged: &mut Vec<Reason>,
    ) -> NodeReport {
        let before = reasons.len() + unjudged.len();
        let on_overflow = node.on_overflow();
        let finished = solutions * node.per_solution.max(1);
        let has_overflow = node.overflows > 0 && on_overflow != OnOverflow::Turns;
        let mut report = NodeReport {
            name: node.name.clone(),
            unit: node.unit.clone(),
            format: node.format.clone(),
            samples: self.lengths[0] as u64,
            min: self.range.map(|(least, _)| least as f64 * node.lsb),
            max: self.range.map(|(_, most)| most as f64 * node.lsb),
            meaning: node.meaning.clone(),
            inputs: node.inputs.clone(),
            overflows: node.overflows,
            on_overflow,
            first_overflow: self.first_overflow.clone().filter(|_| has_overflow),
            status: NodeStatus::Ok,
            golden_vs_native: self.golden.as_ref().map(Differences::found),
            real_vs_native: self.real.as_ref().map(Differences::found),
            native_vs_emulated: self.bits.as_ref().map(Bits::found),
            tolerance: None,
            pass: true,
            tolerance_reason: node
                .tolerance
                .as_ref()
                .or(node.tuned.as_ref())
                .or(node.allowance.as_ref())
                .map(|tolerance| tolerance.reason.clone()),
            unfinished: self.lengths[0].saturating_sub(finished) as u64,
        };
        report.tolerance = report.judged().and_then(|judged| judged.limit);
        self.check_lengths(node, finished, reasons);
        check_tolerance(node, &report, self.changes, reasons, unjudged);
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

    fn check_lengths(&self, node: &Node, finished: usize, reasons: &mut Vec<Reason>) {
        let [native, golden, real, emulated, expected] = self.lengths;
        let what = || format!("node {}", node.name);
        if native < finished {
            reasons.push(Reason::LengthsDiffer {
                what: what(),
                names: ["native's solutions".into(), "native".into()],
                lengths: [finished, native],
            });
        }
        let others = [
            ("golden", golden, node.golden.is_some()),
            ("real", real, node.real.is_some()),
            ("emulated", emulated, node.emulated.is_some()),
            ("what rounding explains", expected, node.expected.is_some()),
        ];
        for (name, length, exists) in others {
            if exists && length != native {
                reasons.push(Reason::LengthsDiffer {
                    what: what(),
                    names: ["native".into(), name.into()],
                    lengths: [native, length],
                });
            }
        }
    }
}

/// The first word at an end of its range where the same algorithm in f64 is beyond that end: by itself, not
/// because what it is made of is wrong.
fn first_overflow(node: &Node, golden_flags: &[u32]) -> Option<Occurrence> {
    let (format, reals) = (node.format.as_ref()?, node.real.as_ref()?);
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
fn limits(node: &Node, against: Against, judged: usize) -> Limits {
    let most = most_deviations(judged * node.per_solution.max(1));
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

/// The values of solutions in which neither native nor golden set a status bit, or of the others, with their
/// places in the window.
fn of_solutions<'a>(
    node: &'a Node,
    reference: &'a [f64],
    flags: &'a [u32],
    are_clean: bool,
) -> impl Iterator<Item = (usize, Pair)> + 'a {
    let expected = |sample: usize| {
        let all = node.expected.as_ref()?;
        all.get(sample).copied()
    };
    let pairs = reference.iter().zip(&node.native).enumerate();
    pairs
        .filter(move |(sample, _)| {
            let word = flags.get(node.solution_of(*sample));
            word.is_some_and(|&word| (word == 0) == are_clean)
        })
        .map(move |(sample, (&reference, &raw))| {
            let pair = Pair {
                sample,
                reference,
                native: raw as f64 * node.lsb,
                expectation: expected(sample).unwrap_or_default(),
            };
            (sample, pair)
        })
}

fn check_tolerance(
    node: &Node,
    report: &NodeReport,
    changes: usize,
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
        let normalised = difference
            .normalised
            .map_or(0, |found| found.samples as usize);
        let solutions = normalised.min(changes).div_ceil(node.per_solution.max(1));
        check_difference(report, against, difference, solutions, reasons);
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

/// Half a place, and f64's own rounding.
const NEAREST: f64 = 0.5 + 1e-9;

fn check_difference(
    report: &NodeReport,
    against: &'static str,
    difference: &Difference,
    solutions: usize,
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
    // Half a place at most is the nearest word that there is: nothing can be wrong with that, however the
    // errors are distributed (averages of 128 odd codes end in a tie each time).
    if difference.max_lsb.is_some_and(|most| most <= NEAREST) {
        return;
    }
    for (statistic, value, limit) in [
        ("root mean square", normalised.rms, most_rms(solutions)),
        ("mean", normalised.bias.abs(), most_bias(solutions)),
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
