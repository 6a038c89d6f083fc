//! Step-by-step runs of a tape over any domain of values.

use std::collections::VecDeque;
use std::ops::Deref;

use super::{Entry, Inputs, Op, Ref, Tape};

/// What the operations of a tape mean.
pub trait Domain {
    /// A value, or a truth.
    type Item: Clone;

    /// The step's input number `port`, raw / 2^frac, enters `node`.
    fn input(&mut self, node: usize, port: usize, raw: i32, frac: i32) -> Self::Item;
    /// The step's truth number `port` from outside.
    fn external(&mut self, port: usize, truth: bool) -> Self::Item;
    /// Any other operation; its result enters `node` (which truths do not have).
    fn apply(&mut self, node: usize, op: Op<&Self::Item>) -> Self::Item;
}

/// Runs a tape, borrowed or shared, step by step.
pub struct Runner<T, D: Domain> {
    tape: T,
    memory: usize,
    step: usize,
    before: Vec<D::Item>,
    /// The current step is last.
    steps: VecDeque<Vec<D::Item>>,
}

impl<T: Deref<Target = Tape> + Clone, D: Domain> Runner<T, D> {
    /// Computes what stands before the first step.
    pub fn new(tape: T, domain: &mut D) -> Self {
        let mut runner = Self {
            tape: tape.clone(),
            memory: tape.memory(),
            step: 0,
            before: Vec::new(),
            steps: VecDeque::new(),
        };
        for entry in &tape.before {
            let item = runner.evaluate(entry, domain, |_| 0, |_| false);
            runner.before.push(item);
        }
        runner
    }

    /// The values from before the first step.
    #[must_use]
    pub fn before(&self) -> &[D::Item] {
        &self.before
    }

    /// Runs the next step on step `at` of the inputs; its items in the order of its operations.
    pub fn step(&mut self, domain: &mut D, inputs: &Inputs, at: usize) -> &[D::Item] {
        while self.steps.len() > self.memory {
            self.steps.pop_front();
        }
        self.steps.push_back(Vec::new());
        let tape = self.tape.clone();
        for entry in tape.body(self.step) {
            let raw = |port: u32| inputs.raws[port as usize][at];
            let truth = |port: u32| inputs.truths[port as usize][at];
            let item = self.evaluate(entry, domain, raw, truth);
            if let Some(current) = self.steps.back_mut() {
                current.push(item);
            }
        }
        self.step += 1;
        self.steps.back().map_or(&[], Vec::as_slice)
    }

    /// The items of the steps that later ones may look back at, the last step's last.
    pub(super) const fn held_mut(&mut self) -> &mut VecDeque<Vec<D::Item>> {
        &mut self.steps
    }

    fn evaluate(
        &self,
        entry: &Entry,
        domain: &mut D,
        raw: impl Fn(u32) -> i32,
        truth: impl Fn(u32) -> bool,
    ) -> D::Item {
        let node = entry.node as usize;
        match entry.op {
            Op::Input { port, frac } => domain.input(node, port as usize, raw(port), frac),
            Op::External { port } => domain.external(port as usize, truth(port)),
            op => domain.apply(node, op.map(|operand| self.item(operand))),
        }
    }

    fn item(&self, operand: Ref) -> &D::Item {
        let last = self.steps.len().wrapping_sub(1);
        match operand {
            Ref::Before(index) => &self.before[index as usize],
            Ref::Here(index) => &self.steps[last][index as usize],
            Ref::Ago { steps, index } => &self.steps[last - steps as usize][index as usize],
        }
    }
}
