//! From a recording to a tape: cutting it into steps, and finding from where on they are equal.

use super::trace::{Recorded, Trace};
use super::{Entry, Inputs, Op, Ref, Tape};
use crate::Datapath;

/// Steps that are looked at for equality at first; doubled until the later half of them is equal.
const FIRST_STEPS: usize = 16;
/// Steps after which an algorithm that still changes is refused.
const MOST_STEPS: usize = 4096;

/// Why an algorithm could not be recorded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TraceError {
    /// The steps do not become equal.
    #[error(
        "the algorithm's steps still differ after {steps} of them: a step must do the same \
         operations on the same operands each time (branch with `select`; what is kept for later \
         must be renewed in every step)"
    )]
    Unsteady {
        /// Steps that were looked at.
        steps: usize,
    },
    /// A step took another path than the others.
    #[error(
        "step {step} does other operations than the steps before it: branch with `select`, never \
         with `if` on an input"
    )]
    OtherPath {
        /// The step, from 0.
        step: usize,
    },
    /// There is nothing to run on.
    #[error("no input: give at least one step")]
    Empty,
}

impl Tape {
    /// Records `algorithm`, and what it takes from outside while it runs on `steps`, each the
    /// inputs of one step.
    ///
    /// # Errors
    /// No steps, or steps that differ.
    pub fn record<A: Datapath, I: AsRef<[i32]>>(
        algorithm: &A,
        steps: &[I],
    ) -> Result<(Self, Inputs), TraceError> {
        let Some(last) = steps.last() else {
            return Err(TraceError::Empty);
        };
        let mut wanted = FIRST_STEPS;
        let tape = loop {
            let given = (0..wanted).map(|at| steps.get(at).unwrap_or(last).as_ref());
            let recorded = recorded(algorithm, given);
            match cut(&recorded) {
                Some(tape) => break tape,
                None if wanted >= MOST_STEPS => {
                    return Err(TraceError::Unsteady { steps: wanted });
                }
                None => wanted *= 2,
            }
        };
        let inputs = capture(algorithm, steps, tape.transient.len())?;
        Ok((tape, inputs))
    }
}

/// A recording and where its steps begin and end.
struct Cuts {
    ops: Vec<Recorded>,
    /// Begin of each step, and the end of the last.
    starts: Vec<u32>,
}

fn recorded<'a, A: Datapath>(algorithm: &A, steps: impl Iterator<Item = &'a [i32]>) -> Cuts {
    let trace = Trace::default();
    let mut state = algorithm.start(&trace);
    trace.begin_steps();
    let mut starts = vec![trace.len() as u32];
    for inputs in steps {
        algorithm.step(&trace, &mut state, inputs);
        trace.end_step();
        starts.push(trace.len() as u32);
    }
    drop(state);
    Cuts {
        ops: trace.into_ops(),
        starts,
    }
}

/// The tape, if at least the later half of the steps are equal.
fn cut(cuts: &Cuts) -> Option<Tape> {
    let count = cuts.starts.len() - 1;
    let mut bodies: Vec<Vec<Entry>> = (0..count).map(|step| body(cuts, step)).collect();
    let steady = bodies.pop()?;
    let first = bodies
        .iter()
        .rposition(|body| *body != steady)
        .map_or(0, |differing| differing + 1);
    if first > count / 2 {
        return None;
    }
    bodies.truncate(first);
    let before = cuts.ops[..cuts.starts[0] as usize].iter();
    Some(Tape {
        before: before
            .map(|&(node, op)| Entry {
                node,
                op: op.map(Ref::Before),
            })
            .collect(),
        transient: bodies,
        steady,
    })
}

fn body(cuts: &Cuts, step: usize) -> Vec<Entry> {
    let range = cuts.starts[step] as usize..cuts.starts[step + 1] as usize;
    let relative = |operand: u32| {
        if operand < cuts.starts[0] {
            return Ref::Before(operand);
        }
        let home = cuts.starts.partition_point(|&start| start <= operand) - 1;
        let index = operand - cuts.starts[home];
        match step - home {
            0 => Ref::Here(index),
            steps => Ref::Ago {
                steps: steps as u32,
                index,
            },
        }
    };
    cuts.ops[range]
        .iter()
        .map(|&(node, op): &(u32, Op<u32>)| Entry {
            node,
            op: op.map(relative),
        })
        .collect()
}

/// Runs through all steps once more, keeping only what comes from outside.
fn capture<A: Datapath, I: AsRef<[i32]>>(
    algorithm: &A,
    steps: &[I],
    transient: usize,
) -> Result<Inputs, TraceError> {
    let trace = Trace::default();
    let mut state = algorithm.start(&trace);
    trace.begin_steps();
    trace.forget();
    let mut inputs = Inputs {
        steps: steps.len(),
        ..Inputs::default()
    };
    let mut steady_path = None;
    for (step, given) in steps.iter().enumerate() {
        algorithm.step(&trace, &mut state, given.as_ref());
        let seen = trace.end_step();
        if step >= transient && *steady_path.get_or_insert(seen.path) != seen.path {
            return Err(TraceError::OtherPath { step });
        }
        inputs.raws.resize(seen.raws.len(), Vec::new());
        inputs.truths.resize(seen.truths.len(), Vec::new());
        for (port, raw) in inputs.raws.iter_mut().zip(seen.raws) {
            port.push(raw);
        }
        for (port, truth) in inputs.truths.iter_mut().zip(seen.truths) {
            port.push(truth);
        }
    }
    if inputs.raws.iter().any(|port| port.len() != steps.len())
        || inputs.truths.iter().any(|port| port.len() != steps.len())
    {
        // Transient steps took fewer or more inputs than the others.
        return Err(TraceError::OtherPath { step: transient });
    }
    Ok(inputs)
}
