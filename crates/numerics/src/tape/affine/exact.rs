//! Sums whose rounding errors are known: the error of an addition or a multiplication of `f64` is an
//! `f64` itself (Knuth's TwoSum; the fused multiply-add), so that exact results stay exact.

use crate::tape::Interval;

/// Under it the error of a product may be no `f64`; it is far below any last place.
const TINY: f64 = 1e-280;

fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let of_b = sum - a;
    (sum, (a - (sum - of_b)) + (b - of_b))
}

/// a + b, not below the true sum.
pub(super) fn sum_up(a: f64, b: f64) -> f64 {
    let (sum, error) = two_sum(a, b);
    if error > 0.0 || error.is_nan() {
        sum.next_up()
    } else {
        sum
    }
}

/// a + b, not above the true sum.
pub(super) fn sum_down(a: f64, b: f64) -> f64 {
    -sum_up(-a, -b)
}

/// A sum with a bound on its own error.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Total {
    /// The sum.
    pub(super) value: f64,
    /// How far the true sum may be from it.
    pub(super) slack: f64,
}

impl Total {
    /// A value that is exact.
    pub(super) const fn of(value: f64) -> Self {
        Self { value, slack: 0.0 }
    }

    /// Adds `a`.
    pub(super) fn add(&mut self, a: f64) {
        let (sum, error) = two_sum(self.value, a);
        self.value = sum;
        if error != 0.0 {
            self.slack = sum_up(self.slack, error.abs());
        }
    }

    /// Adds a b.
    pub(super) fn add_product(&mut self, a: f64, b: f64) {
        if a == 0.0 || b == 0.0 {
            return;
        }
        let product = a * b;
        let error = libm::fma(a, b, -product);
        self.add(product);
        if error != 0.0 {
            self.slack = sum_up(self.slack, error.abs());
        }
        if product.abs() < TINY {
            self.slack = sum_up(self.slack, TINY);
        }
    }

    /// Not below the true sum.
    pub(super) fn up(self) -> f64 {
        sum_up(self.value, self.slack)
    }

    /// Not above the true sum.
    pub(super) fn down(self) -> f64 {
        sum_down(self.value, -self.slack)
    }
}

/// The interval of `centre` plus or minus `radius`.
pub(super) fn around(centre: f64, radius: f64) -> Interval {
    Interval::new(sum_down(centre, -radius), sum_up(centre, radius))
}

/// Centre and radius of an interval.
pub(super) fn centred(range: Interval) -> (f64, f64) {
    let centre = 0.5 * range.lo + 0.5 * range.hi;
    let radius = sum_up(range.hi, -centre).max(sum_up(centre, -range.lo));
    (centre, radius)
}
