//! The arithmetic that computes nothing and writes down what it was asked for.

use std::cell::{Cell, RefCell};
use std::hash::{DefaultHasher, Hash, Hasher};

use cardan_datapath::{Arithmetic, Constant, Node, Table, Value};

use super::{NO_NODE, Op};

/// An operation with operands by their number in the recording.
pub(super) type Recorded = (u32, Op<u32>);

/// Records operations; words and truths are their numbers.
#[derive(Default)]
pub(super) struct Trace {
    ops: RefCell<Vec<Recorded>>,
    /// Of the current step.
    raws: RefCell<Vec<i32>>,
    truths: RefCell<Vec<bool>>,
    /// Which operations the current step did, in brief.
    path: RefCell<DefaultHasher>,
    stepping: Cell<bool>,
    forgetful: Cell<bool>,
}

/// What a step took from outside, and which way it went.
pub(super) struct StepSeen {
    pub(super) raws: Vec<i32>,
    pub(super) truths: Vec<bool>,
    pub(super) path: u64,
}

impl Trace {
    /// From now on steps follow.
    pub(super) fn begin_steps(&self) {
        self.stepping.set(true);
        self.path.take();
    }

    /// From now on operations are only counted.
    pub(super) fn forget(&self) {
        self.forgetful.set(true);
    }

    /// Operations recorded so far.
    pub(super) fn len(&self) -> usize {
        self.ops.borrow().len()
    }

    /// Ends a step.
    pub(super) fn end_step(&self) -> StepSeen {
        StepSeen {
            raws: self.raws.take(),
            truths: self.truths.take(),
            path: self.path.take().finish(),
        }
    }

    /// The recording.
    pub(super) fn into_ops(self) -> Vec<Recorded> {
        self.ops.into_inner()
    }

    fn push(&self, node: u32, op: Op<u32>) -> u32 {
        let mut path = self.path.borrow_mut();
        (node, std::mem::discriminant(&op)).hash(&mut *path);
        let mut ops = self.ops.borrow_mut();
        if !self.forgetful.get() {
            ops.push((node, op));
        }
        u32::try_from(ops.len().saturating_sub(1)).unwrap_or(u32::MAX)
    }

    fn value<N: Node>(&self, op: Op<u32>) -> Value<Self, N> {
        Value::new(self.push(N::INDEX as u32, op))
    }

    fn bool(&self, op: Op<u32>) -> u32 {
        self.push(NO_NODE, op)
    }
}

impl Arithmetic for Trace {
    type Word<N: Node> = u32;
    type Bool = u32;

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
        self.value(Op::Lookup(index.word(), T::VALUES))
    }

    fn add<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Add(a.word(), b.word()))
    }

    fn sub<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Sub(a.word(), b.word()))
    }

    fn mul<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Mul(a.word(), b.word()))
    }

    fn div<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Div(a.word(), b.word()))
    }

    fn sqrt<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.value(Op::Sqrt(a.word()))
    }

    fn shift<N: Node, A: Node, const POWER: i32>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.value(Op::Shift(a.word(), POWER))
    }

    fn scale<N: Node, A: Node, const LEAST: i32, const MOST: i32>(
        &self,
        a: Value<Self, A>,
        power: i32,
    ) -> Value<Self, N> {
        self.value(Op::Shift(a.word(), power.min(MOST).max(LEAST)))
    }

    fn neg<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.value(Op::Neg(a.word()))
    }

    fn abs<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.value(Op::Abs(a.word()))
    }

    fn less<A: Node, B: Node>(&self, a: Value<Self, A>, b: Value<Self, B>) -> u32 {
        self.bool(Op::Less(a.word(), b.word()))
    }

    fn negative<A: Node>(&self, a: Value<Self, A>) -> u32 {
        self.bool(Op::Negative(a.word()))
    }

    fn truth(&self, value: bool) -> u32 {
        if !self.stepping.get() {
            return self.bool(Op::Known(value));
        }
        let mut truths = self.truths.borrow_mut();
        let port = truths.len() as u32;
        truths.push(value);
        self.bool(Op::External { port })
    }

    fn not(&self, a: u32) -> u32 {
        self.bool(Op::Not(a))
    }

    fn or(&self, a: u32, b: u32) -> u32 {
        self.bool(Op::Or(a, b))
    }

    fn xor(&self, a: u32, b: u32) -> u32 {
        self.bool(Op::Xor(a, b))
    }

    fn either(&self, condition: u32, a: u32, b: u32) -> u32 {
        self.bool(Op::Either(condition, a, b))
    }

    fn select<N: Node, A: Node, B: Node>(
        &self,
        condition: u32,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        self.value(Op::Select(condition, a.word(), b.word()))
    }

    fn raise(&self, flags: u16, condition: u32) {
        self.bool(Op::Raise(flags, condition));
    }

    fn take_status(&self) -> u16 {
        0
    }
}
