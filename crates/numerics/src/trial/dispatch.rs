//! One operation over a block of steps: picks the inner loop for its plan.

use std::ops::Range;

use fearless_simd::Level;

use super::column::Column;
use super::lanes::{self, Loop as _, Nearest, each, narrow, wide};
use super::plan::{Class, Plan};
use crate::Word;
use crate::tape::{Inputs, Op, compute, decide};

/// A loop over the steps of a block, compiled for each set of processor features; the best one there
/// is runs. (What is not inlined into it would be compiled without them.)
macro_rules! over {
    ($level:expr, $($job:ident)::+($($argument:expr),*), $at:ident => $value:expr) => {
        lanes::run($level, $($job)::+($($argument,)* #[inline(always)] |$at: usize| $value))
    };
}

/// Buffers of a block for columns of the other width.
#[derive(Default)]
pub(super) struct Scratch {
    a: Vec<i64>,
    b: Vec<i64>,
    out: Vec<i64>,
}

/// An operation's way of computing, and the steps to compute.
pub(super) struct Kernel {
    pub(super) level: Level,
    pub(super) plan: Plan,
    pub(super) block: Range<usize>,
}

/// A column, and how many steps ago it is read.
type Operand<'a> = (&'a Column, usize);

impl Kernel {
    /// Computes into `out`; returns the number of overflows.
    pub(super) fn run(
        &self,
        op: Op<Operand<'_>>,
        inputs: &Inputs,
        out: &mut Column,
        scratch: &mut Scratch,
        failures: &mut Vec<u32>,
    ) -> u64 {
        if self.truths(op, inputs, out, scratch) {
            return 0;
        }
        if let Op::Constant(value) = op {
            out.fill_range(self.block.clone(), self.plan.format.constant(value));
            return 0;
        }
        match (self.plan.class, &mut *out) {
            (Class::Narrow, Column::Narrow(words)) => {
                self.narrow(op, inputs, &mut words[self.block.clone()])
            }
            (Class::Wide, _) => self.wide(op, inputs, out, scratch, failures),
            _ => self.exact(op, inputs, out, failures),
        }
    }

    /// A narrow column's words in the steps of the block, `ago` steps earlier.
    fn words<'a>(&self, (column, ago): Operand<'a>) -> &'a [i32] {
        match column {
            Column::Narrow(words) => &words[self.block.start - ago..self.block.end - ago],
            // Plans choose narrow loops for narrow operands only.
            Column::Wide(_) => &[],
        }
    }

    /// The operations on truths, and those that give one. Returns false for the others.
    fn truths(
        &self,
        op: Op<Operand<'_>>,
        inputs: &Inputs,
        out: &mut Column,
        scratch: &mut Scratch,
    ) -> bool {
        let Column::Narrow(out) = out else {
            return false;
        };
        let out = &mut out[self.block.clone()];
        let count = out.len();
        let level = self.level;
        match op {
            Op::External { port } => {
                let truths = &inputs.truths[port as usize][self.block.clone()];
                for (out, truth) in out.iter_mut().zip(truths) {
                    *out = -i32::from(*truth);
                }
            }
            Op::Not(a) => {
                let a = &self.words(a)[..count];
                over!(level, each(out), at => !a[at]);
            }
            Op::Or(a, b) => {
                let (a, b) = (&self.words(a)[..count], &self.words(b)[..count]);
                over!(level, each(out), at => a[at] | b[at]);
            }
            Op::Xor(a, b) => {
                let (a, b) = (&self.words(a)[..count], &self.words(b)[..count]);
                over!(level, each(out), at => a[at] ^ b[at]);
            }
            Op::Either(c, a, b) => {
                let (a, b) = (&self.words(a)[..count], &self.words(b)[..count]);
                let c = &self.words(c)[..count];
                over!(level, each(out), at => (a[at] & c[at]) | (b[at] & !c[at]));
            }
            Op::Raise(_, a) => out.copy_from_slice(self.words(a)),
            Op::Negative((Column::Narrow(_), _)) => {
                let Op::Negative(a) = op else { return false };
                let a = &self.words(a)[..count];
                over!(level, each(out), at => a[at] >> 31);
            }
            Op::Less(a, b) if self.plan.class == Class::Narrow => {
                let (a, b) = (&self.words(a)[..count], &self.words(b)[..count]);
                let [up_a, up_b] = self.plan.align;
                over!(level, each(out), at => -i32::from((a[at] << up_a) < (b[at] << up_b)));
            }
            Op::Less(a, b) if self.plan.class == Class::Wide => {
                self.widen(a, &mut scratch.a);
                self.widen(b, &mut scratch.b);
                let (a, b) = (&scratch.a[..count], &scratch.b[..count]);
                let [up_a, up_b] = self.plan.align;
                over!(level, each(out), at => -i32::from((a[at] << up_a) < (b[at] << up_b)));
            }
            Op::Negative(_) | Op::Less(..) | Op::Known(_) => {
                for (at, out) in out.iter_mut().enumerate() {
                    let items = self.items(op, self.block.start + at);
                    *out = -i32::from(decide(items.as_ref()).unwrap_or(false));
                }
            }
            _ => return false,
        }
        true
    }

    fn narrow(&self, op: Op<Operand<'_>>, inputs: &Inputs, out: &mut [i32]) -> u64 {
        let fit = narrow::Fit::new(self.plan.format, self.plan.drop);
        let count = out.len();
        let [up_a, up_b] = self.plan.align;
        let level = self.level;
        match op {
            Op::Input { port, .. } => {
                let raws = &inputs.raws[port as usize][self.block.clone()][..count];
                over!(level, narrow::fit(out, fit), at => raws[at])
            }
            Op::Add(a, b) => {
                let (a, b) = (&self.words(a)[..count], &self.words(b)[..count]);
                over!(level, narrow::fit(out, fit), at => (a[at] << up_a) + (b[at] << up_b))
            }
            Op::Sub(a, b) => {
                let (a, b) = (&self.words(a)[..count], &self.words(b)[..count]);
                over!(level, narrow::fit(out, fit), at => (a[at] << up_a) - (b[at] << up_b))
            }
            Op::Mul(a, b) => {
                let (a, b) = (&self.words(a)[..count], &self.words(b)[..count]);
                over!(level, narrow::fit(out, fit), at => a[at] * b[at])
            }
            Op::Shift(a, _) => {
                let a = &self.words(a)[..count];
                over!(level, narrow::fit(out, fit), at => a[at])
            }
            Op::Neg(a) => {
                let a = &self.words(a)[..count];
                over!(level, narrow::fit(out, fit), at => -a[at])
            }
            Op::Abs(a) => {
                let a = &self.words(a)[..count];
                over!(level, narrow::fit(out, fit), at => a[at].wrapping_abs())
            }
            Op::Select(c, a, b) => {
                let (a, b) = (&self.words(a)[..count], &self.words(b)[..count]);
                let c = &self.words(c)[..count];
                over!(level, narrow::fit(out, fit), at => {
                    ((a[at] << up_a) & c[at]) | ((b[at] << up_b) & !c[at])
                })
            }
            _ => 0,
        }
    }

    fn widen(&self, (column, ago): Operand<'_>, into: &mut Vec<i64>) {
        let range = self.block.start - ago..self.block.end - ago;
        into.resize(range.len(), 0);
        match column {
            Column::Narrow(words) => {
                let words = &words[range];
                let into = &mut into[..words.len()];
                let level = self.level;
                over!(level, each(into), at => i64::from(words[at]));
            }
            Column::Wide(words) => into.copy_from_slice(&words[range]),
        }
    }

    fn wide(
        &self,
        op: Op<Operand<'_>>,
        inputs: &Inputs,
        out: &mut Column,
        scratch: &mut Scratch,
        failures: &mut Vec<u32>,
    ) -> u64 {
        let count = self.block.len();
        let Scratch { a, b, out: result } = scratch;
        result.resize(count, 0);
        match op {
            Op::Input { port, .. } => {
                a.clear();
                let raws = &inputs.raws[port as usize][self.block.clone()];
                a.extend(raws.iter().map(|&raw| i64::from(raw)));
            }
            Op::Add(x, y) | Op::Sub(x, y) | Op::Mul(x, y) | Op::Div(x, y) | Op::Select(_, x, y) => {
                self.widen(x, a);
                self.widen(y, b);
            }
            Op::Shift(x, _) | Op::Neg(x) | Op::Abs(x) | Op::Sqrt(x) => self.widen(x, a),
            _ => return 0,
        }
        let overflows = self.wide_loop(op, &a[..count], b, result, failures);
        match out {
            Column::Wide(words) => words[self.block.clone()].copy_from_slice(result),
            Column::Narrow(words) => {
                let words = &mut words[self.block.clone()];
                let result = &result[..words.len()];
                let level = self.level;
                over!(level, each(words), at => result[at] as i32);
            }
        }
        overflows
    }

    fn wide_loop(
        &self,
        op: Op<Operand<'_>>,
        a: &[i64],
        b: &[i64],
        out: &mut [i64],
        failures: &mut Vec<u32>,
    ) -> u64 {
        let fit = wide::Fit::new(self.plan.format, self.plan.drop);
        let count = out.len();
        let a = &a[..count];
        let [up_a, up_b] = self.plan.align;
        let level = self.level;
        match op {
            Op::Add(..) => {
                let b = &b[..count];
                over!(level, wide::fit(out, fit), at => (a[at] << up_a) + (b[at] << up_b))
            }
            Op::Sub(..) => {
                let b = &b[..count];
                over!(level, wide::fit(out, fit), at => (a[at] << up_a) - (b[at] << up_b))
            }
            Op::Mul(..) => {
                let b = &b[..count];
                over!(level, wide::fit(out, fit), at => a[at] * b[at])
            }
            Op::Neg(_) => over!(level, wide::fit(out, fit), at => -a[at]),
            Op::Abs(_) => over!(level, wide::fit(out, fit), at => a[at].wrapping_abs()),
            Op::Select(c, ..) => {
                let b = &b[..count];
                let c = &self.words(c)[..count];
                over!(level, wide::fit(out, fit), at => {
                    let c = i64::from(c[at]);
                    ((a[at] << up_a) & c) | ((b[at] << up_b) & !c)
                })
            }
            Op::Div(..) => self.quotients(a, &b[..count], out, failures),
            Op::Sqrt(_) => {
                let how = Nearest::new(self.plan.format.rounding);
                let failed = |at: &usize| a[*at] < 0;
                let step = |at: usize| (self.block.start + at) as u32;
                if a.iter().any(|word| *word < 0) {
                    failures.extend((0..count).filter(failed).map(step));
                }
                over!(level, wide::fit(out, fit), at => lanes::root(a[at] << up_a, how))
            }
            _ => over!(level, wide::fit(out, fit), at => a[at]),
        }
    }

    fn quotients(&self, a: &[i64], b: &[i64], out: &mut [i64], failures: &mut Vec<u32>) -> u64 {
        let format = self.plan.format;
        let fit = wide::Fit::new(format, 0);
        let how = Nearest::new(format.rounding);
        let [up_a, up_b] = self.plan.align;
        // A zero divisor counts as 1 here.
        let level = self.level;
        let mut overflows = over!(level, wide::fit(out, fit), at => {
            let divisor = (b[at] << up_b) | i64::from(b[at] == 0);
            lanes::quotient(a[at] << up_a, divisor, how)
        });
        if b.contains(&0) {
            for at in (0..b.len()).filter(|&at| b[at] == 0) {
                // Divided by 1 above; whether that fitted does not count.
                let stand_in = [a[at] << up_a];
                let mut ignored = [0];
                overflows -= wide::fit(&mut ignored, fit, |_| stand_in[0]).run();
                overflows += 1;
                out[at] = if a[at] < 0 {
                    format.min_raw()
                } else {
                    format.max_raw()
                };
                failures.push((self.block.start + at) as u32);
            }
        }
        overflows
    }

    /// The operands in one step.
    fn items(&self, op: Op<Operand<'_>>, step: usize) -> Op<Word> {
        let mut at = 0;
        op.map(|(column, ago)| {
            let item = column.item(step - ago, self.plan.fracs[at], self.plan.truths[at]);
            at += 1;
            item
        })
    }

    fn exact(
        &self,
        op: Op<Operand<'_>>,
        inputs: &Inputs,
        out: &mut Column,
        failures: &mut Vec<u32>,
    ) -> u64 {
        let format = self.plan.format;
        let mut overflows = 0;
        for step in self.block.clone() {
            let items = match op {
                Op::Input { port, frac } => Op::Parameter {
                    raw: inputs.raws[port as usize][step],
                    frac,
                },
                op => self.items(op, step),
            };
            let ((raw, overflow), failed) = compute(items.as_ref(), format);
            // Constants are no writes; only settings tell that they did not fit.
            overflows += u64::from(overflow);
            if failed || (overflow && super::traps(format)) {
                failures.push(step as u32);
            }
            out.set(step, raw, false);
        }
        overflows
    }
}
