//! What the product sends, against the reference: every message is decoded on the golden side and its
//! number, its values and each of its status bits are held against golden's own.

use cardan_outputs::{Message, Quantity};
use serde::Serialize;

use crate::chain::GroupErrors;
use crate::input::Comparison;
use crate::limit::most_deviations;
use crate::metrics::exceeds;
use crate::reason::Reason;
use crate::spread::{Errors, Spread};

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
    /// Against the golden model on the same inputs, over unflagged solutions.
    pub golden: Statistics,
    /// Against the truth, over unflagged solutions; `None` where it is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<Statistics>,
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

impl Statistics {
    /// A spread in another unit: `scale` of it are one of this.
    fn of(spread: &Spread, scale: f64) -> Self {
        let scaled = |value: Option<f64>| value.map(|value| value / scale);
        Self {
            rms: scaled(spread.rms),
            p99: scaled(spread.p99),
            max: scaled(spread.max),
            bias: scaled(spread.bias),
            samples: spread.samples,
        }
    }
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

/// The side whose nodes are native's.
const NATIVE: &str = "native";

/// A status word, and golden's of the same solution.
#[derive(Clone, Copy, Debug, Default)]
struct BitCount {
    native: u64,
    golden: u64,
    differ: u64,
    doubtful: u64,
}

/// What is looked at of one side's messages.
#[derive(Debug)]
struct Side {
    name: &'static str,
    messages: usize,
    unreadable: Option<String>,
    misnumbered: Option<String>,
    unknown: Option<String>,
    /// By quantity: the first value that golden contradicts, and the first that is not the side's own node's, in
    /// words; the differences from golden.
    beyond: Vec<Option<String>>,
    foreign: Vec<Option<String>>,
    errors: Vec<Errors>,
    /// By status bit: how often it differs where rounding does not decide; the first time, and whether it is set
    /// there.
    differs: Vec<(u64, Option<(usize, bool)>)>,
}

/// A quantity with the node that holds its reference.
#[derive(Debug)]
struct Reference {
    node: Option<usize>,
    most: f64,
}

impl Reference {
    /// Golden's value in a solution of a window and the largest difference from it that rounding explains.
    fn at(&self, window: &Comparison, quantity: &Quantity, solution: usize) -> Option<(f64, f64)> {
        let node = &window.nodes[self.node?];
        let sample = solution * node.per_solution.max(1) + quantity.write;
        let golden = *node.golden.as_ref()?.get(sample)?;
        let limit = match (&node.tolerance, &node.tuned) {
            (Some(tolerance), _) | (None, Some(tolerance)) => tolerance.max_abs,
            (None, None) => {
                let expectation = *node.expected.as_ref()?.get(sample)?;
                let allowance = node.allowance.as_ref().map_or(0.0, |given| given.max_abs);
                allowance + expectation.bias.abs() + self.most * expectation.deviation
            }
        };
        Some((golden, limit + quantity.step))
    }
}

/// Looks at messages and status words, window by window.
#[derive(Debug)]
pub(crate) struct MessageJudge {
    references: Vec<Reference>,
    sides: [Side; 2],
    bits: Vec<BitCount>,
    flagged: u64,
    solutions: usize,
    statuses: usize,
}

/// Status words of native and golden together: a solution is judged where neither sets a bit.
pub(crate) fn either_status(window: &Comparison) -> Vec<u32> {
    let golden = window.status.iter().map(|status| status.set);
    let native = window.flags.iter();
    native
        .zip(golden.chain(std::iter::repeat(0)))
        .map(|(native, golden)| native | golden)
        .collect()
}

/// Golden's status words; native's where golden's are not known.
pub(crate) fn golden_status(window: &Comparison) -> Vec<u32> {
    if window.status.is_empty() {
        return window.flags.clone();
    }
    window.status.iter().map(|status| status.set).collect()
}

impl Side {
    fn new(name: &'static str, comparison: &Comparison) -> Self {
        let quantities = comparison.outputs.quantities.len();
        Self {
            name,
            messages: 0,
            unreadable: None,
            misnumbered: None,
            unknown: None,
            beyond: vec![None; quantities],
            foreign: vec![None; quantities],
            errors: vec![Errors::with_percentile(); quantities],
            differs: vec![(0, None); comparison.outputs.status.len()],
        }
    }

    fn add(
        &mut self,
        window: &Comparison,
        messages: &[Result<Message, String>],
        references: &[Reference],
    ) {
        let before = self.messages;
        for (at, message) in messages.iter().enumerate() {
            let index = before + at;
            match message {
                Ok(message) => self.add_readable(window, references, (at, index), message),
                Err(why) => {
                    let what = || format!("message {index} cannot be read: {why}");
                    self.unreadable.get_or_insert_with(what);
                }
            }
        }
        self.messages += messages.len();
    }

    /// `at` is the message's place in the window and in the run.
    fn add_readable(
        &mut self,
        window: &Comparison,
        references: &[Reference],
        (at, index): (usize, usize),
        message: &Message,
    ) {
        let outputs = &window.outputs;
        let expected = index as u64 % outputs.sequence_modulus.max(1);
        if message.sequence != expected {
            let found = message.sequence;
            let what = || format!("message {index} has the number {found}, expected {expected}");
            self.misnumbered.get_or_insert_with(what);
        }
        let known = outputs.status.iter().fold(0, |all, bit| all | bit.mask);
        if message.status & !known != 0 {
            let what = || {
                format!(
                    "message {index} has the status {:#06x}, of which the product knows {known:#06x}",
                    message.status
                )
            };
            self.unknown.get_or_insert_with(what);
        }
        let golden = window.status.get(at).copied();
        if let Some(golden) = golden {
            for (bit, (count, first)) in outputs.status.iter().zip(&mut self.differs) {
                if (message.status ^ golden.set) & !golden.doubtful & bit.mask != 0 {
                    *count += 1;
                    first.get_or_insert((index, message.status & bit.mask != 0));
                }
            }
        }
        // A solution counts as flagged where either side says so.
        let is_flagged = message.status != 0 || golden.is_some_and(|golden| golden.set != 0);
        for (place, (quantity, reference)) in outputs.quantities.iter().zip(references).enumerate()
        {
            self.add_own(window, reference, place, (at, index), message);
            let Some((golden, limit)) = reference.at(window, quantity, at) else {
                continue;
            };
            let value = message.values.get(place).copied();
            let difference = quantity.difference(value.unwrap_or(f64::NAN), golden);
            if let (false, Some(_)) = (is_flagged, value) {
                self.errors[place].add(difference);
            }
            let is_judged = quantity.in_flagged || !is_flagged;
            if is_judged && exceeds(difference.abs(), limit) && limit != f64::INFINITY {
                let value = value.unwrap_or(f64::NAN);
                let what = || {
                    format!(
                        "{} of message {index} is {value} {}, golden's {golden}, limit {limit:.2e}",
                        quantity.name, quantity.unit
                    )
                };
                self.beyond[place].get_or_insert_with(what);
            }
        }
    }

    /// A message tells what the side's own node holds, to within a step of the message's format; also in a
    /// solution with status bits.
    fn add_own(
        &mut self,
        window: &Comparison,
        reference: &Reference,
        place: usize,
        (at, index): (usize, usize),
        message: &Message,
    ) {
        let quantity = &window.outputs.quantities[place];
        let node = reference.node.map(|node| &window.nodes[node]);
        let own = node.and_then(|node| {
            let sample = at * node.per_solution.max(1) + quantity.write;
            let is_native = self.name == NATIVE;
            let words = if is_native {
                Some(&node.native)
            } else {
                node.emulated.as_ref()
            };
            words?.get(sample).map(|&raw| raw as f64 * node.lsb)
        });
        let (Some(own), Some(&value)) = (own, message.values.get(place)) else {
            return;
        };
        let size = quantity.difference(value, own).abs();
        if size.is_nan() || size >= quantity.step {
            let what = || {
                format!(
                    "{} of message {index} is {value} {}, its own node {} holds {own}",
                    quantity.name, quantity.unit, quantity.node
                )
            };
            self.foreign[place].get_or_insert_with(what);
        }
    }

    fn wrong(&self, what: &str, reasons: &mut Vec<Reason>) {
        reasons.push(Reason::MessageWrong {
            side: self.name,
            what: what.to_owned(),
        });
    }

    fn check_readable(&self, reasons: &mut Vec<Reason>) {
        for what in self.unreadable.iter().chain(&self.misnumbered) {
            self.wrong(what, reasons);
        }
    }

    fn check(&self, comparison: &Comparison, references: &[Reference], reasons: &mut Vec<Reason>) {
        let outputs = &comparison.outputs;
        for (place, (quantity, reference)) in outputs.quantities.iter().zip(references).enumerate()
        {
            let node = reference.node.map(|node| &comparison.nodes[node]);
            if node.is_none_or(|node| node.golden.is_none()) {
                let what = format!(
                    "{}: golden has no node {} to judge it by",
                    quantity.name, quantity.node
                );
                self.wrong(&what, reasons);
            } else if let Some(what) = self.beyond[place].as_ref().or(self.foreign[place].as_ref())
            {
                self.wrong(what, reasons);
            }
        }
        if let Some(what) = &self.unknown {
            self.wrong(what, reasons);
        }
        let permitted = (comparison.tuned.as_ref()).map_or(0.0, |tuned| tuned.most_status);
        for (bit, (count, first)) in outputs.status.iter().zip(&self.differs) {
            if *count as f64 <= permitted * self.messages as f64 {
                continue;
            }
            if let Some((solution, is_set)) = *first {
                reasons.push(Reason::StatusDiffers {
                    side: self.name,
                    bit: bit.name.clone(),
                    count: *count,
                    solution,
                    is_set,
                });
            }
        }
    }
}

impl MessageJudge {
    /// `solutions` is the number by which limits are set.
    pub(crate) fn new(comparison: &Comparison, solutions: usize) -> Self {
        let reference = |quantity: &Quantity| Reference {
            node: (comparison.nodes.iter()).position(|node| node.name == quantity.node),
            most: most_deviations(solutions),
        };
        Self {
            references: comparison
                .outputs
                .quantities
                .iter()
                .map(reference)
                .collect(),
            sides: [NATIVE, "emulated"].map(|name| Side::new(name, comparison)),
            bits: vec![BitCount::default(); comparison.outputs.status.len()],
            flagged: 0,
            solutions: 0,
            statuses: 0,
        }
    }

    pub(crate) fn add(&mut self, window: &Comparison) {
        let messages = [&window.messages.native, &window.messages.emulated];
        for (side, messages) in self.sides.iter_mut().zip(messages) {
            side.add(window, messages, &self.references);
        }
        for (at, &native) in window.flags.iter().enumerate() {
            let golden = window.status.get(at).copied().unwrap_or_default();
            self.flagged += u64::from(native != 0);
            for (bit, count) in window.outputs.status.iter().zip(&mut self.bits) {
                let is = |word: u32| u64::from(word & bit.mask != 0);
                count.native += is(native);
                count.golden += is(golden.set);
                count.doubtful += is(golden.doubtful);
                count.differ += is((native ^ golden.set) & !golden.doubtful);
            }
        }
        self.solutions += window.flags.len();
        self.statuses += window.status.len();
    }

    /// Messages of the emulated device.
    pub(crate) fn emulated(&self) -> u64 {
        self.sides[1].messages as u64
    }

    pub(crate) const fn statuses(&self) -> usize {
        self.statuses
    }

    pub(crate) const fn flagged(&self) -> u64 {
        self.flagged
    }

    /// Whether a status bit occurred.
    pub(crate) fn has_occurred(&self, bit: usize) -> bool {
        self.bits.get(bit).is_some_and(|count| count.native > 0)
    }

    /// Adds what `check` finds on the first side on which it finds anything: where both sides are wrong in
    /// the same way, native's is enough to say so.
    fn on_first_side(&self, reasons: &mut Vec<Reason>, check: impl Fn(&Side, &mut Vec<Reason>)) {
        let before = reasons.len();
        for side in &self.sides {
            check(side, reasons);
            if reasons.len() > before {
                return;
            }
        }
    }

    /// Whether every message can be read and has its number: without that nothing behind it counts.
    pub(crate) fn check_readable(&self, reasons: &mut Vec<Reason>) {
        self.on_first_side(reasons, Side::check_readable);
    }

    /// Judges what the messages of both sides say; the reports are of what the device sends.
    pub(crate) fn judge(
        &self,
        comparison: &Comparison,
        truth: Option<&GroupErrors>,
        reasons: &mut Vec<Reason>,
    ) -> Vec<OutputReport> {
        self.on_first_side(reasons, |side, reasons| {
            side.check(comparison, &self.references, reasons);
        });
        let [native, emulated] = &self.sides;
        let device = if emulated.messages == 0 {
            native
        } else {
            emulated
        };
        let reports = comparison.outputs.quantities.iter().zip(&device.errors);
        reports
            .map(|(quantity, errors)| OutputReport {
                name: quantity.name.clone(),
                unit: quantity.unit.clone(),
                against: Against {
                    golden: Statistics::of(&errors.spread(), 1.0),
                    truth: of_truth(comparison, truth, &quantity.name),
                },
            })
            .collect()
    }

    /// Counts of every status bit, and what is wrong with their shares.
    pub(crate) fn count_flags(
        &self,
        comparison: &Comparison,
        reasons: &mut Vec<Reason>,
    ) -> Vec<FlagCount> {
        let solutions = self.solutions.max(1) as f64;
        let is_known = self.statuses > 0;
        let mut counts = Vec::new();
        for (bit, count) in comparison.outputs.status.iter().zip(&self.bits) {
            let share = count.doubtful as f64 / solutions;
            // Tuned formats are judged by the share that differs, doubtful or not.
            if comparison.tuned.is_none() && share > MOST_DOUBTFUL {
                reasons.push(Reason::StatusDoubtful {
                    bit: bit.name.clone(),
                    share,
                    limit: MOST_DOUBTFUL,
                });
            }
            counts.push(FlagCount {
                name: bit.name.clone(),
                native: count.native,
                golden: is_known.then_some(count.golden),
                differ: is_known.then_some(count.differ),
                doubtful: is_known.then_some(count.doubtful),
            });
        }
        if let Some(limit) = &comparison.most_flagged {
            let share = self.flagged as f64 / solutions;
            if exceeds(share, limit.most) {
                reasons.push(Reason::TooManyFlagged {
                    share,
                    limit: limit.most,
                });
            }
        }
        counts
    }
}

/// A quantity's error against the truth, in its own unit, where the group has a member of that name.
fn of_truth(
    comparison: &Comparison,
    truth: Option<&GroupErrors>,
    name: &str,
) -> Option<Statistics> {
    let group = comparison.outputs.group.as_ref()?;
    let member = group.members.iter().find(|member| member.name == name)?;
    Some(Statistics::of(truth?.named(name)?, member.scale))
}
