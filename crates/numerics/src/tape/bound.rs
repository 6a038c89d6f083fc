//! Closed intervals of real numbers, rounded outward.

use std::cmp::Ordering;

use cardan_datapath::{Format, Overflow};

/// A closed interval; truths are within 0..=1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub lo: f64,
    /// Upper end.
    pub hi: f64,
}

impl Interval {
    /// From one end to the other.
    #[must_use]
    pub const fn new(lo: f64, hi: f64) -> Self {
        Self { lo, hi }
    }

    pub(super) const ALL: Self = Self::new(f64::NEG_INFINITY, f64::INFINITY);
    pub(super) const TRUTH: Self = Self::new(0.0, 1.0);

    /// Ends of a computed interval: one place outward, so that rounding of `f64` cannot hide a value.
    pub(super) fn outward(lo: f64, hi: f64) -> Self {
        if lo.is_nan() || hi.is_nan() {
            return Self::ALL;
        }
        Self::new(lo.next_down(), hi.next_up())
    }

    /// The smallest interval that holds both.
    #[must_use]
    pub const fn hull(self, other: Self) -> Self {
        Self::new(self.lo.min(other.lo), self.hi.max(other.hi))
    }

    /// What lies in both. Each holds the same values, so that they meet; were it not so, the first.
    pub(super) const fn meet(self, other: Self) -> Self {
        let (lo, hi) = (self.lo.max(other.lo), self.hi.min(other.hi));
        if lo <= hi { Self::new(lo, hi) } else { self }
    }

    /// Distance of its ends.
    pub(super) fn width(self) -> f64 {
        self.hi - self.lo
    }

    pub(super) fn over_ends(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let ends = [
            f(self.lo, other.lo),
            f(self.lo, other.hi),
            f(self.hi, other.lo),
            f(self.hi, other.hi),
        ];
        if ends.iter().any(|end| end.is_nan()) {
            return Self::ALL;
        }
        let lo = ends.into_iter().fold(f64::INFINITY, f64::min);
        let hi = ends.into_iter().fold(f64::NEG_INFINITY, f64::max);
        Self::outward(lo, hi)
    }

    pub(super) fn divided_by(self, divisor: Self) -> Self {
        if divisor.lo <= 0.0 && divisor.hi >= 0.0 {
            return Self::ALL;
        }
        self.over_ends(divisor, |a, b| a / b)
    }

    pub(super) fn magnitude(self) -> Self {
        let hi = self.lo.abs().max(self.hi.abs());
        let contains_zero = self.lo <= 0.0 && self.hi >= 0.0;
        let lo = if contains_zero {
            0.0
        } else {
            self.lo.abs().min(self.hi.abs())
        };
        Self::new(lo, hi)
    }

    /// The smallest interval of `f64` that holds raw / 2^frac, which itself may have more than 53 bits.
    #[must_use]
    pub fn of_word(raw: i64, format: Format) -> Self {
        let (near, lsb) = (raw as f64, format.lsb());
        match i128::from(raw).cmp(&(near as i128)) {
            Ordering::Equal => Self::new(near * lsb, near * lsb),
            Ordering::Less => Self::new(near.next_down() * lsb, near * lsb),
            Ordering::Greater => Self::new(near * lsb, near.next_up() * lsb),
        }
    }

    /// What words of `format` hold, its ends rounded outward.
    pub(super) fn whole(format: Format) -> Self {
        Self::of_word(format.min_raw(), format).hull(Self::of_word(format.max_raw(), format))
    }

    /// True if no value overflows `format`, in whatever way it is rounded.
    #[must_use]
    pub fn fits(self, format: Format) -> bool {
        // On the grid both ends are whole numbers of places: below the end is at most the largest
        // word, which itself need not be an f64. An interval that is no interval fits nothing.
        let Self { lo, hi } = self.on_grid(format);
        let end = libm::ldexp(format.lsb(), format.word.cast_signed() - 1);
        lo >= -end && hi < end
    }

    /// Both ends moved outward to multiples of the last place, which no rounding mode leaves.
    pub(super) fn on_grid(self, format: Format) -> Self {
        let lsb = format.lsb();
        Self::new((self.lo / lsb).floor() * lsb, (self.hi / lsb).ceil() * lsb)
    }

    /// What a node of this format holds after a write of any of these values.
    pub(super) fn quantised(self, format: Format) -> Self {
        let Self { lo, hi } = self.on_grid(format);
        if self.fits(format) {
            return Self::new(lo, hi);
        }
        match format.overflow {
            Overflow::Wrap => Self::whole(format),
            // The last word of a wide format is no f64: what stays there lies anywhere between its neighbours.
            Overflow::Saturate | Overflow::Trap => {
                let least = Self::of_word(format.min_raw(), format);
                let most = Self::of_word(format.max_raw(), format);
                Self::new(lo.clamp(least.lo, most.lo), hi.clamp(least.hi, most.hi))
            }
        }
    }
}
