//! Estimated cycles of a step on an 8-bit controller: how often the deployed arithmetic takes each of
//! its ways, times what that way costs there.
//!
//! The ways are those of `cardan_datapath::Deployed`: kernels for 16-bit words (rounded to nearest,
//! saturated), intermediates of 32 or 64 bits for everything else. The estimate is linear in its
//! coefficients, so that they can be fitted to measured images.

use cardan_datapath::wordlengths::container_bits;
use cardan_datapath::{Format, Overflow, Rounding};
use cardan_numerics::tape::{Entry, NO_NODE, Op, Ref, Tape};
use serde::{Deserialize, Serialize};

use super::operand;
use crate::problem::Problem;

/// A cost in intermediates of 32 and of 64 bits.
pub type Pair = [f64; 2];

/// Cycles of each way, or how often it is taken.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Cycles {
    /// What a step takes besides.
    pub fixed: f64,
    /// A byte of a result's container.
    pub byte: f64,
    /// Kernels of 16-bit words: sum, negation, magnitude.
    pub kernel_add: f64,
    /// Rounded product.
    pub kernel_multiply: f64,
    /// Product that is kept in 31 bits.
    pub kernel_wide: f64,
    /// Quotient.
    pub kernel_divide: f64,
    /// Square root.
    pub kernel_root: f64,
    /// A 32-bit intermediate rounded by 14 or 15 bits.
    pub kernel_round: f64,
    /// A doubling with saturation.
    pub kernel_double: f64,
    /// Product of two 16-bit words as a 32-bit intermediate.
    pub product: f64,
    /// Sum, negation, comparison in an intermediate.
    pub add: Pair,
    /// Product in an intermediate.
    pub multiply: Pair,
    /// Quotient.
    pub divide: Pair,
    /// Square root.
    pub root: Pair,
    /// Shift, per bit that is no whole byte.
    pub shift: Pair,
    /// Rounding to nearest.
    pub round: Pair,
    /// Saturation.
    pub saturate: Pair,
}

impl Cycles {
    /// Number of coefficients.
    pub const COUNT: usize = 24;

    /// All coefficients, in the order of the fields.
    #[must_use]
    pub fn to_array(&self) -> [f64; Self::COUNT] {
        let (a, m, d, r) = (self.add, self.multiply, self.divide, self.root);
        let (s, n, l) = (self.shift, self.round, self.saturate);
        [
            self.fixed,
            self.byte,
            self.kernel_add,
            self.kernel_multiply,
            self.kernel_wide,
            self.kernel_divide,
            self.kernel_root,
            self.kernel_round,
            self.kernel_double,
            self.product,
            a[0],
            a[1],
            m[0],
            m[1],
            d[0],
            d[1],
            r[0],
            r[1],
            s[0],
            s[1],
            n[0],
            n[1],
            l[0],
            l[1],
        ]
    }

    /// The estimate for these counts.
    #[must_use]
    pub fn of(&self, counts: &Self) -> f64 {
        let products = self.to_array().into_iter().zip(counts.to_array());
        products.map(|(cycles, count)| cycles * count).sum()
    }
}

/// How often a step takes each way. What the problem says to run elsewhere (in an interrupt) does not
/// count.
#[must_use]
pub fn counts(problem: &Problem, tape: &Tape, formats: &[Format]) -> Cycles {
    let mut counts = Cycles {
        fixed: 1.0,
        ..Cycles::default()
    };
    for entry in &tape.steady {
        let node = entry.node as usize;
        if !problem.background.contains(&node) {
            count(tape, formats, entry, &mut counts);
        }
    }
    counts
}

/// An intermediate: its fractional bits, and the bits that it takes once aligned to the result.
struct Intermediate {
    frac: u32,
    bits: u32,
}

impl Intermediate {
    fn new(bits: u32, frac: u32, own: Format) -> Self {
        let bits = bits + own.frac.saturating_sub(frac);
        Self { frac, bits }
    }

    /// Index into a [`Pair`].
    fn size(&self) -> usize {
        usize::from(self.bits > 32)
    }
}

fn is_kernel_word(format: Format) -> bool {
    format.word == 16
        && format.rounding == Rounding::NearestUp
        && format.overflow == Overflow::Saturate
}

fn count(tape: &Tape, formats: &[Format], entry: &Entry, counts: &mut Cycles) {
    let of = |at: Ref| operand(tape, formats, at);
    let Some(&own) = formats
        .get(entry.node as usize)
        .filter(|_| entry.node != NO_NODE)
    else {
        if let Op::Less(a, b) = entry.op {
            let (a, b) = (of(a), of(b));
            let bits = |x: Format, y: Format| x.word + y.frac.saturating_sub(x.frac);
            counts.add[usize::from(bits(a, b).max(bits(b, a)) > 32)] += 1.0;
        }
        return;
    };
    if !entry.op.is_recorded() {
        return;
    }
    counts.byte += f64::from(container_bits(own.word)) / 8.0;
    let is_small = |format: Format| format.word <= 16;
    match entry.op {
        Op::Add(a, b) | Op::Sub(a, b) => {
            let (a, b) = (of(a), of(b));
            if own.word == 16 && [a, b].iter().all(|x| x.word == 16 && x.frac == own.frac) {
                counts.kernel_add += 1.0;
                return;
            }
            let frac = a.frac.max(b.frac);
            let bits = (a.word + frac - a.frac).max(b.word + frac - b.frac) + 1;
            let wide = Intermediate::new(bits, frac, own);
            counts.add[wide.size()] += 1.0;
            fit(&wide, own, counts);
        }
        Op::Mul(a, b) => {
            let (a, b) = (of(a), of(b));
            let wide = Intermediate::new(a.word + b.word, a.frac + b.frac, own);
            let shift = wide.frac.wrapping_sub(own.frac);
            if !(is_small(a) && is_small(b) && wide.bits <= 32) {
                counts.multiply[wide.size()] += 1.0;
            } else if is_kernel_word(own) && (12..=16).contains(&shift) {
                counts.kernel_multiply += 1.0;
                return;
            } else if own.word == 31 && shift == 0 && own.overflow == Overflow::Saturate {
                counts.kernel_wide += 1.0;
                return;
            } else {
                counts.product += 1.0;
            }
            fit(&wide, own, counts);
        }
        Op::Div(a, b) => {
            let (a, b) = (of(a), of(b));
            let up = (own.frac + b.frac).cast_signed() - a.frac.cast_signed();
            if is_kernel_word(own) && is_small(a) && is_small(b) && (up == 14 || up == 15) {
                counts.kernel_divide += 1.0;
                return;
            }
            let bits = (a.word + up.max(0).unsigned_abs()).max(b.word);
            let wide = Intermediate::new(bits + 1, own.frac, own);
            counts.divide[wide.size()] += 1.0;
            fit(&wide, own, counts);
        }
        Op::Sqrt(a) => {
            let a = of(a);
            let up = (2 * own.frac).saturating_sub(a.frac);
            let wide = Intermediate::new(a.word + up, own.frac, own);
            if wide.size() == 0 && is_kernel_word(own) {
                counts.kernel_root += 1.0;
                return;
            }
            counts.root[wide.size()] += 1.0;
            fit(&wide, own, counts);
        }
        Op::Neg(a) | Op::Abs(a) => {
            let a = of(a);
            if own.word == 16 && a.word == 16 && a.frac == own.frac {
                counts.kernel_add += 1.0;
                return;
            }
            let wide = Intermediate::new(a.word + 2, a.frac, own);
            counts.add[wide.size()] += 1.0;
            fit(&wide, own, counts);
        }
        Op::Shift(a, power) => convert(of(a), power, 1.0, own, counts),
        // One of the two is converted.
        Op::Select(_, a, b) => {
            convert(of(a), 0, 0.5, own, counts);
            convert(of(b), 0, 0.5, own, counts);
        }
        _ => {}
    }
}

/// A word times 2^power brought into another format, `share` times.
fn convert(a: Format, power: i32, share: f64, own: Format, counts: &mut Cycles) {
    let frac = (a.frac.cast_signed() - power).max(0).unsigned_abs();
    let up = own.frac.wrapping_sub(frac);
    if own.word == 16 && own.overflow == Overflow::Saturate && a.word <= 16 && up <= 3 {
        counts.kernel_double += share * f64::from(up);
    } else if frac != own.frac || a.word > own.word {
        let wide = Intermediate::new(a.word + 1, frac, own);
        let mut once = Cycles::default();
        fit(&wide, own, &mut once);
        let size = wide.size();
        counts.shift[size] += share * once.shift[size];
        counts.round[size] += share * once.round[size];
        counts.saturate[size] += share * once.saturate[size];
        counts.kernel_round += share * once.kernel_round;
    }
}

/// Shift, rounding and saturation of an intermediate into its node.
fn fit(wide: &Intermediate, own: Format, counts: &mut Cycles) {
    let size = wide.size();
    let dropped = wide.frac.wrapping_sub(own.frac);
    if size == 0 && is_kernel_word(own) && (dropped == 14 || dropped == 15) {
        counts.kernel_round += 1.0;
        return;
    }
    counts.shift[size] += f64::from(wide.frac.abs_diff(own.frac) % 8);
    if wide.frac > own.frac && own.rounding != Rounding::Floor {
        counts.round[size] += 1.0;
    }
    if own.overflow != Overflow::Wrap && wide.bits > own.word {
        counts.saturate[size] += 1.0;
    }
}
