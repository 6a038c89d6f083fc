//! How an operation is computed in given formats: in which intermediate, with which shifts.

use cardan_datapath::{Format, Overflow, Rounding};

use crate::tape::{Entry, NO_NODE, Op, Ref, Tape};

/// What truths have in place of a format.
pub(super) const TRUTH: Format = Format::new(1, 0, Rounding::Floor, Overflow::Saturate);

/// The intermediate that suffices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Class {
    /// 32 bits.
    Narrow,
    /// 64 bits.
    Wide,
    /// More, or a case that the fast paths leave out.
    #[default]
    Exact,
}

/// How an operation is computed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    pub(super) class: Class,
    pub(super) format: Format,
    /// Left shifts that align the operands.
    pub(super) align: [u32; 2],
    /// Fractional bits of the exact result, less those of the format.
    pub(super) drop: i32,
    /// The result's column is narrow.
    pub(super) is_narrow: bool,
    /// Fractional bits of the operands.
    pub(super) fracs: [u32; 3],
    /// Which operands are truths.
    pub(super) truths: [bool; 3],
}

impl Default for Plan {
    fn default() -> Self {
        Self {
            class: Class::Exact,
            format: TRUTH,
            align: [0; 2],
            drop: 0,
            is_narrow: true,
            fracs: [0; 3],
            truths: [false; 3],
        }
    }
}

/// The exact result of an operation: its fractional bits, and m with |raw| <= 2^m.
struct Exact {
    frac: i32,
    bits: u32,
    align: [u32; 2],
}

impl Plan {
    pub(super) fn new(tape: &Tape, entry: &Entry, formats: &[Format], port_bits: &[u32]) -> Self {
        let is_truth = entry.node == NO_NODE;
        let format = if is_truth {
            TRUTH
        } else {
            formats[entry.node as usize]
        };
        let format_of = |operand: Ref| match tape.node_of(operand) {
            NO_NODE => TRUTH,
            node => formats[node as usize],
        };
        let mut plan = Self {
            format,
            is_narrow: format.word <= i32::BITS,
            ..Self::default()
        };
        for (at, operand) in entry.op.operands().into_iter().enumerate() {
            plan.fracs[at] = format_of(operand).frac;
            plan.truths[at] = tape.node_of(operand) == NO_NODE;
        }
        let Some(exact) = exact(entry.op.map(format_of), format, port_bits) else {
            return plan;
        };
        plan.align = exact.align;
        plan.drop = exact.frac.saturating_sub(format.frac.cast_signed());
        let operands_narrow = entry
            .op
            .operands()
            .into_iter()
            .all(|operand| format_of(operand).word <= i32::BITS);
        plan.class = class(
            &entry.op,
            &exact,
            plan.drop,
            plan.is_narrow && operands_narrow,
        );
        if super::traps(format) {
            // Which steps overflow must be known one by one.
            plan.class = Class::Exact;
        }
        plan
    }
}

fn class<R>(op: &Op<R>, exact: &Exact, drop: i32, is_narrow: bool) -> Class {
    let bits = exact.bits;
    if matches!(op, Op::Less(..)) {
        return match bits {
            0..=31 if is_narrow => Class::Narrow,
            0..=63 => Class::Wide,
            _ => Class::Exact,
        };
    }
    if matches!(op, Op::Div(..) | Op::Sqrt(_)) {
        // Through f64, whose integers are exact to 53 bits.
        return if bits <= 50 {
            Class::Wide
        } else {
            Class::Exact
        };
    }
    // Rounding needs a bit above the result, shifts left need their bits.
    let needed = if drop >= 0 {
        bits.max(drop.unsigned_abs())
    } else {
        bits.saturating_add(drop.unsigned_abs())
    };
    match needed {
        0..=30 if is_narrow => Class::Narrow,
        0..=62 => Class::Wide,
        _ => Class::Exact,
    }
}

/// The exact result of an operation on operands of these formats; `None` if no fast path has it.
fn exact(op: Op<Format>, format: Format, port_bits: &[u32]) -> Option<Exact> {
    let plain = |frac: i32, bits: u32| Exact {
        frac,
        bits,
        align: [0; 2],
    };
    let pair = |a: Format, b: Format, carry: u32| {
        let frac = a.frac.max(b.frac);
        let align = [frac - a.frac, frac - b.frac];
        Exact {
            frac: frac.cast_signed(),
            bits: (a.word - 1 + align[0]).max(b.word - 1 + align[1]) + carry,
            align,
        }
    };
    Some(match op {
        Op::Input { port, frac } => plain(frac, port_bits[port as usize]),
        Op::Add(a, b) | Op::Sub(a, b) => pair(a, b, 1),
        Op::Less(a, b) | Op::Select(_, a, b) => pair(a, b, 0),
        Op::Mul(a, b) => plain((a.frac + b.frac).cast_signed(), a.word + b.word - 2),
        Op::Shift(a, power) => plain(a.frac.cast_signed().saturating_sub(power), a.word - 1),
        Op::Neg(a) | Op::Abs(a) => plain(a.frac.cast_signed(), a.word - 1),
        Op::Div(a, b) => {
            let up = (format.frac + b.frac).cast_signed() - a.frac.cast_signed();
            let align = [up.max(0).unsigned_abs(), up.min(0).unsigned_abs()];
            Exact {
                frac: format.frac.cast_signed(),
                bits: (a.word - 1 + align[0]).max(b.word - 1 + align[1]),
                align,
            }
        }
        Op::Sqrt(a) => {
            let up = 2 * format.frac.cast_signed() - a.frac.cast_signed();
            let up = u32::try_from(up).ok()?;
            Exact {
                frac: format.frac.cast_signed(),
                bits: a.word - 1 + up,
                align: [up, 0],
            }
        }
        Op::Negative(_)
        | Op::External { .. }
        | Op::Known(_)
        | Op::Not(_)
        | Op::Or(..)
        | Op::Xor(..)
        | Op::Either(..)
        | Op::Raise(..) => plain(0, 1),
        Op::Constant(_) | Op::Parameter { .. } | Op::Lookup(..) => return None,
    })
}

/// Why formats cannot be deployed: the operation that would not build.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Violation {
    /// The node whose write it is; for a comparison, that of its first operand.
    pub node: usize,
    /// What is too wide.
    pub what: &'static str,
}

/// Whether the deployed arithmetic builds `tape` in `formats`: intermediates of at most 64 bits,
/// and square roots that keep at least half their argument's fractional bits.
///
/// # Errors
/// The first operation that it would refuse.
pub fn deployable(tape: &Tape, formats: &[Format]) -> Result<(), Violation> {
    let all = tape.before.iter().chain(&tape.steady);
    for entry in all.chain(tape.transient.iter().flatten()) {
        let format_of = |operand: Ref| match tape.node_of(operand) {
            NO_NODE => TRUTH,
            node => formats[node as usize],
        };
        let target = formats.get(entry.node as usize).copied();
        if let Some(what) = refused(entry.op.map(format_of), target) {
            let first = entry
                .op
                .operands()
                .first()
                .map_or(0, |first| tape.node_of(*first));
            let node = if target.is_some() { entry.node } else { first };
            return Err(Violation {
                node: node as usize,
                what,
            });
        }
    }
    Ok(())
}

/// The rules of [`cardan_datapath::Deployed`], which are build errors there.
fn refused(op: Op<Format>, target: Option<Format>) -> Option<&'static str> {
    let aligned = |word: u32, frac: u32, to: u32| word + to.saturating_sub(frac);
    let to = target.map_or(0, |format| format.frac);
    let (bits, most, what) = match op {
        Op::Input { frac, .. } | Op::Parameter { frac, .. } => {
            let frac = frac.unsigned_abs();
            let bits = if frac == to { 0 } else { aligned(33, frac, to) };
            (bits, 64, "an input")
        }
        Op::Add(a, b) | Op::Sub(a, b) => {
            let frac = a.frac.max(b.frac);
            let widest = aligned(a.word, a.frac, frac).max(aligned(b.word, b.frac, frac));
            (aligned(widest + 2, frac, to), 64, "a sum")
        }
        Op::Mul(a, b) => (
            aligned(a.word + b.word, a.frac + b.frac, to),
            64,
            "a product",
        ),
        Op::Div(a, b) => {
            let up = (to + b.frac).cast_signed() - a.frac.cast_signed();
            let n = a.word + up.max(0).unsigned_abs();
            let d = b.word + up.min(0).unsigned_abs();
            (n.max(d), 63, "a quotient")
        }
        Op::Sqrt(a) => {
            let up = 2 * to.cast_signed() - a.frac.cast_signed();
            let Ok(up) = u32::try_from(up) else {
                return Some("a square root that drops more than half its argument's places");
            };
            (a.word + up, 64, "a square root")
        }
        Op::Shift(a, power) => {
            let frac = a.frac.cast_signed() - power;
            let first = frac.min(0).unsigned_abs();
            let bits = aligned(a.word + first + 1, frac.max(0).unsigned_abs(), to);
            (bits, 64, "a shift")
        }
        Op::Neg(a) | Op::Abs(a) => (aligned(a.word + 2, a.frac, to), 64, "a negation"),
        Op::Select(_, a, b) => {
            let bits = aligned(a.word + 1, a.frac, to).max(aligned(b.word + 1, b.frac, to));
            (bits, 64, "a selection")
        }
        Op::Less(a, b) => {
            let frac = a.frac.max(b.frac);
            let bits = aligned(a.word, a.frac, frac).max(aligned(b.word, b.frac, frac));
            (bits, 64, "a comparison")
        }
        _ => return None,
    };
    (bits > most).then_some(what)
}
