//! How large a difference rounding explains.
//!
//! The bundled limits are not constants. For every value the real interpretation knows by which bias
//! and standard deviation the formats' rounding shifts it (`cardan_numerics::tape::Uncertainty`); a
//! difference must lie within a number of deviations that grows with the number of values as the
//! largest of so many normal ones does, and over the run the differences over their deviations must
//! have no more spread, and no more bias, than that expectation. So a limit is tight in easy
//! attitudes, wide near singular ones, follows other word lengths, and holds for runs of any length.

/// Deviations that a single value may be off, of `count` values: the largest of so many normal values
/// exceeds 1 + sqrt(2 ln count) in about one of 10 runs of 10^5 values. Rounding errors are sums of
/// bounded ones, whose tails are lighter.
pub(crate) fn most_deviations(count: usize) -> f64 {
    let count = count.max(1) as f64;
    (1.0 + (2.0 * libm::log(count)).sqrt()).max(LEAST_DEVIATIONS)
}

/// Few values: still what a normal value exceeds in 6 of 100,000 cases.
const LEAST_DEVIATIONS: f64 = 4.0;

/// Most root mean square of the differences over their deviations, over so many solutions. 1 is expected; where
/// a signal hardly moves, a few rounding errors repeat themselves instead of spreading, and a uniform error's
/// largest value is 1.73 deviations. Values of one solution are correlated, so solutions count.
pub(crate) fn most_rms(solutions: usize) -> f64 {
    1.5 + 2.0 / (solutions.max(1) as f64).sqrt()
}

/// Most mean of the differences over their deviations. Rounding errors of a signal that moves
/// average out; those of settings are known and taken off; what remains are signals at rest.
pub(crate) fn most_bias(solutions: usize) -> f64 {
    1.0 + 3.0 / (solutions.max(1) as f64).sqrt()
}

/// Least root mean square of the differences of all nodes over their deviations, over at least
/// [`LEAST_VALUES`]: expected deviations that are far larger than the differences judge nothing.
pub(crate) const LEAST_RMS: f64 = 0.4;
/// See [`LEAST_RMS`].
pub(crate) const LEAST_VALUES: u64 = 1000;

/// The part of a difference that the allowance does not cover.
pub(crate) fn beyond_allowance(difference: f64, allowance: f64) -> f64 {
    difference - difference.clamp(-allowance, allowance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_grows_with_the_number_of_values_as_their_largest_does() {
        assert_eq!(most_deviations(1), 4.0);
        assert!((most_deviations(1488) - 4.822).abs() < 1e-3);
        assert!((most_deviations(75_000) - 5.738).abs() < 1e-3);
    }

    #[test]
    fn an_allowance_takes_its_part_of_either_sign() {
        assert_eq!(beyond_allowance(0.3, 0.25), 0.3 - 0.25);
        assert_eq!(beyond_allowance(-0.3, 0.25), -0.3 + 0.25);
        assert_eq!(beyond_allowance(0.2, 0.25), 0.0);
        assert!(beyond_allowance(f64::NAN, 0.25).is_nan());
    }
}
