//! Windows of a run: whatever is a list per solution, or per value, is taken off at its front.

use crate::input::{Comparison, Frames, Messages, Node};
use crate::series::{Chain, RoundingStep, StageValues};

/// The first `count` of a list, or as many as there are; taken off.
fn front<T>(list: &mut Vec<T>, count: usize) -> Vec<T> {
    list.drain(..count.min(list.len())).collect()
}

fn front_of<T>(list: &mut Option<Vec<T>>, count: usize) -> Option<Vec<T>> {
    list.as_mut().map(|list| front(list, count))
}

impl Node {
    fn take(&mut self, values: usize) -> Self {
        Self {
            native: front(&mut self.native, values),
            emulated: front_of(&mut self.emulated, values),
            real: front_of(&mut self.real, values),
            expected: front_of(&mut self.expected, values),
            golden: front_of(&mut self.golden, values),
            ..self.facts()
        }
    }

    /// What does not change along the run; the streams that there are, empty.
    fn facts(&self) -> Self {
        Self {
            name: self.name.clone(),
            meaning: self.meaning.clone(),
            inputs: self.inputs.clone(),
            operations: self.operations.clone(),
            position: self.position,
            writes: self.writes.clone(),
            unit: self.unit.clone(),
            per_solution: self.per_solution,
            format: self.format.clone(),
            lsb: self.lsb,
            native: Vec::new(),
            emulated: self.emulated.as_ref().map(|_| Vec::new()),
            real: self.real.as_ref().map(|_| Vec::new()),
            expected: self.expected.as_ref().map(|_| Vec::new()),
            golden: self.golden.as_ref().map(|_| Vec::new()),
            overflows: self.overflows,
            tolerance: self.tolerance.clone(),
            tuned: self.tuned.clone(),
            allowance: self.allowance.clone(),
        }
    }
}

impl Chain {
    /// The first solutions; taken off.
    fn take(&mut self, solutions: usize) -> Self {
        let stages = self.stages.iter_mut().map(|stage| StageValues {
            stage: stage.stage.clone(),
            values: stage.values.take(solutions),
        });
        let steps = self.steps.iter_mut().map(|step| RoundingStep {
            node: step.node.clone(),
            values: step.values.take(solutions),
        });
        Self {
            stages: stages.collect(),
            steps: steps.collect(),
        }
    }
}

impl Comparison {
    /// What does not change along the run, with the streams that there are, empty.
    #[must_use]
    pub fn facts(&self) -> Self {
        let mut chain = self.chain.clone();
        Self {
            run: self.run.clone(),
            required: self.required,
            nodes: self.nodes.iter().map(Node::facts).collect(),
            frames: Frames::default(),
            flags: Vec::new(),
            outputs: self.outputs.clone(),
            messages: Messages::default(),
            status: Vec::new(),
            checks: self.checks.clone(),
            stage_limits: self.stage_limits.clone(),
            tuned: self.tuned.clone(),
            most_flagged: self.most_flagged.clone(),
            chain: chain.take(0),
            output_limits: self.output_limits.clone(),
            truth_tolerance: self.truth_tolerance,
            widening: self.widening,
            stale: self.stale.clone(),
            emulator: self.emulator.clone(),
            link: self.link.clone(),
            assumed: self.assumed.clone(),
            reproduce: self.reproduce.clone(),
        }
    }

    /// The first `solutions` as a window; taken off. Where there are no more, everything that is left over goes
    /// with them.
    #[must_use]
    pub fn take(&mut self, solutions: usize) -> Self {
        let is_last = solutions >= self.flags.len();
        let count = if is_last { usize::MAX } else { solutions };
        let of_node = |node: &mut Node| {
            let values = count.saturating_mul(node.per_solution.max(1));
            node.take(values)
        };
        Self {
            nodes: self.nodes.iter_mut().map(of_node).collect(),
            frames: Frames {
                native: front(&mut self.frames.native, count),
                emulated: front(&mut self.frames.emulated, count),
            },
            flags: front(&mut self.flags, count),
            outputs: self.outputs.clone(),
            messages: Messages {
                native: front(&mut self.messages.native, count),
                emulated: front(&mut self.messages.emulated, count),
            },
            status: front(&mut self.status, count),
            chain: self.chain.take(count),
            tuned: self.tuned.clone(),
            ..Self::default()
        }
    }
}
