//! Affine forms: a value as a centre plus multiples of noise symbols, each anywhere in -1..=1, plus
//! an error of its own. Values that share symbols are correlated, which intervals forget.
//!
//! Stolfi and de Figueiredo, "Self-Validated Numerical Methods and Applications", chapter 3;
//! functions of one variable by a secant and the extremes of what it leaves (Chebyshev's
//! approximation for those that bend one way).

use super::exact::{Total, around, centred};
use crate::tape::{Interval, Ref};

/// Terms of a form; beyond it the smallest go into the error.
const MOST_TERMS: usize = 256;

/// What a noise symbol stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Symbol {
    /// An input of the step.
    Port(u32),
    /// What an operation adds (rounding, what its function bends), or a whole value of an earlier step.
    Value(Ref),
}

/// centre + sum of terms + something within `error`.
#[derive(Clone, Debug, Default)]
pub(super) struct Form {
    centre: f64,
    /// Coefficients by symbol, sorted.
    terms: Vec<(Symbol, f64)>,
    /// Not negative; correlated with nothing.
    error: f64,
}

impl Form {
    /// Any value of `range`.
    pub(super) fn of(range: Interval) -> Self {
        let (centre, error) = centred(range);
        Self {
            centre,
            terms: Vec::new(),
            error,
        }
    }

    /// The values that it may take.
    pub(super) fn range(&self) -> Interval {
        around(self.centre, self.radius().up())
    }

    fn radius(&self) -> Total {
        let mut radius = Total::of(self.error);
        for (_, coefficient) in &self.terms {
            radius.add(coefficient.abs());
        }
        radius
    }

    /// False once an operation has left the numbers.
    pub(super) fn is_finite(&self) -> bool {
        self.centre.is_finite()
            && self.error.is_finite()
            && self.terms.iter().all(|(_, value)| value.is_finite())
    }

    /// With its error as a symbol, so that whoever uses the value twice knows that it is the same.
    pub(super) fn named(mut self, symbol: Symbol) -> Self {
        if self.terms.len() >= MOST_TERMS {
            self.condense();
        }
        if self.error > 0.0 {
            let place = self.terms.partition_point(|(other, _)| *other < symbol);
            self.terms.insert(place, (symbol, self.error));
            self.error = 0.0;
        }
        self
    }

    /// Leaves half the terms, the largest; the others are an error now.
    fn condense(&mut self) {
        let mut sizes = self.terms.clone();
        sizes.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()).then(a.0.cmp(&b.0)));
        let mut error = Total::of(self.error);
        for (_, coefficient) in sizes.drain(MOST_TERMS / 2..) {
            error.add(coefficient.abs());
        }
        sizes.sort_by_key(|term| term.0);
        self.terms = sizes;
        self.error = error.up();
    }

    /// Every symbol of both with its coefficients.
    fn paired<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = (Symbol, f64, f64)> + use<'a> {
        let (mut left, mut right) = (&self.terms[..], &other.terms[..]);
        std::iter::from_fn(move || {
            let of = |terms: &[(Symbol, f64)]| terms.first().map(|term| term.0);
            let symbol = match (of(left), of(right)) {
                (Some(a), Some(b)) => a.min(b),
                (a, b) => a.or(b)?,
            };
            let take = |terms: &mut &'a [(Symbol, f64)]| match terms.split_first() {
                Some((first, rest)) if first.0 == symbol => {
                    *terms = rest;
                    first.1
                }
                _ => 0.0,
            };
            Some((symbol, take(&mut left), take(&mut right)))
        })
    }

    /// p self + q other + `shift`, whatever lies within `error` added.
    fn combined(&self, (p, other, q): (f64, &Self, f64), shift: Total, error: Total) -> Self {
        let (mut centre, mut errors) = (shift, error);
        centre.add_product(p, self.centre);
        centre.add_product(q, other.centre);
        errors.add(centre.slack);
        errors.add_product(p.abs(), self.error);
        errors.add_product(q.abs(), other.error);
        let mut terms = Vec::with_capacity(self.terms.len() + other.terms.len());
        for (symbol, a, b) in self.paired(other) {
            let mut sum = Total::default();
            sum.add_product(p, a);
            sum.add_product(q, b);
            errors.add(sum.slack);
            if sum.value != 0.0 {
                terms.push((symbol, sum.value));
            }
        }
        Self {
            centre: centre.value,
            terms,
            error: errors.up(),
        }
    }

    /// The sum of both.
    pub(super) fn plus(&self, other: &Self) -> Self {
        self.combined((1.0, other, 1.0), Total::default(), Total::default())
    }

    /// self - other.
    pub(super) fn minus(&self, other: &Self) -> Self {
        self.combined((1.0, other, -1.0), Total::default(), Total::default())
    }

    /// `slope` times itself, plus anything of `rest`.
    pub(super) fn scaled(&self, slope: f64, rest: Interval) -> Self {
        let (centre, radius) = centred(rest);
        let none = Self::default();
        self.combined((slope, &none, 0.0), Total::of(centre), Total::of(radius))
    }

    /// The product. Of the product of both deviations the squares of common symbols are known to be
    /// in 0..=1: half of them is a shift, and the error so much smaller.
    pub(super) fn times(&self, other: &Self) -> Self {
        let (mut squares, mut sizes) = (Total::default(), Total::default());
        for (_, a, b) in self.paired(other) {
            squares.add_product(a / 2.0, b);
            sizes.add_product(a.abs() / 2.0, b.abs());
        }
        let mut shift = squares;
        shift.add_product(-self.centre, other.centre);
        let mut error = Total::default();
        error.add_product(self.radius().up(), other.radius().up());
        error.add(-sizes.down());
        self.combined((other.centre, other, self.centre), shift, error)
    }

    /// A function of it over `range`, where it lies: `slope` times itself plus what is left, which has
    /// its extremes among `places`.
    fn approximated(&self, slope: f64, places: &[f64], function: impl Fn(f64) -> f64) -> Self {
        let mut rest = Interval::new(f64::INFINITY, f64::NEG_INFINITY);
        for &place in places {
            let (value, line) = (function(place), slope * place);
            let left = value - line;
            // Three roundings, and a place that is itself rounded.
            let slack = 8.0 * f64::EPSILON * (value.abs() + line.abs()) + f64::MIN_POSITIVE;
            rest = if left.is_finite() {
                rest.hull(Interval::new(left - slack, left + slack))
            } else {
                Interval::ALL
            };
        }
        self.scaled(slope, rest)
    }

    /// The secant of `function` over `range`; `None` where the ends are too near or too far.
    fn secant(range: Interval, function: impl Fn(f64) -> f64) -> Option<f64> {
        let slope = (function(range.hi) - function(range.lo)) / range.width();
        (slope.is_finite() && range.width().is_finite()).then_some(slope)
    }

    /// Its square; it lies in `range`.
    pub(super) fn square(&self, range: Interval) -> Option<Self> {
        let function = |x: f64| x * x;
        let slope = Self::secant(range, function)?;
        let turn = (slope / 2.0).clamp(range.lo, range.hi);
        Some(self.approximated(slope, &[range.lo, turn, range.hi], function))
    }

    /// Its reciprocal; it lies in `range`, which does not contain 0.
    pub(super) fn reciprocal(&self, range: Interval) -> Option<Self> {
        let slope = Self::secant(range, f64::recip)?;
        let turn = (-slope).recip().sqrt().copysign(range.lo);
        let turn = turn.clamp(range.lo, range.hi);
        turn.is_finite()
            .then(|| self.approximated(slope, &[range.lo, turn, range.hi], f64::recip))
    }

    /// The root of it or of 0; it lies in `range`.
    pub(super) fn root(&self, range: Interval) -> Option<Self> {
        let function = |x: f64| x.max(0.0).sqrt();
        let slope = Self::secant(range, function)?;
        if slope <= 0.0 {
            return None;
        }
        let inside = |x: f64| x.clamp(range.lo, range.hi);
        let turn = inside(0.25 / (slope * slope));
        let places = [range.lo, inside(0.0), turn, range.hi];
        Some(self.approximated(slope, &places, function))
    }

    /// Its magnitude; it lies in `range`.
    pub(super) fn magnitude(&self, range: Interval) -> Option<Self> {
        if range.lo >= 0.0 {
            return Some(self.clone());
        }
        if range.hi <= 0.0 {
            return Some(Self::default().minus(self));
        }
        let slope = Self::secant(range, f64::abs)?;
        Some(self.approximated(slope, &[range.lo, 0.0, range.hi], f64::abs))
    }

    /// Limited to `limits`; it lies in `range`.
    pub(super) fn limited(&self, range: Interval, limits: Interval) -> Option<Self> {
        if range.lo >= limits.lo && range.hi <= limits.hi {
            return Some(self.clone());
        }
        let function = |x: f64| x.clamp(limits.lo, limits.hi);
        let slope = Self::secant(range, function)?;
        let inside = |x: f64| x.clamp(range.lo, range.hi);
        let places = [range.lo, inside(limits.lo), inside(limits.hi), range.hi];
        Some(self.approximated(slope, &places, function))
    }

    /// Any value of either: what both agree on is kept, and a range for the rest.
    pub(super) fn joined(&self, other: &Self) -> Self {
        let agreed = |(symbol, a, b): (Symbol, f64, f64)| {
            let common = a.abs().min(b.abs()).copysign(a);
            (a * b > 0.0).then_some((symbol, common))
        };
        let common = Self {
            centre: 0.0,
            terms: self.paired(other).filter_map(agreed).collect(),
            error: 0.0,
        };
        let rest = |form: &Self| form.minus(&common).range();
        let (centre, error) = centred(rest(self).hull(rest(other)));
        Self {
            centre,
            terms: common.terms,
            error,
        }
    }
}
