//! An algorithm recorded once as data flow, for every analysis that is not a single run.
//!
//! A [`Datapath`](crate::Datapath) takes the same path in every step, so the operations
//! of one step, with references to their operands, are the whole algorithm: a straight line
//! without branches. What a step takes from earlier ones needs no declaration: it is a reference
//! to an operation some steps ago ([`Ref::Ago`]). The first steps may differ (initial values);
//! from some step on all are equal ([`Tape::steady`]).

mod adjoint;
mod affine;
mod bound;
mod build;
mod flow;
mod follow;
mod interval;
mod noise;
mod real;
mod run;
mod settings;
mod trace;
mod uncertainty;
mod words;

pub use adjoint::{Reals, gains};
pub use affine::affine_bounds;
pub use bound::Interval;
pub use build::TraceError;
pub use flow::{Edge, Flow};
pub use follow::Follower;
pub use interval::bounds;
pub use noise::rounding_noise;
pub use real::Real;
pub use run::{Domain, Runner};
pub use settings::beyond;
pub use uncertainty::{Expected, Raised, Uncertain, Uncertainty};
pub use words::{Words, WriteCounts};
pub(crate) use words::{compute, decide};

/// Where an operand comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Ref {
    /// An operation of the same step.
    Here(u32),
    /// An operation before the first step.
    Before(u32),
    /// An operation of an earlier step.
    Ago {
        /// How many steps ago, from 1.
        steps: u32,
        /// Its index in that step.
        index: u32,
    },
}

/// An operation on operands of type `R`. Truths are values too: 0 or 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Op<R> {
    /// The step's input number `port`, over 2^frac.
    Input {
        /// Which of the step's inputs, from 0.
        port: u32,
        /// Fractional bits of the raw input.
        frac: i32,
    },
    /// A setting: raw / 2^frac.
    Parameter {
        /// The raw setting.
        raw: i32,
        /// Its fractional bits.
        frac: i32,
    },
    /// A constant, or an entry of a table.
    Constant(f64),
    /// The table entry at the integer part of the operand, limited to the table.
    Lookup(R, &'static [f64]),
    /// Sum.
    Add(R, R),
    /// Difference.
    Sub(R, R),
    /// Product.
    Mul(R, R),
    /// Quotient.
    Div(R, R),
    /// Square root.
    Sqrt(R),
    /// a 2^power.
    Shift(R, i32),
    /// -a.
    Neg(R),
    /// |a|.
    Abs(R),
    /// The second operand if the first holds, else the third.
    Select(R, R, R),
    /// a < b.
    Less(R, R),
    /// a < 0.
    Negative(R),
    /// The step's truth number `port` from outside.
    External {
        /// Which of the step's truths, from 0.
        port: u32,
    },
    /// A truth known before the first step.
    Known(bool),
    /// Not a.
    Not(R),
    /// a or b.
    Or(R, R),
    /// Exactly one of a and b.
    Xor(R, R),
    /// The second operand if the first holds, else the third; truths.
    Either(R, R, R),
    /// Sets status bits if the operand holds.
    Raise(u16, R),
}

impl<R: Copy> Op<R> {
    /// The same operation on other operands.
    pub fn map<S>(self, mut f: impl FnMut(R) -> S) -> Op<S> {
        match self {
            Self::Input { port, frac } => Op::Input { port, frac },
            Self::Parameter { raw, frac } => Op::Parameter { raw, frac },
            Self::Constant(value) => Op::Constant(value),
            Self::Lookup(index, table) => Op::Lookup(f(index), table),
            Self::Add(a, b) => Op::Add(f(a), f(b)),
            Self::Sub(a, b) => Op::Sub(f(a), f(b)),
            Self::Mul(a, b) => Op::Mul(f(a), f(b)),
            Self::Div(a, b) => Op::Div(f(a), f(b)),
            Self::Sqrt(a) => Op::Sqrt(f(a)),
            Self::Shift(a, power) => Op::Shift(f(a), power),
            Self::Neg(a) => Op::Neg(f(a)),
            Self::Abs(a) => Op::Abs(f(a)),
            Self::Select(c, a, b) => Op::Select(f(c), f(a), f(b)),
            Self::Less(a, b) => Op::Less(f(a), f(b)),
            Self::Negative(a) => Op::Negative(f(a)),
            Self::External { port } => Op::External { port },
            Self::Known(value) => Op::Known(value),
            Self::Not(a) => Op::Not(f(a)),
            Self::Or(a, b) => Op::Or(f(a), f(b)),
            Self::Xor(a, b) => Op::Xor(f(a), f(b)),
            Self::Either(c, a, b) => Op::Either(f(c), f(a), f(b)),
            Self::Raise(flags, a) => Op::Raise(flags, f(a)),
        }
    }

    /// The same operation on references to the operands.
    pub fn as_ref(&self) -> Op<&R> {
        match self {
            Self::Input { port, frac } => Op::Input {
                port: *port,
                frac: *frac,
            },
            Self::Parameter { raw, frac } => Op::Parameter {
                raw: *raw,
                frac: *frac,
            },
            Self::Constant(value) => Op::Constant(*value),
            Self::Lookup(index, table) => Op::Lookup(index, table),
            Self::Add(a, b) => Op::Add(a, b),
            Self::Sub(a, b) => Op::Sub(a, b),
            Self::Mul(a, b) => Op::Mul(a, b),
            Self::Div(a, b) => Op::Div(a, b),
            Self::Sqrt(a) => Op::Sqrt(a),
            Self::Shift(a, power) => Op::Shift(a, *power),
            Self::Neg(a) => Op::Neg(a),
            Self::Abs(a) => Op::Abs(a),
            Self::Select(c, a, b) => Op::Select(c, a, b),
            Self::Less(a, b) => Op::Less(a, b),
            Self::Negative(a) => Op::Negative(a),
            Self::External { port } => Op::External { port: *port },
            Self::Known(value) => Op::Known(*value),
            Self::Not(a) => Op::Not(a),
            Self::Or(a, b) => Op::Or(a, b),
            Self::Xor(a, b) => Op::Xor(a, b),
            Self::Either(c, a, b) => Op::Either(c, a, b),
            Self::Raise(flags, a) => Op::Raise(*flags, a),
        }
    }

    /// The operands in order.
    #[must_use]
    pub fn operands(self) -> Vec<R> {
        let mut operands = Vec::new();
        self.map(|operand| operands.push(operand));
        operands
    }

    /// True for what a node's recording holds: constants and settings never change.
    #[must_use]
    pub const fn is_recorded(&self) -> bool {
        !matches!(self, Self::Parameter { .. } | Self::Constant(_))
    }
}

/// Node number of operations that belong to none: those on truths.
pub const NO_NODE: u32 = u32::MAX;

/// An operation and the node that takes its result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// The node, [`NO_NODE`] for truths.
    pub node: u32,
    /// The operation.
    pub op: Op<Ref>,
}

/// A recorded algorithm.
#[derive(Clone, Debug, PartialEq)]
pub struct Tape {
    /// Before the first step.
    pub before: Vec<Entry>,
    /// The first steps, as long as they differ from the following.
    pub transient: Vec<Vec<Entry>>,
    /// Every further step.
    pub steady: Vec<Entry>,
}

/// What a run takes from outside: per step its raw inputs and truths.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Per port, per step: raw words.
    pub raws: Vec<Vec<i32>>,
    /// Per port, per step: truths.
    pub truths: Vec<Vec<bool>>,
    /// Number of steps.
    pub steps: usize,
}

impl Tape {
    /// The operations of step `step`.
    #[must_use]
    pub fn body(&self, step: usize) -> &[Entry] {
        self.transient.get(step).unwrap_or(&self.steady)
    }

    /// The node of an operand of a steady operation.
    #[must_use]
    pub fn node_of(&self, operand: Ref) -> u32 {
        match operand {
            Ref::Here(index) | Ref::Ago { index, .. } => self.steady[index as usize].node,
            Ref::Before(index) => self.before[index as usize].node,
        }
    }

    /// How many steps back the operations of any step look.
    #[must_use]
    pub fn memory(&self) -> usize {
        let bodies = self.transient.iter().chain([&self.steady]);
        let operands = bodies.flatten().flat_map(|entry| entry.op.operands());
        let ago = operands.map(|operand| match operand {
            Ref::Ago { steps, .. } => steps as usize,
            Ref::Here(_) | Ref::Before(_) => 0,
        });
        ago.max().unwrap_or(0)
    }

    /// Index of the last write of `node` in a steady step.
    #[must_use]
    pub fn last_write(&self, node: usize) -> Option<usize> {
        last_write(&self.steady, node)
    }

    /// Index of the last write of `node` in step `step`.
    #[must_use]
    pub fn last_write_in(&self, step: usize, node: usize) -> Option<usize> {
        last_write(self.body(step), node)
    }
}

fn last_write(body: &[Entry], node: usize) -> Option<usize> {
    let written = |entry: &Entry| entry.node as usize == node && entry.op.is_recorded();
    body.iter().rposition(written)
}
