//! Operations that feed back on themselves, step by step.

use std::ops::Range;

use super::Trial;
use crate::Word;
use crate::tape::{NO_NODE, Op, Ref, compute, decide};

impl Trial<'_> {
    /// Runs the operations of a loop through the steps of a block.
    pub(super) fn looped(&mut self, indices: &[usize], block: Range<usize>) {
        for step in block {
            for &index in indices {
                self.loop_step(index, step);
            }
        }
    }

    /// The mask of an operation among truths.
    #[inline]
    fn mask(&self, op: Op<Ref>, step: usize) -> Option<i64> {
        let mask = |operand: Ref| {
            let ago = match operand {
                Ref::Ago { steps, .. } => steps as usize,
                Ref::Here(_) | Ref::Before(_) => 0,
            };
            self.columns[self.slot(operand)].get(step - ago)
        };
        Some(match op {
            Op::Not(a) => !mask(a),
            Op::Or(a, b) => mask(a) | mask(b),
            Op::Xor(a, b) => mask(a) ^ mask(b),
            Op::Either(c, a, b) => {
                if mask(c) != 0 {
                    mask(a)
                } else {
                    mask(b)
                }
            }
            _ => return None,
        })
    }

    #[inline]
    fn loop_step(&mut self, index: usize, step: usize) {
        let slot = self.tape.before.len() + index;
        let entry = self.tape.steady[index];
        if entry.node == NO_NODE
            && let Some(truth) = self.mask(entry.op, step)
        {
            self.columns[slot].set(step, truth, false);
            return;
        }
        let plan = self.plans[slot];
        let mut at = 0;
        let items: Op<Word> = entry.op.map(|operand| {
            let ago = match operand {
                Ref::Ago { steps, .. } => steps as usize,
                Ref::Here(_) | Ref::Before(_) => 0,
            };
            let column = &self.columns[self.slot(operand)];
            let item = column.item(step - ago, plan.fracs[at], plan.truths[at]);
            at += 1;
            item
        });
        if entry.node == NO_NODE {
            let truth = decide(items.as_ref()).unwrap_or(false);
            self.columns[slot].set(step, truth.into(), true);
            return;
        }
        let ((raw, overflow), failed) = compute(items.as_ref(), plan.format);
        self.overflows[slot] += u64::from(overflow);
        if failed || (overflow && super::traps(plan.format)) {
            self.failures[slot].push(step as u32);
        }
        self.columns[slot].set(step, raw, false);
    }
}
