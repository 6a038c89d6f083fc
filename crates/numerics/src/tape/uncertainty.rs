//! How far a run in fixed point may be from the same run on real numbers: a first-order propagation
//! of every rounding error along the tape, solution by solution.
//!
//! Each rounded write adds an independent error of known variance and mean (uniform over a place,
//! less what the operands' own places already fix); constants and settings add an error that is known
//! exactly. Errors travel by the derivatives of the operations, and correlated ones stay correlated:
//! a value carries one coefficient per source of its step (GUM, JCGM 100:2008, 5.2, with the sources
//! as input quantities). Where a first order would be wrong the secant over the reach of the error
//! stands in its place: near the zero of a root, a divisor, a comparison. A comparison that the
//! errors could turn is *doubtful*, and so is every truth and status bit that depends on it; a
//! selection by a doubtful truth may take either value.
//!
//! What an earlier step leaves is carried as one source per value: its size is kept, its correlation
//! with other values of that step is not.

use cardan_datapath::{Format, Overflow, Rounding};

use super::{Domain, Inputs, NO_NODE, Op, Ref, Runner, Tape};
use crate::exact;
use crate::mixed::{finite, wrapped};

/// Standard deviations within which an error is taken to lie: beyond it in 2 of 10^9 values, were it
/// normal. The sum of many uniform errors has lighter tails.
const REACH: f64 = 6.0;
/// Standard deviations that the least limit on an error permits.
const LEAST_REACH: f64 = 4.0;
/// Largest value of a uniform error over its standard deviation.
const WIDEST: f64 = 1.732_050_807_568_877_2;
/// Standard deviations by which a value may jump that a doubtful selection picks, so that both
/// choices lie well within the limits that are set on errors.
const JUMP: f64 = 3.0;

/// A value on real numbers and what fixed point may make of it.
#[derive(Clone, Debug, Default)]
pub struct Uncertain {
    value: f64,
    bias: f64,
    /// Per source of the step, the error's standard deviation from it.
    spread: Vec<f64>,
    /// Fractional bits of the word.
    frac: i64,
    /// For truths: the errors could turn it.
    doubtful: bool,
    /// The error has no bound: a divisor may be zero.
    unbounded: bool,
    /// What the word can be at all.
    span: Span,
    /// The word is never negative, whatever rounding does.
    nonnegative: bool,
    /// Number of the operation that made it; 0 before any.
    id: u64,
    /// For truths: the value whose sign it is.
    sign_of: u64,
    /// For truths: the two values of which it says that the first is less.
    less_of: [u64; 2],
}

/// The expected difference of a fixed-point value from its real one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// The real value.
    pub value: f64,
    /// Mean of fixed point less real.
    pub bias: f64,
    /// Its standard deviation; infinite where nothing bounds the error.
    pub deviation: f64,
}

/// Status bits of a step on real numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Raised {
    /// Bits that are set.
    pub status: u16,
    /// Bits that rounding could set or clear.
    pub doubtful: u16,
}

/// A closed interval that holds a fixed-point value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Span {
    lo: f64,
    hi: f64,
}

impl Span {
    fn of(lo: f64, hi: f64) -> Self {
        Self { lo, hi }
    }

    /// Both ends of all combinations of the ends.
    fn combined(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let ends = [
            f(self.lo, other.lo),
            f(self.lo, other.hi),
            f(self.hi, other.lo),
            f(self.hi, other.hi),
        ];
        let least = ends.into_iter().fold(f64::INFINITY, f64::min);
        let most = ends.into_iter().fold(f64::NEG_INFINITY, f64::max);
        Self::of(least, most)
    }

    fn hull(self, other: Self) -> Self {
        Self::of(self.lo.min(other.lo), self.hi.max(other.hi))
    }

    /// The quotient; a divisor that may be 0 leaves one end open, or both.
    fn over(self, divisor: Self) -> Self {
        if divisor.lo > 0.0 || divisor.hi < 0.0 {
            return self.combined(divisor, |a, b| a / b);
        }
        if divisor.lo == 0.0 && self.lo > 0.0 {
            return Self::of(self.lo / divisor.hi, f64::INFINITY);
        }
        if divisor.lo == 0.0 && self.hi < 0.0 {
            return Self::of(f64::NEG_INFINITY, self.hi / divisor.hi);
        }
        Self::of(f64::NEG_INFINITY, f64::INFINITY)
    }

    fn square(self) -> Self {
        let (a, b) = (self.lo.abs(), self.hi.abs());
        let least = if self.lo <= 0.0 && self.hi >= 0.0 {
            0.0
        } else {
            a.min(b)
        };
        Self::of(least * least, a.max(b) * a.max(b))
    }

    fn magnitude(self) -> Self {
        let (a, b) = (self.lo.abs(), self.hi.abs());
        let least = if self.lo <= 0.0 && self.hi >= 0.0 {
            0.0
        } else {
            a.min(b)
        };
        Self::of(least, a.max(b))
    }

    /// The common part, within the range of a word and a place around what is exact; `other` where
    /// rounding of f64 leaves none.
    fn within(self, other: Self, lsb: f64) -> Self {
        let (lo, hi) = ((self.lo - lsb).max(other.lo), (self.hi + lsb).min(other.hi));
        if lo <= hi { Self::of(lo, hi) } else { other }
    }
}

impl Uncertain {
    fn variance(&self) -> f64 {
        self.spread.iter().map(|part| part * part).sum()
    }

    fn deviation(&self) -> f64 {
        if self.unbounded {
            f64::INFINITY
        } else {
            self.variance().sqrt()
        }
    }

    /// The largest error to reckon with, bias apart.
    fn reach(&self) -> f64 {
        REACH * self.deviation()
    }

    fn expected(&self) -> Expected {
        Expected {
            value: self.value,
            bias: self.bias,
            deviation: self.deviation(),
        }
    }

    fn holds(&self) -> bool {
        self.value != 0.0
    }
}

/// `a` sums with weights, source by source.
fn weighted(a: &[f64], by_a: f64, b: &[f64], by_b: f64) -> Vec<f64> {
    let (long, by_long, short, by_short) = if a.len() >= b.len() {
        (a, by_a, b, by_b)
    } else {
        (b, by_b, a, by_a)
    };
    let mut sum: Vec<f64> = long.iter().map(|part| part * by_long).collect();
    for (into, part) in sum.iter_mut().zip(short) {
        *into += part * by_short;
    }
    sum
}

/// Variance and mean of what rounding adds in one write that drops `dropped` bits.
fn rounding_noise(format: Format, dropped: i64) -> (f64, f64) {
    if dropped <= 0 {
        return (0.0, 0.0);
    }
    let lsb = format.lsb();
    let exponent = -(dropped.min(64) as i32);
    let variance = lsb * lsb / 12.0 * (1.0 - libm::ldexp(1.0, 2 * exponent));
    let half = lsb / 2.0;
    let mean = match format.rounding {
        Rounding::Floor => -half * (1.0 - libm::ldexp(1.0, exponent)),
        Rounding::Ceil => half * (1.0 - libm::ldexp(1.0, exponent)),
        // The tie, one of 2^k values, always goes up.
        Rounding::NearestUp => half * libm::ldexp(1.0, exponent),
        Rounding::Zero | Rounding::NearestAway | Rounding::NearestEven => 0.0,
    };
    // Toward zero is toward either side; its spread is that of a place twice as wide.
    let widened = if format.rounding == Rounding::Zero {
        4.0
    } else {
        1.0
    };
    (variance * widened, mean)
}

/// Whether a value is a whole number of places of 2^-frac.
fn is_multiple(value: f64, frac: u32) -> bool {
    let places = libm::ldexp(value, frac as i32);
    places == places.trunc()
}

/// Share of the largest part of an error under which another part does not count.
const NEGLIGIBLE: f64 = 1e-3;

/// Bits that a result has behind its point before it is rounded.
const ENDLESS: i64 = i64::MAX / 2;

/// The error-propagating interpretation.
struct Propagation<'a> {
    formats: &'a [Format],
    domain_flag: u16,
    /// Sources of this step so far; the first are what earlier steps left.
    sources: usize,
    /// Values that earlier steps left, the first sources of every step.
    carried: usize,
    /// Operations so far.
    operations: u64,
    /// Status bits of the step: on real numbers, for certain in fixed point, and at most there.
    status: u16,
    certain: u16,
    possible: u16,
}

impl Propagation<'_> {
    /// Adds an independent error to a spread.
    fn add_source(&mut self, spread: &mut Vec<f64>, deviation: f64) {
        if deviation > 0.0 {
            spread.resize(self.sources, 0.0);
            spread.push(deviation);
            self.sources += 1;
        }
    }

    /// Adds the error of a rounding. In a loop roundings repeat themselves (a dead band, a limit
    /// cycle): there it goes with the error that came from the step before.
    fn add_rounding(&mut self, spread: &mut Vec<f64>, deviation: f64) {
        let from_before = spread.iter_mut().take(self.carried);
        let largest = from_before.max_by(|a, b| a.abs().total_cmp(&b.abs()));
        match largest {
            Some(part) if *part != 0.0 => *part += (WIDEST * deviation).copysign(*part),
            _ => self.add_source(spread, deviation),
        }
    }

    fn raise(&mut self, flags: u16, holds: bool, doubtful: bool) {
        if holds {
            self.status |= flags;
        }
        if holds && !doubtful {
            self.certain |= flags;
        }
        if holds || doubtful {
            self.possible |= flags;
        }
    }

    /// A real result with its operands' errors enters `node`, from `natural` fractional bits.
    fn enter(&mut self, node: usize, mut item: Uncertain, natural: i64) -> Uncertain {
        let format = self.formats[node];
        let is_exact = item.spread.is_empty() && item.bias == 0.0 && !item.unbounded;
        // A value without error that ends before the word does loses nothing.
        let dropped = if is_exact && is_multiple(item.value, format.frac) {
            0
        } else {
            natural.saturating_sub(format.frac.into())
        };
        let (variance, mean) = rounding_noise(format, dropped);
        let mut spread = std::mem::take(&mut item.spread);
        self.add_rounding(&mut spread, variance.sqrt());
        item.spread = spread;
        item.bias += mean;
        let range = Span::of(format.real(format.min_raw()), format.real(format.max_raw()));
        item.span = match format.overflow {
            Overflow::Wrap => range,
            Overflow::Saturate | Overflow::Trap => Span::of(
                item.span.lo.clamp(range.lo, range.hi),
                item.span.hi.clamp(range.lo, range.hi),
            )
            .within(range, format.lsb()),
        };
        self.limit(format, &mut item);
        if format.overflow != Overflow::Wrap {
            let (native, reach) = (item.value + item.bias, item.reach());
            item.span = Span::of(native - reach, native + reach).within(item.span, format.lsb());
        }
        item.frac = format.frac.into();
        item
    }

    /// What the range of the word does to a value and its error.
    fn limit(&mut self, format: Format, item: &mut Uncertain) {
        item.value = finite(item.value);
        if format.overflow == Overflow::Wrap {
            item.value = wrapped(item.value, format);
        }
        let (least, most) = (format.real(format.min_raw()), format.real(format.max_raw()));
        if item.unbounded {
            // A word is never farther away than its span is wide.
            item.unbounded = false;
            let mut spread = Vec::new();
            let far = (item.span.hi - item.value)
                .abs()
                .max((item.value - item.span.lo).abs());
            self.add_source(&mut spread, far.min(most - least) / JUMP);
            item.spread = spread;
            return;
        }
        if format.overflow == Overflow::Wrap {
            return;
        }
        let native = item.value + item.bias;
        let reach = item.reach();
        if native - reach > most || native + reach < least {
            // Certainly limited. The place by which a range ends early is what the format explains; a
            // value that is farther out does not fit, and that is no rounding.
            let end = if native > most { most } else { least };
            item.bias = (end - item.value).clamp(-format.lsb(), format.lsb());
            item.spread.clear();
        } else if native > most || native < least {
            let limited = native.clamp(least, most) - item.value;
            item.bias = limited.clamp(
                item.bias.min(0.0) - format.lsb(),
                item.bias.max(0.0) + format.lsb(),
            );
        }
    }

    /// A value that is known before the run: its error is known too. More than a place is no rounding:
    /// the value does not fit.
    fn known(&self, node: usize, value: f64, word: i64) -> Uncertain {
        let format = self.formats[node];
        let error = format.real(word) - value;
        Uncertain {
            value,
            bias: error.clamp(-format.lsb(), format.lsb()),
            span: Span::of(format.real(word), format.real(word)),
            frac: format.frac.into(),
            ..Uncertain::default()
        }
    }

    /// A setting or an input: raw over 2^frac.
    fn given(&self, node: usize, raw: i32, frac: i32) -> Uncertain {
        let format = self.formats[node];
        let value = libm::ldexp(raw.into(), -frac);
        let (word, _) = exact::fit(raw.into(), frac, format);
        let value = match format.overflow {
            Overflow::Wrap => wrapped(value, format),
            Overflow::Saturate | Overflow::Trap => value,
        };
        self.known(node, value, word)
    }

    fn truth(holds: bool, doubtful: bool) -> Uncertain {
        Uncertain {
            value: f64::from(u8::from(holds)),
            doubtful,
            ..Uncertain::default()
        }
    }

    /// a + by b.
    fn sum(&mut self, node: usize, a: &Uncertain, b: &Uncertain, by: f64) -> Uncertain {
        let item = Uncertain {
            value: a.value + by * b.value,
            span: a.span.combined(b.span, |a, b| a + by * b),
            bias: a.bias + by * b.bias,
            spread: weighted(&a.spread, 1.0, &b.spread, by),
            unbounded: a.unbounded || b.unbounded,
            ..Uncertain::default()
        };
        self.enter(node, item, a.frac.max(b.frac))
    }

    fn product(&mut self, node: usize, a: &Uncertain, b: &Uncertain) -> Uncertain {
        // Near zero the product of both errors is all there is.
        let both = REACH * (a.variance() * b.variance()).sqrt();
        let mut spread = weighted(&a.spread, b.value, &b.spread, a.value);
        if both > NEGLIGIBLE * spread.iter().map(|part| part.abs()).fold(0.0, f64::max) {
            self.add_source(&mut spread, both);
        }
        let item = Uncertain {
            value: a.value * b.value,
            span: if a.id == b.id && a.id != 0 {
                a.span.square()
            } else {
                a.span.combined(b.span, |a, b| a * b)
            },
            nonnegative: a.id == b.id && a.id != 0,
            bias: a.bias * b.value + b.bias * a.value + a.bias * b.bias,
            spread,
            unbounded: a.unbounded || b.unbounded,
            ..Uncertain::default()
        };
        self.enter(node, item, a.frac + b.frac)
    }

    fn quotient(&mut self, node: usize, a: &Uncertain, b: &Uncertain) -> Uncertain {
        let divisor = b.value;
        let reach = b.reach() + b.bias.abs();
        // The word may be zero where the real divisor is not, and the other way round.
        let may_vanish = divisor.abs() <= reach && b.span.lo <= 0.0 && b.span.hi >= 0.0;
        let may_differ = if divisor == 0.0 {
            reach > 0.0
        } else {
            may_vanish
        };
        self.raise(self.domain_flag, divisor == 0.0, may_differ);
        if divisor == 0.0 {
            let format = self.formats[node];
            let word = if a.value < 0.0 {
                format.min_raw()
            } else {
                format.max_raw()
            };
            let mut end = self.known(node, format.real(word), word);
            end.unbounded = reach > 0.0;
            if end.unbounded {
                end.span = a.span.over(b.span);
            }
            return end;
        }
        // The smallest divisor within reach has the steepest slope.
        let steeper = divisor.abs() / (divisor.abs() - reach);
        let (by_a, by_b) = (1.0 / divisor, -a.value / (divisor * divisor));
        let item = Uncertain {
            value: a.value / divisor,
            span: a.span.over(b.span),
            bias: a.bias * by_a + b.bias * by_b,
            spread: weighted(
                &a.spread,
                by_a * steeper.abs(),
                &b.spread,
                by_b * steeper.abs(),
            ),
            unbounded: a.unbounded || b.unbounded || divisor.abs() <= reach,
            ..Uncertain::default()
        };
        self.enter(node, item, ENDLESS)
    }

    fn root(&mut self, node: usize, a: &Uncertain) -> Uncertain {
        let reach = a.reach();
        let native = a.value + a.bias;
        let is_doubtful =
            !a.nonnegative && native - reach < 0.0 && (a.value >= 0.0 || native + reach >= 0.0);
        self.raise(
            self.domain_flag,
            a.value < 0.0,
            is_doubtful && reach + a.bias.abs() > 0.0,
        );
        let root = |x: f64| x.max(0.0).sqrt();
        let value = root(a.value);
        // The steeper of the secants to either end of the reach.
        let secant = |end: f64| {
            let run = (end.max(0.0) - a.value).abs();
            if run > 0.0 {
                (root(end) - value).abs() / run
            } else {
                0.0
            }
        };
        let tangent = if value > 0.0 { 0.5 / value } else { 0.0 };
        let slope = if reach > 0.0 && reach.is_finite() {
            // Upwards a root is steepest for the smallest of the errors that count.
            secant(native - reach).max(secant(native + LEAST_REACH / REACH * reach))
        } else {
            tangent
        };
        let item = Uncertain {
            value,
            span: Span::of(root(a.span.lo), root(a.span.hi)),
            bias: root(native) - value,
            spread: a.spread.iter().map(|part| part * slope).collect(),
            unbounded: a.unbounded,
            ..Uncertain::default()
        };
        self.enter(node, item, ENDLESS)
    }

    /// A value times an exact factor.
    fn scaled(&mut self, node: usize, a: &Uncertain, factor: f64, natural: i64) -> Uncertain {
        let item = Uncertain {
            value: a.value * factor,
            span: a
                .span
                .combined(Span::of(factor, factor), |a, factor| a * factor),
            bias: a.bias * factor,
            spread: a.spread.iter().map(|part| part * factor).collect(),
            unbounded: a.unbounded,
            ..Uncertain::default()
        };
        self.enter(node, item, natural)
    }

    fn select(
        &mut self,
        node: usize,
        condition: &Uncertain,
        a: &Uncertain,
        b: &Uncertain,
    ) -> Uncertain {
        let (chosen, other) = if condition.holds() { (a, b) } else { (b, a) };
        let mut item = chosen.clone();
        // The larger of a value and zero.
        let limited = condition.sign_of != 0 && condition.sign_of == b.id && a.value >= 0.0;
        item.nonnegative = limited || a.nonnegative && b.nonnegative;
        let is_extreme = condition.less_of == [a.id, b.id] || condition.less_of == [b.id, a.id];
        if condition.doubtful && is_extreme && a.id != 0 && b.id != 0 {
            // The lesser or the larger of two values is off by no more than either of them.
            let either = (chosen.variance() + other.variance()).sqrt();
            item.unbounded |= other.unbounded;
            // select(a < b, a, b) is the lesser, select(b < a, a, b) the larger.
            item.span = if condition.less_of == [a.id, b.id] {
                a.span.combined(b.span, f64::min)
            } else {
                a.span.combined(b.span, f64::max)
            };
            let mut spread = Vec::new();
            self.add_source(&mut spread, either);
            item.spread = spread;
        } else if condition.doubtful {
            let apart = chosen.value + chosen.bias - other.value - other.bias;
            let jump = (apart / JUMP).powi(2) + other.variance();
            item.unbounded |= other.unbounded;
            item.span = a.span.hull(b.span);
            let mut spread = std::mem::take(&mut item.spread);
            self.add_source(&mut spread, jump.sqrt());
            item.spread = spread;
        }
        let natural = chosen.frac.max(other.frac);
        self.enter(node, item, natural)
    }

    /// Whether a value with this error is negative, and whether the error could turn that.
    fn sign(value: f64, bias: f64, deviation: f64) -> Uncertain {
        let reach = REACH * deviation;
        let negative = value < 0.0;
        let native = value + bias;
        let turned = (native - reach < 0.0) != negative || (native + reach < 0.0) != negative;
        Self::truth(negative, turned || !reach.is_finite())
    }

    fn negative(a: &Uncertain) -> Uncertain {
        let mut negative = Self::sign(a.value, a.bias, a.deviation());
        negative.doubtful &=
            !(a.span.hi < 0.0 && negative.holds()) && !(a.span.lo >= 0.0 && !negative.holds());
        negative
    }

    fn less(a: &Uncertain, b: &Uncertain) -> Uncertain {
        let spread = weighted(&a.spread, 1.0, &b.spread, -1.0);
        let variance: f64 = spread.iter().map(|part| part * part).sum();
        let deviation = if a.unbounded || b.unbounded {
            f64::INFINITY
        } else {
            variance.sqrt()
        };
        let mut less = Self::sign(a.value - b.value, a.bias - b.bias, deviation);
        // What the words can be at all may settle it.
        less.doubtful &=
            !(a.span.hi < b.span.lo && less.holds()) && !(a.span.lo >= b.span.hi && !less.holds());
        less
    }

    fn lookup(&mut self, node: usize, index: &Uncertain, table: &'static [f64]) -> Uncertain {
        let last = (table.len() - 1) as f64;
        let at = |x: f64| table[x.floor().clamp(0.0, last) as usize];
        let value = at(index.value);
        let mut item = self.known(node, value, self.formats[node].constant(value));
        let (native, reach) = (index.value + index.bias, index.reach().min(last + 1.0));
        let jump = (at(native - reach) - value)
            .abs()
            .max((at(native + reach) - value).abs());
        let mut spread = Vec::new();
        self.add_source(&mut spread, jump / JUMP);
        item.spread = spread;
        item
    }

    fn either(condition: &Uncertain, a: &Uncertain, b: &Uncertain) -> Uncertain {
        let chosen = if condition.holds() { a } else { b };
        let agree = a.holds() == b.holds() && !a.doubtful && !b.doubtful;
        let doubtful = if condition.doubtful {
            !agree
        } else {
            chosen.doubtful
        };
        Self::truth(chosen.holds(), doubtful)
    }
}

impl Domain for Propagation<'_> {
    type Item = Uncertain;

    fn input(&mut self, node: usize, _port: usize, raw: i32, frac: i32) -> Uncertain {
        self.given(node, raw, frac)
    }

    fn external(&mut self, _port: usize, truth: bool) -> Uncertain {
        Self::truth(truth, false)
    }

    fn apply(&mut self, node: usize, op: Op<&Uncertain>) -> Uncertain {
        self.operations += 1;
        let id = self.operations;
        Uncertain {
            id,
            ..self.compute(node, op)
        }
    }
}

impl Propagation<'_> {
    fn compute(&mut self, node: usize, op: Op<&Uncertain>) -> Uncertain {
        match op {
            Op::Input { .. } | Op::External { .. } => Uncertain::default(),
            Op::Parameter { raw, frac } => self.given(node, raw, frac),
            Op::Constant(value) => self.known(node, value, self.formats[node].constant(value)),
            Op::Lookup(index, table) => self.lookup(node, index, table),
            Op::Add(a, b) => self.sum(node, a, b, 1.0),
            Op::Sub(a, b) => self.sum(node, a, b, -1.0),
            Op::Mul(a, b) => self.product(node, a, b),
            Op::Div(a, b) => self.quotient(node, a, b),
            Op::Sqrt(a) => self.root(node, a),
            Op::Shift(a, power) => {
                let natural = a.frac - i64::from(power);
                self.scaled(node, a, libm::ldexp(1.0, power), natural)
            }
            Op::Neg(a) => self.scaled(node, a, -1.0, a.frac),
            Op::Abs(a) => {
                let sign = if a.value < 0.0 { -1.0 } else { 1.0 };
                let mut magnitude = self.scaled(node, a, sign, a.frac);
                magnitude.nonnegative = true;
                magnitude.span = a.span.magnitude().within(magnitude.span, 0.0);
                magnitude
            }
            Op::Select(condition, a, b) => self.select(node, condition, a, b),
            Op::Less(a, b) => Uncertain {
                less_of: [a.id, b.id],
                ..Self::less(a, b)
            },
            Op::Negative(a) => Uncertain {
                sign_of: a.id,
                ..Self::negative(a)
            },
            Op::Known(value) => Self::truth(value, false),
            Op::Not(a) => Self::truth(!a.holds(), a.doubtful),
            Op::Or(a, b) => {
                let settled = (a.holds() && !a.doubtful) || (b.holds() && !b.doubtful);
                let doubtful = (a.doubtful || b.doubtful) && !settled;
                Self::truth(a.holds() || b.holds(), doubtful)
            }
            Op::Xor(a, b) => Self::truth(a.holds() != b.holds(), a.doubtful || b.doubtful),
            Op::Either(condition, a, b) => Self::either(condition, a, b),
            Op::Raise(flags, a) => {
                self.raise(flags, a.holds(), a.doubtful);
                a.clone()
            }
        }
    }
}

/// Runs a tape and gives what fixed point may make of each write.
pub struct Uncertainty<'a> {
    tape: &'a Tape,
    propagation: Propagation<'a>,
    runner: Runner<'a, Propagation<'a>>,
    /// Operations whose results later steps use.
    carried: Vec<usize>,
    step: usize,
}

impl<'a> Uncertainty<'a> {
    /// Of `tape` computed in `formats`, one per node; `domain_flag` is the arithmetic's own status bit.
    #[must_use]
    pub fn new(tape: &'a Tape, formats: &'a [Format], domain_flag: u16) -> Self {
        let bodies = tape.transient.iter().chain([&tape.steady]);
        let operands = bodies.flatten().flat_map(|entry| entry.op.operands());
        let mut carried: Vec<usize> = operands
            .filter_map(|operand| match operand {
                Ref::Ago { index, .. } => Some(index as usize),
                Ref::Here(_) | Ref::Before(_) => None,
            })
            .collect();
        carried.sort_unstable();
        carried.dedup();
        let mut propagation = Propagation {
            formats,
            domain_flag,
            sources: carried.len(),
            carried: carried.len(),
            operations: 0,
            status: 0,
            certain: 0,
            possible: 0,
        };
        let runner = Runner::new(tape, &mut propagation);
        Self {
            tape,
            propagation,
            runner,
            carried,
            step: 0,
        }
    }

    /// Runs the next step on step `at` of the inputs; shows `visit` the node and the expectation of
    /// each write, in order.
    pub fn step(
        &mut self,
        inputs: &Inputs,
        at: usize,
        mut visit: impl FnMut(usize, Expected),
    ) -> Raised {
        let propagation = &mut self.propagation;
        propagation.sources = self.carried.len();
        (
            propagation.status,
            propagation.certain,
            propagation.possible,
        ) = (0, 0, 0);
        let items = self.runner.step(propagation, inputs, at);
        for (entry, item) in self.tape.body(self.step).iter().zip(items) {
            if entry.node != NO_NODE && entry.op.is_recorded() {
                visit(entry.node as usize, item.expected());
            }
        }
        let raised = Raised {
            status: self.propagation.status,
            doubtful: self.propagation.possible & !self.propagation.certain,
        };
        self.carry();
        self.step += 1;
        raised
    }
    /// Keeps of the step's errors what later steps can use: one source per value.
    fn carry(&mut self) {
        let Some(items) = self.runner.last_mut() else {
            return;
        };
        let mut carried = self.carried.iter().enumerate().peekable();
        for (index, item) in items.iter_mut().enumerate() {
            let slot = carried.next_if(|&(_, &wanted)| wanted == index);
            let deviation = item.variance().sqrt();
            item.spread = Vec::new();
            if let (Some((slot, _)), true) = (slot, deviation > 0.0) {
                item.spread.resize(slot, 0.0);
                item.spread.push(deviation);
            }
        }
    }
}
