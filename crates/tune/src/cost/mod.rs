//! What formats cost: bits, silicon area, controller cycles.

mod cycles;

use cardan_datapath::{Format, Overflow, Rounding};
use cardan_numerics::tape::{NO_NODE, Op, Ref, Tape};
use serde::{Deserialize, Serialize};

use crate::problem::Problem;

pub use cycles::{Cycles, Pair, counts};

/// Coefficients that are part of this crate; a file of the same shape may replace them.
const COEFFICIENTS: &str = include_str!("coefficients.toml");

/// A cost model.
#[derive(Clone, Debug, PartialEq)]
pub enum Cost {
    /// Sum of the word lengths.
    Bits,
    /// Estimated silicon area, in gate equivalents.
    Area(Box<Coefficients>),
    /// Estimated controller cycles of a step, by containers.
    Cycles(Box<Coefficients>),
}

/// Coefficients of the estimates.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Coefficients {
    /// Silicon area.
    pub area: Area,
    /// Controller cycles.
    pub cycles: Cycles,
}

/// Gate equivalents.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// Adder or comparator, per bit.
    pub adder: f64,
    /// Multiplier, per product of the operands' bits.
    pub multiplier: f64,
    /// Sequential divider or root, per bit of the quotient and of the divisor.
    pub divider: f64,
    /// Selection, per bit.
    pub selection: f64,
    /// Register of a node, per bit.
    pub register: f64,
    /// Rounding to nearest, per bit.
    pub rounding: f64,
    /// Saturation, per bit.
    pub saturation: f64,
}

impl Coefficients {
    /// The bundled coefficients.
    ///
    /// # Errors
    /// Never, as a test shows.
    pub fn bundled() -> Result<Self, String> {
        Self::parse(COEFFICIENTS, "coefficients.toml")
    }

    /// Reads the text of coefficient file `file`.
    ///
    /// # Errors
    /// Broken TOML, missing or unknown keys; the message names the place.
    pub fn parse(text: &str, file: &str) -> Result<Self, String> {
        toml::from_str(text).map_err(|error| format!("{file}: {error}"))
    }
}

/// Sum of the word lengths of all nodes.
#[must_use]
pub fn bits(formats: &[Format]) -> u64 {
    formats.iter().map(|format| u64::from(format.word)).sum()
}

impl Cost {
    /// The cost of `formats` for an algorithm.
    #[must_use]
    pub fn of(&self, problem: &Problem, tape: &Tape, formats: &[Format]) -> f64 {
        match self {
            Self::Bits => bits(formats) as f64,
            Self::Area(coefficients) => area(&coefficients.area, tape, formats),
            Self::Cycles(coefficients) => coefficients.cycles.of(&counts(problem, tape, formats)),
        }
    }

    /// Its name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Bits => "bits",
            Self::Area(_) => "area",
            Self::Cycles(_) => "cycles",
        }
    }
}

/// Format of an operand; a truth has one bit.
fn operand(tape: &Tape, formats: &[Format], operand: Ref) -> Format {
    const TRUTH: Format = Format::new(1, 0, Rounding::Floor, Overflow::Saturate);
    formats
        .get(tape.node_of(operand) as usize)
        .copied()
        .unwrap_or(TRUTH)
}

/// Adders grow with their words, multipliers with the product of theirs, registers with their nodes.
#[must_use]
pub fn area(area: &Area, tape: &Tape, formats: &[Format]) -> f64 {
    let registers: f64 = formats
        .iter()
        .map(|f| area.register * f64::from(f.word))
        .sum();
    let mut sum = registers;
    for entry in &tape.steady {
        let word = |of: Ref| f64::from(operand(tape, formats, of).word);
        sum += match entry.op {
            Op::Add(a, b) | Op::Sub(a, b) | Op::Less(a, b) => area.adder * word(a).max(word(b)),
            Op::Neg(a) | Op::Abs(a) => area.adder * word(a),
            Op::Mul(a, b) => area.multiplier * word(a) * word(b),
            Op::Div(_, b) => {
                area.divider * (word(b) + f64::from(formats[entry.node as usize].word))
            }
            Op::Sqrt(_) => area.divider * 2.0 * f64::from(formats[entry.node as usize].word),
            Op::Select(_, a, b) => area.selection * word(a).max(word(b)),
            _ => 0.0,
        };
        if entry.node == NO_NODE || !entry.op.is_recorded() {
            continue;
        }
        let format = formats[entry.node as usize];
        if is_rounded(tape, formats, entry) && format.rounding != Rounding::Floor {
            sum += area.rounding * f64::from(format.word);
        }
        if format.overflow != Overflow::Wrap {
            sum += area.saturation * f64::from(format.word);
        }
    }
    sum
}

/// Fractional bits of the exact result of an operation, and its bits.
fn exact(tape: &Tape, formats: &[Format], op: Op<Ref>, own: Format) -> (u32, u32) {
    let of = |at: Ref| operand(tape, formats, at);
    match op {
        Op::Mul(a, b) => (of(a).frac + of(b).frac, of(a).word + of(b).word),
        Op::Add(a, b) | Op::Sub(a, b) | Op::Less(a, b) | Op::Select(_, a, b) => {
            let (a, b) = (of(a), of(b));
            let frac = a.frac.max(b.frac);
            (
                frac,
                (a.word + frac - a.frac).max(b.word + frac - b.frac) + 2,
            )
        }
        Op::Div(a, b) => {
            let up = (own.frac + of(b).frac).saturating_sub(of(a).frac);
            (own.frac, (of(a).word + up).max(of(b).word) + 1)
        }
        Op::Sqrt(a) => {
            let up = (2 * own.frac).saturating_sub(of(a).frac);
            (own.frac, of(a).word + up)
        }
        Op::Shift(a, power) => {
            let frac = of(a).frac.cast_signed() - power;
            (
                frac.max(0).unsigned_abs(),
                of(a).word + frac.min(0).unsigned_abs() + 1,
            )
        }
        Op::Neg(a) | Op::Abs(a) | Op::Negative(a) => (of(a).frac, of(a).word + 2),
        _ => (own.frac, own.word),
    }
}

fn is_rounded(tape: &Tape, formats: &[Format], entry: &cardan_numerics::tape::Entry) -> bool {
    let own = formats[entry.node as usize];
    let (frac, _) = exact(tape, formats, entry.op, own);
    frac > own.frac || matches!(entry.op, Op::Div(..) | Op::Sqrt(_))
}
