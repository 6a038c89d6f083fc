//! The arithmetic that computes nothing and writes down what it was asked for.

use std::cell::{Cell, RefCell};

use cardan_datapath::{Arithmetic, Constant, Node, Table, Value};

use super::{NO_NODE, Op};

/// An operand: its number in the recording, and the node that holds it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Operand {
    pub(super) at: u64,
    pub(super) node: u32,
}

/// An operation with the node that takes its result.
pub(super) type Recorded = (u32, Op<Operand>);

/// Records the operations of one step after the other; words and truths are their numbers.
#[derive(Default)]
pub(super) struct Trace {
    /// Operations of the steps before this one.
    before: Cell<u64>,
    /// Of the current step.
    ops: RefCell<Vec<Recorded>>,
    raws: RefCell<Vec<i32>>,
    truths: RefCell<Vec<bool>>,
    stepping: Cell<bool>,
}

/// What a step did, and what it took from outside.
pub(super) struct StepSeen {
    pub(super) ops: Vec<Recorded>,
    pub(super) raws: Vec<i32>,
    pub(super) truths: Vec<bool>,
}

impl Trace {
    /// From now on steps follow; what was recorded so far stands before them.
    pub(super) fn begin_steps(&self) -> Vec<Recorded> {
        self.stepping.set(true);
        self.end_step().ops
    }

    /// Ends a step.
    pub(super) fn end_step(&self) -> StepSeen {
        let seen = StepSeen {
            ops: self.ops.take(),
            raws: self.raws.take(),
            truths: self.truths.take(),
        };
        self.before.set(self.before.get() + seen.ops.len() as u64);
        seen
    }

    /// The number of the operation that comes next.
    pub(super) fn next(&self) -> u64 {
        self.before.get() + self.ops.borrow().len() as u64
    }

    fn push(&self, node: u32, op: Op<Operand>) -> u64 {
        let number = self.next();
        self.ops.borrow_mut().push((node, op));
        number
    }

    fn value<N: Node>(&self, op: Op<Operand>) -> Value<Self, N> {
        Value::new(self.push(N::INDEX as u32, op))
    }

    fn bool(&self, op: Op<Operand>) -> u64 {
        self.push(NO_NODE, op)
    }
}

/// A value as an operand.
fn of<N: Node>(value: Value<Trace, N>) -> Operand {
    Operand {
        at: value.word(),
        node: N::INDEX as u32,
    }
}

/// A truth as an operand.
const fn truth_of(at: u64) -> Operand {
    Operand { at, node: NO_NODE }
}

impl Arithmetic for Trace {
    type Word<N: Node> = u64;
    type Bool = u64;

    fn input<N: Node, const F: u32>(&self, raw: i32) -> Value<Self, N> {
        let mut raws = self.raws.borrow_mut();
        let port = raws.len() as u32;
        raws.push(raw);
        let frac = F.cast_signed();
        self.value(Op::Input { port, frac })
    }

    fn parameter<N: Node, const F: u32>(&self, raw: i32) -> Value<Self, N> {
        let frac = F.cast_signed();
        self.value(Op::Parameter { raw, frac })
    }

    fn constant<N: Node, C: Constant>(&self) -> Value<Self, N> {
        self.value(Op::Constant(C::VALUE))
    }

    fn entry<N: Node, T: Table>(&self, index: usize) -> Value<Self, N> {
        self.value(Op::Constant(T::VALUES[index.min(T::VALUES.len() - 1)]))
    }

    fn lookup<N: Node, I: Node, T: Table>(&self, index: Value<Self, I>) -> Value<Self, N> {
        self.value(Op::Lookup(of(index), T::VALUES))
    }

    fn add<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Add(of(a), of(b)))
    }

    fn sub<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Sub(of(a), of(b)))
    }

    fn mul<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Mul(of(a), of(b)))
    }

    fn div<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Div(of(a), of(b)))
    }

    fn sqrt<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.value(Op::Sqrt(of(a)))
    }

    fn shift<N: Node, A: Node, const POWER: i32>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.value(Op::Shift(of(a), POWER))
    }

    fn scale<N: Node, A: Node, const LEAST: i32, const MOST: i32>(
        &self,
        a: Value<Self, A>,
        power: i32,
    ) -> Value<Self, N> {
        self.value(Op::Shift(of(a), power.min(MOST).max(LEAST)))
    }

    fn neg<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.value(Op::Neg(of(a)))
    }

    fn abs<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.value(Op::Abs(of(a)))
    }

    fn less<A: Node, B: Node>(&self, a: Value<Self, A>, b: Value<Self, B>) -> u64 {
        self.bool(Op::Less(of(a), of(b)))
    }

    fn negative<A: Node>(&self, a: Value<Self, A>) -> u64 {
        self.bool(Op::Negative(of(a)))
    }

    fn truth(&self, value: bool) -> u64 {
        if !self.stepping.get() {
            return self.bool(Op::Known(value));
        }
        let mut truths = self.truths.borrow_mut();
        let port = truths.len() as u32;
        truths.push(value);
        self.bool(Op::External { port })
    }

    fn not(&self, a: u64) -> u64 {
        self.bool(Op::Not(truth_of(a)))
    }

    fn or(&self, a: u64, b: u64) -> u64 {
        self.bool(Op::Or(truth_of(a), truth_of(b)))
    }

    fn xor(&self, a: u64, b: u64) -> u64 {
        self.bool(Op::Xor(truth_of(a), truth_of(b)))
    }

    fn either(&self, condition: u64, a: u64, b: u64) -> u64 {
        self.bool(Op::Either(truth_of(condition), truth_of(a), truth_of(b)))
    }

    fn select<N: Node, A: Node, B: Node>(
        &self,
        condition: u64,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Select(truth_of(condition), of(a), of(b)))
    }

    fn raise(&self, flags: u16, condition: u64) {
        self.bool(Op::Raise(flags, truth_of(condition)));
    }

    fn take_status(&self) -> u16 {
        0
    }
}
