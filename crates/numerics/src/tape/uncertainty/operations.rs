//! What each operation does to a value and to its error.

use super::propagation::{JUMP, Propagation};
use super::span::Span;
use super::{REACH, Uncertain};
use crate::tape::{Domain, Op};

/// Standard deviations that the least limit on an error permits.
const LEAST_REACH: f64 = 4.0;

/// Share of the largest part of an error under which another part does not count.
const NEGLIGIBLE: f64 = 1e-3;

/// Bits that a result has behind its point before it is rounded.
const ENDLESS: i64 = i64::MAX / 2;

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

impl Propagation {
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
            item.unbounded |= other.unbounded;
            // select(a < b, a, b) is the lesser, select(b < a, a, b) the larger.
            item.span = if condition.less_of == [a.id, b.id] {
                a.span.combined(b.span, f64::min)
            } else {
                a.span.combined(b.span, f64::max)
            };
            let mut spread = std::mem::take(&mut item.spread);
            self.add_source(&mut spread, other.variance().sqrt());
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
        // What the word can be at all may settle it.
        let settled = if negative.holds() {
            a.span.hi < 0.0
        } else {
            a.span.lo >= 0.0
        };
        negative.doubtful &= !settled;
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
        let settled = if less.holds() {
            a.span.hi < b.span.lo
        } else {
            a.span.lo >= b.span.hi
        };
        less.doubtful &= !settled;
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

impl Domain for Propagation {
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

impl Propagation {
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
