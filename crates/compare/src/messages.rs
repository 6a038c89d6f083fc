//! What the product sends, against the reference: every message is decoded on the golden side and its
//! number, its values and each of its status bits are held against golden's own.

use cardan_outputs::{Message, Quantity};
use serde::Serialize;

use crate::bits::FrameComparison;
use crate::input::{Comparison, Node};
use crate::limit::most_deviations;
use crate::metrics::exceeds;
use crate::reason::Reason;

/// Share of the solutions in which rounding may decide a status bit, which is not judged there. A bit
/// with a memory stays open for as long as that lasts after a quotient of two zeros (a tumble passes the
/// horizon often); all other solutions are judged strictly.
const MOST_DOUBTFUL: f64 = 0.25;

/// A quantity as the messages tell it, against golden on the same inputs.
#[derive(Clone, Debug, Serialize)]
pub struct OutputReport {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// By reference.
    pub against: Against,
}

/// Differences by reference.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Against {
    /// Against the golden model on the same codes, over unflagged solutions.
    pub golden: Statistics,
}

/// Differences over many solutions, in the quantity's unit; undefined without samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Root mean square.
    pub rms: Option<f64>,
    /// 99th percentile of the absolute differences (nearest rank).
    pub p99: Option<f64>,
    /// Largest absolute difference.
    pub max: Option<f64>,
    /// Mean.
    pub bias: Option<f64>,
    /// Solutions that count.
    pub samples: u64,
}

/// How often a status bit was set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FlagCount {
    /// Its name.
    pub name: String,
    /// Solutions in which native set it.
    pub native: u64,
    /// Solutions in which golden set it; `None` when golden's status is not known.
    pub golden: Option<u64>,
    /// Solutions in which the two differ where rounding does not decide.
    pub differ: Option<u64>,
    /// Solutions in which rounding decides.
    pub doubtful: Option<u64>,
}

impl Statistics {
    fn of(differences: &[f64]) -> Self {
        if differences.is_empty() {
            return Self::default();
        }
        let count = differences.len() as f64;
        let mut sizes: Vec<f64> = differences.iter().map(|d| d.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let square: f64 = sizes.iter().map(|size| size * size).sum();
        Self {
            rms: Some((square / count).sqrt()),
            p99: Some(sizes[(sizes.len() * 99).div_ceil(100) - 1]),
            max: sizes.last().copied(),
            bias: Some(differences.iter().sum::<f64>() / count),
            samples: differences.len() as u64,
        }
    }
}

/// One side's messages.
struct Side<'a> {
    name: &'static str,
    messages: &'a [Result<Message, String>],
}

/// A quantity with the node that holds its reference.
struct Judge<'a> {
    quantity: &'a Quantity,
    node: Option<&'a Node>,
    most: f64,
}

impl Judge<'_> {
    /// Golden's value in a solution and the largest difference from it that rounding explains.
    fn reference(&self, solution: usize) -> Option<(f64, f64)> {
        let node = self.node?;
        let sample = solution * node.per_solution.max(1) + self.quantity.write;
        let golden = *node.golden.as_ref()?.get(sample)?;
        let limit = match (&node.tolerance, &node.tuned) {
            (Some(tolerance), _) | (None, Some(tolerance)) => tolerance.max_abs,
            (None, None) => {
                let expectation = *node.expected.as_ref()?.get(sample)?;
                let allowance = node.allowance.as_ref().map_or(0.0, |given| given.max_abs);
                allowance + expectation.bias.abs() + self.most * expectation.deviation
            }
        };
        Some((golden, limit + self.quantity.step))
    }
}

/// Status words of native and golden together: a solution is judged where neither sets a bit.
pub(crate) fn either_status(comparison: &Comparison) -> Vec<u16> {
    let golden = comparison.status.iter().map(|status| status.set as u16);
    let native = comparison.flags.iter();
    native
        .zip(golden.chain(std::iter::repeat(0)))
        .map(|(native, golden)| native | golden)
        .collect()
}

/// Golden's status words; native's where golden's are not known.
pub(crate) fn golden_status(comparison: &Comparison) -> Vec<u16> {
    if comparison.status.is_empty() {
        return comparison.flags.clone();
    }
    let golden = comparison.status.iter();
    golden.map(|status| status.set as u16).collect()
}

/// Both sides, native first.
fn sides(comparison: &Comparison) -> [Side<'_>; 2] {
    let messages = &comparison.messages;
    [
        ("native", &messages.native),
        ("emulated", &messages.emulated),
    ]
    .map(|(name, messages)| Side { name, messages })
}

/// Adds what `check` finds on the first side on which it finds anything: where both sides are wrong in
/// the same way, native's is enough to say so.
fn on_first_side(
    comparison: &Comparison,
    reasons: &mut Vec<Reason>,
    check: impl Fn(&Side<'_>, &mut Vec<Reason>),
) {
    let before = reasons.len();
    for side in sides(comparison) {
        check(&side, reasons);
        if reasons.len() > before {
            return;
        }
    }
}

/// Whether every message can be read and has its number: without that nothing behind it counts.
pub(crate) fn check_readable(
    comparison: &Comparison,
    frames: &FrameComparison,
    reasons: &mut Vec<Reason>,
) {
    if frames.compared == 0 && frames.mismatches == 0 {
        reasons.push(Reason::NoFrames);
    }
    on_first_side(comparison, reasons, |side, reasons| {
        side.check_readable(comparison, reasons);
    });
}

/// Judges what the messages of both sides say; the reports are of what the device sends.
pub(crate) fn judge(comparison: &Comparison, reasons: &mut Vec<Reason>) -> Vec<OutputReport> {
    let outputs = &comparison.outputs;
    let judges: Vec<Judge<'_>> = outputs
        .quantities
        .iter()
        .map(|quantity| Judge {
            quantity,
            node: comparison
                .nodes
                .iter()
                .find(|node| node.name == quantity.node),
            most: most_deviations(comparison.flags.len()),
        })
        .collect();
    on_first_side(comparison, reasons, |side, reasons| {
        side.check(comparison, &judges, reasons);
    });
    let [native, emulated] = sides(comparison);
    let device = if emulated.messages.is_empty() {
        native
    } else {
        emulated
    };
    judges
        .iter()
        .map(|judge| device.report(comparison, judge))
        .collect()
}

impl Side<'_> {
    fn wrong(&self, what: String, reasons: &mut Vec<Reason>) {
        reasons.push(Reason::MessageWrong {
            side: self.name,
            what,
        });
    }

    fn check_readable(&self, comparison: &Comparison, reasons: &mut Vec<Reason>) {
        if let Some((index, Err(why))) = first(self.messages, |_, message| message.is_err()) {
            self.wrong(format!("message {index} cannot be read: {why}"), reasons);
        }
        let modulus = comparison.outputs.sequence_modulus.max(1);
        let misnumbered = |index: usize, message: &Result<Message, String>| {
            message
                .as_ref()
                .is_ok_and(|message| message.sequence != index as u64 % modulus)
        };
        if let Some((index, Ok(message))) = first(self.messages, misnumbered) {
            let (found, expected) = (message.sequence, index as u64 % modulus);
            let what = format!("message {index} has the number {found}, expected {expected}");
            self.wrong(what, reasons);
        }
    }

    fn check(&self, comparison: &Comparison, judges: &[Judge<'_>], reasons: &mut Vec<Reason>) {
        for (at, judge) in judges.iter().enumerate() {
            if let Some(what) = self.first_beyond(comparison, judge, at) {
                self.wrong(what, reasons);
            }
        }
        self.check_status(comparison, reasons);
    }

    /// The first value of a quantity that golden contradicts, in words.
    fn first_beyond(
        &self,
        comparison: &Comparison,
        judge: &Judge<'_>,
        at: usize,
    ) -> Option<String> {
        let quantity = judge.quantity;
        if judge.node.is_none_or(|node| node.golden.is_none()) {
            return Some(format!(
                "{}: golden has no node {} to judge it by",
                quantity.name, quantity.node
            ));
        }
        for (solution, message) in self.messages.iter().enumerate() {
            let Ok(message) = message else { continue };
            if !quantity.in_flagged && is_flagged(comparison, solution, message.status) {
                continue;
            }
            let Some((golden, limit)) = judge.reference(solution) else {
                continue;
            };
            let value = message.values.get(at).copied().unwrap_or(f64::NAN);
            let size = quantity.difference(value, golden).abs();
            if exceeds(size, limit) && limit != f64::INFINITY {
                return Some(format!(
                    "{} of message {solution} is {value} {}, golden's {golden}, limit {limit:.2e}",
                    quantity.name, quantity.unit
                ));
            }
        }
        None
    }

    /// Each status bit of each message, except where rounding decides.
    fn check_status(&self, comparison: &Comparison, reasons: &mut Vec<Reason>) {
        let known = comparison
            .outputs
            .status
            .iter()
            .fold(0, |all, bit| all | bit.mask);
        let has_unknown = |_: usize, message: &Result<Message, String>| matches!(message, Ok(m) if m.status & !known != 0);
        if let Some((index, Ok(message))) = first(self.messages, has_unknown) {
            reasons.push(Reason::MessageWrong {
                side: self.name,
                what: format!(
                    "message {index} has the status {:#06x}, of which the product knows {known:#06x}",
                    message.status
                ),
            });
        }
        for bit in &comparison.outputs.status {
            let differs = |solution: usize, message: &Result<Message, String>| {
                let (Ok(message), Some(status)) = (message, comparison.status.get(solution)) else {
                    return false;
                };
                (message.status ^ status.set) & !status.doubtful & bit.mask != 0
            };
            let count = self
                .messages
                .iter()
                .enumerate()
                .filter(|&(solution, message)| differs(solution, message))
                .count();
            let permitted = comparison
                .tuned
                .as_ref()
                .map_or(0.0, |tuned| tuned.most_status);
            if count as f64 <= permitted * self.messages.len() as f64 {
                continue;
            }
            if let Some((solution, Ok(message))) = first(self.messages, differs) {
                reasons.push(Reason::StatusDiffers {
                    side: self.name,
                    bit: bit.name.clone(),
                    count: count as u64,
                    solution,
                    is_set: message.status & bit.mask != 0,
                });
            }
        }
    }

    fn report(&self, comparison: &Comparison, judge: &Judge<'_>) -> OutputReport {
        let quantity = judge.quantity;
        let at = comparison
            .outputs
            .quantities
            .iter()
            .position(|other| std::ptr::eq(other, quantity));
        let mut differences = Vec::new();
        for (solution, message) in self.messages.iter().enumerate() {
            let (Ok(message), Some(at)) = (message, at) else {
                continue;
            };
            if is_flagged(comparison, solution, message.status) {
                continue;
            }
            if let (Some(&value), Some((golden, _))) =
                (message.values.get(at), judge.reference(solution))
            {
                differences.push(quantity.difference(value, golden));
            }
        }
        OutputReport {
            name: quantity.name.clone(),
            unit: quantity.unit.clone(),
            against: Against {
                golden: Statistics::of(&differences),
            },
        }
    }
}

fn first<T>(items: &[T], is_wrong: impl Fn(usize, &T) -> bool) -> Option<(usize, &T)> {
    items
        .iter()
        .enumerate()
        .find(|&(index, item)| is_wrong(index, item))
}

/// A solution counts as flagged where either side says so.
fn is_flagged(comparison: &Comparison, solution: usize, status: u32) -> bool {
    let golden = comparison.status.get(solution).copied().unwrap_or_default();
    status != 0 || golden.set != 0
}

/// Counts of every status bit, and what is wrong with their shares.
pub(crate) fn count_flags(comparison: &Comparison, reasons: &mut Vec<Reason>) -> Vec<FlagCount> {
    let (native, golden) = (&comparison.flags, &comparison.status);
    let solutions = native.len().max(1) as f64;
    let count = |is_set: &dyn Fn(usize) -> bool| (0..native.len()).filter(|&k| is_set(k)).count();
    let is_known = !golden.is_empty();
    let mut counts = Vec::new();
    for bit in &comparison.outputs.status {
        let of_golden = |k: usize| golden.get(k).copied().unwrap_or_default();
        let doubtful = count(&|k| of_golden(k).doubtful & bit.mask != 0);
        // Tuned formats are judged by the share that differs, doubtful or not.
        if comparison.tuned.is_none() && doubtful as f64 / solutions > MOST_DOUBTFUL {
            reasons.push(Reason::StatusDoubtful {
                bit: bit.name.clone(),
                share: doubtful as f64 / solutions,
                limit: MOST_DOUBTFUL,
            });
        }
        let set = count(&|k| of_golden(k).set & bit.mask != 0);
        let differ = count(&|k| {
            let status = of_golden(k);
            (u32::from(native[k]) ^ status.set) & !status.doubtful & bit.mask != 0
        });
        counts.push(FlagCount {
            name: bit.name.clone(),
            native: count(&|k| u32::from(native[k]) & bit.mask != 0) as u64,
            golden: is_known.then_some(set as u64),
            differ: is_known.then_some(differ as u64),
            doubtful: is_known.then_some(doubtful as u64),
        });
    }
    if let Some(limit) = &comparison.most_flagged {
        let flagged = count(&|k| native[k] != 0) as f64 / solutions;
        if exceeds(flagged, limit.most) {
            reasons.push(Reason::TooManyFlagged {
                share: flagged,
                limit: limit.most,
            });
        }
    }
    counts
}
