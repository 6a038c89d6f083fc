//! What a fixed-point value can be at all, where its deviation says too little: intervals that need no
//! outward rounding, since a place of the word is added around them.

/// A closed interval that holds a fixed-point value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Span {
    /// Lower end.
    pub(super) lo: f64,
    /// Upper end.
    pub(super) hi: f64,
}

impl Span {
    pub(super) fn of(lo: f64, hi: f64) -> Self {
        Self { lo, hi }
    }

    /// Both ends of all combinations of the ends.
    pub(super) fn combined(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
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

    pub(super) fn hull(self, other: Self) -> Self {
        Self::of(self.lo.min(other.lo), self.hi.max(other.hi))
    }

    /// The quotient; a divisor that may be 0 leaves one end open, or both.
    pub(super) fn over(self, divisor: Self) -> Self {
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

    pub(super) fn square(self) -> Self {
        let (a, b) = (self.lo.abs(), self.hi.abs());
        let least = if self.lo <= 0.0 && self.hi >= 0.0 {
            0.0
        } else {
            a.min(b)
        };
        Self::of(least * least, a.max(b) * a.max(b))
    }

    pub(super) fn magnitude(self) -> Self {
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
    pub(super) fn within(self, other: Self, lsb: f64) -> Self {
        let (lo, hi) = ((self.lo - lsb).max(other.lo), (self.hi + lsb).min(other.hi));
        if lo <= hi { Self::of(lo, hi) } else { other }
    }
}
