//! How far a run in fixed point may be from the same run on real numbers: a first-order propagation
//! of every rounding error along the tape, solution by solution.
//!
//! Each rounded write adds an independent error of known variance and mean (uniform over a place,
//! less what the operands' own places already fix); constants and settings add an error that is known
//! exactly. Errors travel by the derivatives of the operations, and correlated ones stay correlated:
//! a value carries one coefficient per source of its step (GUM, JCGM 100:2008, 5.2, with the sources
//! as input quantities). Where a first order would be wrong the secant over the reach of the error
//! stands in its place: near the zero of a root, a divisor, a comparison. A comparison that the
//! errors could turn is *doubtful*, and so is every truth and status bit that depends on it; a
//! selection by a doubtful truth may take either value.
//!
//! What an earlier step leaves is carried as one source per value: its size is kept, its correlation
//! with other values of that step is not.

mod operations;
mod propagation;
mod span;

use std::ops::Deref;

use cardan_datapath::Format;

use self::propagation::Propagation;
use self::span::Span;
use super::{Inputs, NO_NODE, Ref, Runner, Tape};

/// Standard deviations within which an error is taken to lie: beyond it in 2 of 10^9 values, were it
/// normal. The sum of many uniform errors has lighter tails.
const REACH: f64 = 6.0;

/// Largest value of a uniform error over its standard deviation.
const WIDEST: f64 = 1.732_050_807_568_877_2;

/// A value on real numbers and what fixed point may make of it.
#[derive(Clone, Debug, Default)]
pub struct Uncertain {
    value: f64,
    bias: f64,
    /// Per source of the step, the error's standard deviation from it.
    spread: Vec<f64>,
    /// Fractional bits of the word.
    frac: i64,
    /// For truths: the errors could turn it.
    doubtful: bool,
    /// The error has no bound: a divisor may be zero.
    unbounded: bool,
    /// What the word can be at all.
    span: Span,
    /// The word is never negative, whatever rounding does.
    nonnegative: bool,
    /// Deviation that it leaves to later steps.
    left: f64,
    /// Number of the operation that made it; 0 before any.
    id: u64,
    /// For truths: the value whose sign it is.
    sign_of: u64,
    /// For truths: the two values of which it says that the first is less.
    less_of: [u64; 2],
}

/// The expected difference of a fixed-point value from its real one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// The real value.
    pub value: f64,
    /// Mean of fixed point less real.
    pub bias: f64,
    /// Its standard deviation; infinite where nothing bounds the error.
    pub deviation: f64,
}

/// Status bits of a step on real numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Raised {
    /// Bits that are set.
    pub status: u16,
    /// Bits that rounding could set or clear.
    pub doubtful: u16,
}

impl Uncertain {
    fn variance(&self) -> f64 {
        self.spread.iter().map(|part| part * part).sum()
    }

    fn deviation(&self) -> f64 {
        if self.unbounded {
            f64::INFINITY
        } else {
            self.variance().sqrt()
        }
    }

    /// The largest error to reckon with, bias apart.
    fn reach(&self) -> f64 {
        REACH * self.deviation()
    }

    fn expected(&self) -> Expected {
        Expected {
            value: self.value,
            bias: self.bias,
            deviation: self.deviation(),
        }
    }

    fn holds(&self) -> bool {
        self.value != 0.0
    }
}

/// Runs a tape and gives what fixed point may make of each write.
pub struct Uncertainty<T> {
    tape: T,
    propagation: Propagation,
    runner: Runner<T, Propagation>,
    /// What steps look back at: how many steps ago, and which operation. Each is a source of its own.
    carried: Vec<(usize, usize)>,
    step: usize,
}

impl<T: Deref<Target = Tape> + Clone> Uncertainty<T> {
    /// Of `tape` computed in `formats`, one per node; `domain_flag` is the arithmetic's own status bit.
    #[must_use]
    pub fn new(tape: T, formats: &[Format], domain_flag: u16) -> Self {
        let bodies = tape.transient.iter().chain([&tape.steady]);
        let operands = bodies.flatten().flat_map(|entry| entry.op.operands());
        let mut carried: Vec<(usize, usize)> = operands
            .filter_map(|operand| match operand {
                Ref::Ago { steps, index } => Some((steps as usize, index as usize)),
                Ref::Here(_) | Ref::Before(_) => None,
            })
            .collect();
        carried.sort_unstable();
        carried.dedup();
        let mut propagation = Propagation {
            formats: formats.to_vec(),
            domain_flag,
            sources: carried.len(),
            operations: 0,
            status: 0,
            certain: 0,
            possible: 0,
        };
        let runner = Runner::new(tape.clone(), &mut propagation);
        Self {
            tape,
            propagation,
            runner,
            carried,
            step: 0,
        }
    }

    /// Runs the next step on step `at` of the inputs; shows `visit` the node and the expectation of
    /// each write, in order.
    pub fn step(
        &mut self,
        inputs: &Inputs,
        at: usize,
        mut visit: impl FnMut(usize, Expected),
    ) -> Raised {
        let propagation = &mut self.propagation;
        propagation.sources = self.carried.len();
        (
            propagation.status,
            propagation.certain,
            propagation.possible,
        ) = (0, 0, 0);
        let items = self.runner.step(propagation, inputs, at);
        for (entry, item) in self.tape.body(self.step).iter().zip(items) {
            if entry.node != NO_NODE && entry.op.is_recorded() {
                visit(entry.node as usize, item.expected());
            }
        }
        let raised = Raised {
            status: self.propagation.status,
            doubtful: self.propagation.possible & !self.propagation.certain,
        };
        self.carry();
        self.step += 1;
        raised
    }
    /// Keeps of the steps' errors what the next step can use: one source per value.
    fn carry(&mut self) {
        let held = self.runner.held_mut();
        for item in held.back_mut().into_iter().flatten() {
            item.left = left(&item.spread, self.carried.len());
            item.spread = Vec::new();
        }
        for (slot, &(ago, index)) in self.carried.iter().enumerate() {
            let step = held.len().checked_sub(ago).and_then(|at| held.get_mut(at));
            if let Some(item) = step.and_then(|items| items.get_mut(index)) {
                item.spread = Vec::new();
                if item.left > 0.0 {
                    item.spread.resize(slot, 0.0);
                    item.spread.push(item.left);
                }
            }
        }
    }
}

/// Deviation that a value leaves to later steps. In a loop roundings repeat themselves (a dead band, a
/// limit cycle): there the largest error of the step goes with all that came from steps before.
fn left(spread: &[f64], carried: usize) -> f64 {
    let (before, own) = spread.split_at(carried.min(spread.len()));
    let before: f64 = before.iter().map(|part| part.abs()).sum();
    let own: f64 = own.iter().map(|part| part * part).sum::<f64>().sqrt();
    if before > 0.0 {
        before + WIDEST * own
    } else {
        own
    }
}
