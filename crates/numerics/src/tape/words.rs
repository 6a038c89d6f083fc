//! A tape on words in run-time formats: the exact reference for everything faster.

use cardan_datapath::{Format, Overflow};

use super::{Domain, Op};
use crate::Overflows;
use crate::exact::{self, Fitted, Word};

/// Counts of one node's writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteCounts {
    /// Values written.
    pub writes: u64,
    /// Those that did not fit.
    pub overflows: Overflows,
}

/// The words of a run in `formats`; the raw word of every item is its result.
pub struct Words<'a> {
    formats: &'a [Format],
    domain_flag: u16,
    /// Status bits raised since they were last taken.
    pub status: u16,
    /// Per node.
    pub counts: Vec<WriteCounts>,
}

/// A word or, with the raw word 0 or 1, a truth.
pub(crate) type Item = Word;

/// A truth as an item.
pub(crate) const fn truth(value: bool) -> Item {
    Word {
        raw: value as i64,
        frac: 0,
    }
}

impl<'a> Words<'a> {
    /// One format per node; the arithmetic's own status bit is `domain_flag`.
    #[must_use]
    pub fn new(formats: &'a [Format], domain_flag: u16) -> Self {
        Self {
            formats,
            domain_flag,
            status: 0,
            counts: vec![WriteCounts::default(); formats.len()],
        }
    }

    fn write(&mut self, node: usize, (raw, overflow): Fitted) -> Item {
        let item = self.known(node, (raw, overflow));
        self.counts[node].writes += 1;
        item
    }

    /// As a write, for settings and constants, which are none.
    fn known(&mut self, node: usize, (raw, overflow): Fitted) -> Item {
        let format = self.formats[node];
        let counts = &mut self.counts[node];
        if overflow {
            counts.overflows.count += 1;
            counts.overflows.first.get_or_insert(counts.writes);
            if format.overflow == Overflow::Trap {
                self.status |= self.domain_flag;
            }
        }
        Word {
            raw,
            frac: format.frac,
        }
    }
}

/// What an operation of words gives in `format`; the flag tells a failure of the operation itself (a
/// zero divisor, a negative radicand).
pub(crate) fn compute(op: Op<&Item>, format: Format) -> (Fitted, bool) {
    let convert = |a: Word, raw: i128, power: i32| {
        exact::fit(raw, a.frac.cast_signed().saturating_sub(power), format)
    };
    let fitted = match op {
        Op::Parameter { raw, frac } => exact::fit(raw.into(), frac, format),
        Op::Constant(value) => (format.constant(value), false),
        Op::Lookup(index, table) => {
            let last = table.len() as i128 - 1;
            let at = (i128::from(index.raw) >> index.frac).clamp(0, last) as usize;
            (format.constant(table[at]), false)
        }
        Op::Add(a, b) => exact::sum(*a, *b, false, format),
        Op::Sub(a, b) => exact::sum(*a, *b, true, format),
        Op::Mul(a, b) => exact::product(*a, *b, format),
        Op::Div(a, b) if b.raw == 0 => {
            let end = if a.raw < 0 {
                format.min_raw()
            } else {
                format.max_raw()
            };
            return ((end, true), true);
        }
        Op::Div(a, b) => exact::quotient(*a, *b, format),
        Op::Sqrt(a) => {
            let radicand = Word {
                raw: a.raw.max(0),
                ..*a
            };
            return (exact::root(radicand, format), a.raw < 0);
        }
        Op::Shift(a, power) => convert(*a, a.raw.into(), power),
        Op::Neg(a) => convert(*a, -i128::from(a.raw), 0),
        Op::Abs(a) => convert(*a, i128::from(a.raw).abs(), 0),
        Op::Select(c, a, b) => {
            let chosen = if c.raw != 0 { a } else { b };
            convert(*chosen, chosen.raw.into(), 0)
        }
        _ => (0, false),
    };
    (fitted, false)
}

/// What an operation with a truth as its result gives; `None` for the others.
pub(crate) fn decide(op: Op<&Item>) -> Option<bool> {
    let holds = |a: &Item| a.raw != 0;
    Some(match op {
        Op::Less(a, b) => exact::less(*a, *b),
        Op::Negative(a) => a.raw < 0,
        Op::Known(value) => value,
        Op::Not(a) => !holds(a),
        Op::Or(a, b) => holds(a) || holds(b),
        Op::Xor(a, b) => holds(a) != holds(b),
        Op::Either(c, a, b) => holds(if holds(c) { a } else { b }),
        Op::Raise(_, a) => holds(a),
        _ => return None,
    })
}

impl Domain for Words<'_> {
    type Item = Item;

    fn input(&mut self, node: usize, _port: usize, raw: i32, frac: i32) -> Item {
        let fitted = exact::fit(raw.into(), frac, self.formats[node]);
        self.write(node, fitted)
    }

    fn external(&mut self, _port: usize, value: bool) -> Item {
        truth(value)
    }

    fn apply(&mut self, node: usize, op: Op<&Item>) -> Item {
        if let Some(value) = decide(op) {
            if let Op::Raise(flags, _) = op
                && value
            {
                self.status |= flags;
            }
            return truth(value);
        }
        let format = self.formats[node];
        let (fitted, failed) = compute(op, format);
        if failed {
            self.status |= self.domain_flag;
        }
        if op.is_recorded() {
            self.write(node, fitted)
        } else {
            self.known(node, fitted)
        }
    }
}
