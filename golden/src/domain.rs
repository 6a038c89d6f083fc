//! Total versions of operations with a restricted domain, which remember that it was left.
//!
//! Noise drives arguments out of their domains (docs/sensors.md, 7.7): they are clamped, and only
//! what noise does not explain is remembered.

use cardan_spec::DOMAIN_MARGIN;

/// Where a quotient stands whose divisor is zero, with the dividend's sign: beyond every domain.
const NO_QUOTIENT: f64 = 2.0;

/// Remembers whether an argument left its domain by more than noise, or a divisor was zero.
#[derive(Debug, Default)]
pub(crate) struct Domain {
    left: bool,
}

impl Domain {
    /// True when any operation so far left its domain.
    pub(crate) fn was_left(&self) -> bool {
        self.left
    }

    /// `value` clamped to -1..=1, the domain of asin and acos.
    pub(crate) fn unit(&mut self, value: f64) -> f64 {
        self.left |= value.abs() > 1.0 + DOMAIN_MARGIN;
        value.clamp(-1.0, 1.0)
    }

    /// The quotient; by zero it stands at [`NO_QUOTIENT`] on the dividend's side.
    pub(crate) fn quotient(&mut self, dividend: f64, divisor: f64) -> f64 {
        if divisor == 0.0 {
            self.left = true;
            return if dividend < 0.0 {
                -NO_QUOTIENT
            } else {
                NO_QUOTIENT
            };
        }
        dividend / divisor
    }
}

/// The square root of `value`, of 0 where it is negative: a squared cosine that noise made negative
/// belongs to an angle of 90 degrees.
pub(crate) fn root(value: f64) -> f64 {
    value.max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clamping_within_the_margin_is_noise_and_beyond_it_is_remembered() {
        let mut domain = Domain::default();
        assert_eq!(domain.unit(1.0 + DOMAIN_MARGIN), 1.0);
        assert_eq!(domain.unit(-1.0 - DOMAIN_MARGIN), -1.0);
        assert!(!domain.was_left());
        assert_eq!(domain.unit(-1.0 - 1.01 * DOMAIN_MARGIN), -1.0);
        assert!(domain.was_left());
    }

    #[test]
    fn division_by_zero_leaves_every_domain_on_the_dividends_side_and_is_remembered() {
        for (dividend, expected) in [(0.3, 2.0), (-1e-9, -2.0), (0.0, 2.0)] {
            let mut domain = Domain::default();
            assert_eq!(domain.quotient(dividend, 0.0), expected);
            assert!(domain.was_left());
        }
        let mut domain = Domain::default();
        assert_eq!(domain.quotient(3.0, 2.0), 1.5);
        assert!(!domain.was_left());
    }

    #[test]
    fn the_root_of_a_negative_number_is_zero() {
        assert_eq!(root(-0.01), 0.0);
        assert_eq!(root(0.25), 0.5);
    }
}
