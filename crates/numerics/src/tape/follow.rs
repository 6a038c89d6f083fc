//! An algorithm followed while it runs: its tape is known from a rehearsal, and every step is held to it.

use std::collections::VecDeque;
use std::rc::Rc;

use super::build::{is_same_operation, keep};
use super::trace::{Operand, Recorded, StepSeen, Trace};
use super::{Entry, Inputs, Ref, Tape, TraceError};
use crate::Datapath;

/// An algorithm, its tape, and what its steps take from outside, one after the other: what a run without
/// an end needs, of which [`Tape::record`] would want all steps first.
pub struct Follower<A: Datapath> {
    algorithm: A,
    trace: Trace,
    state: A::State<Trace>,
    tape: Rc<Tape>,
    step: usize,
    /// Number of the first operation of the first step.
    first: u64,
    /// Number of the first operation of the current step and of those that it may look back at.
    starts: VecDeque<u64>,
    /// What the last step took from outside.
    inputs: Inputs,
}

impl<A: Datapath> Follower<A> {
    /// Records `algorithm` on the steps of a `rehearsal`, looking at `ahead` steps beyond it, and stands
    /// before its first step again.
    ///
    /// # Errors
    /// As [`Tape::record`].
    pub fn new<I: AsRef<[i32]>>(
        algorithm: A,
        rehearsal: &[I],
        ahead: usize,
    ) -> Result<Self, TraceError> {
        let (tape, _) = Tape::record_ahead(&algorithm, rehearsal, ahead)?;
        let trace = Trace::default();
        let state = algorithm.start(&trace);
        trace.begin_steps();
        Ok(Self {
            algorithm,
            first: trace.next(),
            trace,
            state,
            tape: Rc::new(tape),
            step: 0,
            starts: VecDeque::new(),
            inputs: Inputs::default(),
        })
    }

    /// The operations of all steps.
    #[must_use]
    pub fn tape(&self) -> Rc<Tape> {
        Rc::clone(&self.tape)
    }

    /// Takes the next step's inputs; gives what it takes from outside, as step 0 of what is returned.
    ///
    /// # Errors
    /// A step that does other operations than the tape has for it.
    pub fn step(&mut self, inputs: &[i32]) -> Result<&Inputs, TraceError> {
        if self.starts.len() > self.tape.memory() {
            self.starts.pop_front();
        }
        self.starts.push_back(self.trace.next());
        self.algorithm.step(&self.trace, &mut self.state, inputs);
        let seen = self.trace.end_step();
        self.check(&seen)?;
        self.step += 1;
        self.inputs = Inputs::default();
        keep(&mut self.inputs, &seen);
        Ok(&self.inputs)
    }

    fn check(&self, seen: &StepSeen) -> Result<(), TraceError> {
        let body = self.tape.body(self.step);
        let other = |what: String| TraceError::OtherPath {
            step: self.step,
            what,
        };
        if seen.ops.len() != body.len() {
            let (now, before) = (seen.ops.len(), body.len());
            return Err(other(format!("{now} operations, {before} before")));
        }
        let differs = |pair: (&Recorded, &Entry)| !self.is_same(pair.0, pair.1);
        match seen.ops.iter().zip(body).position(differs) {
            Some(at) => Err(other(format!("operation {} is another one", at + 1))),
            None => Ok(()),
        }
    }

    fn is_same(&self, (node, op): &Recorded, entry: &Entry) -> bool {
        let relative = op.map(|operand| self.from(operand));
        *node == entry.node && is_same_operation(&relative, &entry.op.map(Some))
    }

    /// Where the current step finds an operand; nowhere if that lies behind all that the tape looks at.
    fn from(&self, operand: Operand) -> Option<Ref> {
        let at = operand.at;
        if at < self.first {
            return Some(Ref::Before(at as u32));
        }
        let home = self.starts.partition_point(|&start| start <= at);
        let home = home.checked_sub(1)?;
        let index = (at - self.starts[home]) as u32;
        Some(match self.starts.len() - 1 - home {
            0 => Ref::Here(index),
            steps => Ref::Ago {
                steps: steps as u32,
                index,
            },
        })
    }
}
