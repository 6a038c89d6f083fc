//! From a recording to a tape: cutting it into steps, and finding from where on they are equal.
//!
//! Every step is compared with the one before in everything that it does. The steps run past the end
//! of the data, on the same inputs again: what a long delay line or a counter changes late shows
//! there, and what an `if` on an input changes shows a second time.

use super::trace::{Recorded, StepSeen, Trace};
use super::{Entry, Inputs, Op, Ref, Tape};
use crate::Datapath;

/// Steps that are looked at beyond the data, at least.
const AHEAD: usize = 4096;
/// How often the steps are doubled until the later half of them is equal.
const DOUBLINGS: usize = 2;
/// Operations of differing steps that are kept at most.
const MOST_KEPT: usize = 1 << 22;

/// Why an algorithm could not be recorded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TraceError {
    /// The steps do not become equal.
    #[error(
        "the algorithm's steps still differ after {steps} of them ({what}): a step must do the same \
         operations on the same operands each time (branch with `select`; what is kept for later \
         must be renewed in every step)"
    )]
    Unsteady {
        /// Steps that were looked at.
        steps: usize,
        /// How the last step that differs is other than the one before it.
        what: String,
    },
    /// A step took another path than the others.
    #[error(
        "step {step} does other operations than the steps before it ({what}), and later steps do as \
         they did: branch with `select`, never with `if` on an input or a counter"
    )]
    OtherPath {
        /// The step, from 0.
        step: usize,
        /// How it is other than the step before it.
        what: String,
    },
    /// There is nothing to run on.
    #[error("no input: give at least one step")]
    Empty,
}

impl Tape {
    /// Records `algorithm`, and what it takes from outside while it runs on `steps`, each the
    /// inputs of one step.
    ///
    /// Start-up steps are found up to the number of steps given, up to 4096, and for what lies in the
    /// state itself (not behind a pointer) up to its size, whichever is most.
    ///
    /// # Errors
    /// No steps, or steps that differ.
    pub fn record<A: Datapath, I: AsRef<[i32]>>(
        algorithm: &A,
        steps: &[I],
    ) -> Result<(Self, Inputs), TraceError> {
        Self::record_ahead(algorithm, steps, AHEAD)
    }

    /// As [`Tape::record`], looking at `ahead` steps beyond the data at least, in place of 4096.
    ///
    /// # Errors
    /// No steps, or steps that differ.
    pub fn record_ahead<A: Datapath, I: AsRef<[i32]>>(
        algorithm: &A,
        steps: &[I],
        ahead: usize,
    ) -> Result<(Self, Inputs), TraceError> {
        if steps.is_empty() {
            return Err(TraceError::Empty);
        }
        let trace = Trace::default();
        let mut state = algorithm.start(&trace);
        let mut history = History::new(trace.begin_steps());
        let mut inputs = Inputs::default();
        let mut step = |history: &mut History, at: usize| {
            let start = trace.next();
            algorithm.step(&trace, &mut state, steps[at % steps.len()].as_ref());
            let seen = trace.end_step();
            history.add(&seen, start)?;
            Ok(seen)
        };
        for at in 0..steps.len() {
            let seen = step(&mut history, at)?;
            keep(&mut inputs, &seen);
        }
        // A value of the state has the size of its number at least.
        let held = size_of::<A::State<Trace>>() / size_of::<u64>();
        let mut wanted = steps.len() + ahead.max(history.settled()).max(held);
        for doubling in 0.. {
            for at in history.steps()..wanted {
                step(&mut history, at)?;
            }
            if history.settled() <= wanted / 2 {
                break;
            }
            if doubling == DOUBLINGS {
                return Err(history.refusal());
            }
            wanted *= 2;
        }
        if history.settled() >= steps.len()
            && let Some(error) = history.other_path()
        {
            return Err(error);
        }
        Ok((history.into_tape()?, inputs))
    }
}

/// Adds what a step took from outside. A port that the step did not use is 0 in it.
pub(super) fn keep(inputs: &mut Inputs, seen: &StepSeen) {
    fn add<T: Copy + Default>(ports: &mut Vec<Vec<T>>, taken: &[T], steps: usize) {
        if ports.len() < taken.len() {
            ports.resize(taken.len(), vec![T::default(); steps]);
        }
        for (port, series) in ports.iter_mut().enumerate() {
            series.push(taken.get(port).copied().unwrap_or_default());
        }
    }
    add(&mut inputs.raws, &seen.raws, inputs.steps);
    add(&mut inputs.truths, &seen.truths, inputs.steps);
    inputs.steps += 1;
}

/// An operand as a step sees it, with its node.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Source {
    from: Ref,
    node: u32,
}

/// An operation of a step with the node that takes its result.
type Line = (u32, Op<Source>);

/// Equal steps in a row.
struct Run {
    /// The first of them.
    first: usize,
    body: Vec<Line>,
}

/// All steps so far.
struct History {
    before: Vec<Recorded>,
    /// Number of the first operation of each step.
    starts: Vec<u64>,
    runs: Vec<Run>,
    /// Operations in `runs`.
    kept: usize,
}

impl History {
    const fn new(before: Vec<Recorded>) -> Self {
        Self {
            before,
            starts: Vec::new(),
            runs: Vec::new(),
            kept: 0,
        }
    }

    const fn steps(&self) -> usize {
        self.starts.len()
    }

    /// The step from which on all are equal.
    fn settled(&self) -> usize {
        self.runs.last().map_or(0, |run| run.first)
    }

    /// Adds a step whose first operation has the number `start`.
    fn add(&mut self, seen: &StepSeen, start: u64) -> Result<(), TraceError> {
        let step = self.starts.len();
        self.starts.push(start);
        let lines = seen.ops.iter().map(|op| self.line(step, op));
        if let Some(last) = self.runs.last()
            && last.body.len() == seen.ops.len()
            && lines.clone().zip(&last.body).all(|(a, b)| is_same(&a, b))
        {
            return Ok(());
        }
        let body: Vec<Line> = lines.collect();
        self.kept += body.len();
        self.runs.push(Run { first: step, body });
        if self.kept > MOST_KEPT && self.runs.len() > 1 {
            return Err(self.refusal());
        }
        Ok(())
    }

    fn line(&self, step: usize, &(node, op): &Recorded) -> Line {
        let relative = |operand: super::trace::Operand| Source {
            from: self.from(step, operand.at),
            node: operand.node,
        };
        (node, op.map(relative))
    }

    /// Where a step finds the operation of that number.
    fn from(&self, step: usize, at: u64) -> Ref {
        if at >= self.starts[step] {
            return Ref::Here((at - self.starts[step]) as u32);
        }
        if at < self.starts[0] {
            return Ref::Before(at as u32);
        }
        let home = self.starts.partition_point(|&start| start <= at) - 1;
        Ref::Ago {
            steps: (step - home) as u32,
            index: (at - self.starts[home]) as u32,
        }
    }

    /// Why steps that do not settle are refused.
    fn refusal(&self) -> TraceError {
        self.other_path().unwrap_or_else(|| TraceError::Unsteady {
            steps: self.steps(),
            what: self.difference(self.runs.len() - 1),
        })
    }

    /// The first step that leaves a path to which later ones return.
    fn other_path(&self) -> Option<TraceError> {
        let left = (2..self.runs.len()).find_map(|back| {
            let is_same = |left: &usize| is_equal(&self.runs[*left].body, &self.runs[back].body);
            (0..back - 1).rev().find(is_same)
        })?;
        Some(TraceError::OtherPath {
            step: self.runs[left + 1].first,
            what: self.difference(left + 1),
        })
    }

    /// How the steps of a run are other than those of the run before it.
    fn difference(&self, run: usize) -> String {
        let Some(before) = run.checked_sub(1).and_then(|before| self.runs.get(before)) else {
            return "the first step".to_owned();
        };
        let pairs = before.body.iter().zip(&self.runs[run].body);
        let Some(at) = pairs.clone().position(|(a, b)| !is_same(a, b)) else {
            let (a, b) = (before.body.len(), self.runs[run].body.len());
            return format!("{b} operations, {a} before");
        };
        let (a, b) = (&before.body[at], &self.runs[run].body[at]);
        let number = at + 1;
        if std::mem::discriminant(&a.1) != std::mem::discriminant(&b.1) || a.0 != b.0 {
            format!("operation {number} is another one or writes another node")
        } else if a.1.operands() != b.1.operands() {
            format!("operation {number} takes other operands")
        } else {
            format!("operation {number} has another constant, setting, table, power or port")
        }
    }

    fn into_tape(mut self) -> Result<Tape, TraceError> {
        let settled = self.settled();
        let size: usize = (self.runs.windows(2))
            .map(|pair| (pair[1].first - pair[0].first) * pair[0].body.len())
            .sum();
        if size > MOST_KEPT {
            return Err(self.refusal());
        }
        let entries = |body: &[Line]| -> Vec<Entry> {
            let entry = |&(node, op): &Line| Entry {
                node,
                op: op.map(|source| source.from),
            };
            body.iter().map(entry).collect()
        };
        let steady = self.runs.pop().map(|run| entries(&run.body));
        let mut transient = Vec::with_capacity(settled);
        for (at, run) in self.runs.iter().enumerate() {
            let end = self.runs.get(at + 1).map_or(settled, |next| next.first);
            transient.resize(end, entries(&run.body));
        }
        let before = |&(node, op): &Recorded| Entry {
            node,
            op: op.map(|operand| Ref::Before(operand.at as u32)),
        };
        Ok(Tape {
            before: self.before.iter().map(before).collect(),
            transient,
            steady: steady.unwrap_or_default(),
        })
    }
}

fn is_equal(a: &[Line], b: &[Line]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| is_same(a, b))
}

/// Equal in everything: constants and tables bit for bit.
fn is_same(a: &Line, b: &Line) -> bool {
    a.0 == b.0 && is_same_operation(&a.1, &b.1)
}

/// Equal in everything but the node: constants and tables bit for bit.
pub(super) fn is_same_operation<R: PartialEq>(a: &Op<R>, b: &Op<R>) -> bool {
    let bits = |a: &f64, b: &f64| a.to_bits() == b.to_bits();
    match (a, b) {
        (Op::Constant(a), Op::Constant(b)) => bits(a, b),
        (Op::Lookup(a, first), Op::Lookup(b, second)) => {
            let is_one = std::ptr::eq(*first, *second);
            let pairs = || first.iter().zip(*second).all(|(a, b)| bits(a, b));
            a == b && (is_one || first.len() == second.len() && pairs())
        }
        (a, b) => a == b,
    }
}
