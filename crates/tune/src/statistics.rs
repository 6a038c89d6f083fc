//! What a few fresh runs tell of all runs like them.
//!
//! Many: if the wanted share of all runs did not hold, n runs would hold without exception with a
//! probability of less than share^n (Wilks 1941; no model of how they scatter).
//!
//! Few: a model: how far a run stretches a limit is normally distributed over seeds. Then mean + k s of n
//! runs is, with the wanted confidence, not exceeded by the wanted share of all runs, where k is the
//! factor of the one-sided tolerance limit, a quantile of the noncentral t distribution (ISO 16269-6).

/// Quantile of the normal distribution for a share of 95 %.
const Z_95: f64 = 1.644_853_626_951_472_6;

/// The share of all runs that a tolerance limit speaks of.
pub const CONTENT: f64 = 0.95;

/// Whether `runs` that hold without exception show it for [`CONTENT`] of all runs.
pub(crate) fn enough(runs: usize, confidence: f64) -> bool {
    libm::pow(CONTENT, runs as f64) <= 1.0 - confidence
}

/// k of a one-sided tolerance limit of `n` values (at least 2) for [`CONTENT`].
pub(crate) fn tolerance_factor(n: usize, confidence: f64) -> f64 {
    let root = (n as f64).sqrt();
    let (mut low, mut high) = (0.0, 64.0);
    for _ in 0..50 {
        let k = 0.5 * (low + high);
        if noncentral_t(k * root, n - 1, Z_95 * root) < confidence {
            low = k;
        } else {
            high = k;
        }
    }
    high
}

/// P(T <= t) for `freedom` degrees of freedom: the normal distribution averaged over that of the
/// standard deviation.
fn noncentral_t(t: f64, freedom: usize, shift: f64) -> f64 {
    const POINTS: usize = 4000;
    let nu = freedom as f64;
    let normal = |x: f64| 0.5 * libm::erfc(-x / std::f64::consts::SQRT_2);
    let end = nu + 15.0 * (2.0 * nu).sqrt() + 60.0;
    let width = end / POINTS as f64;
    let scale = 0.5 * nu * std::f64::consts::LN_2 + libm::lgamma(0.5 * nu);
    let part = |at: usize| {
        let w = (at as f64 + 0.5) * width;
        let density = libm::exp((0.5 * nu - 1.0) * libm::log(w) - 0.5 * w - scale);
        normal(t * (w / nu).sqrt() - shift) * density * width
    };
    (0..POINTS).map(part).sum()
}

/// Mean and standard deviation (of the population that the values are drawn from).
pub(crate) fn moments(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let square: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (mean, (square / (count - 1.0)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables of one-sided tolerance factors (ISO 16269-6, table D.4; Natrella, NBS Handbook 91, A-7).
    #[test]
    fn factors_are_those_of_the_tables() {
        for (n, confidence, expected) in [
            (5, 0.95, 4.203),
            (10, 0.95, 2.911),
            (20, 0.95, 2.396),
            (30, 0.95, 2.220),
            (50, 0.95, 2.065),
            (20, 0.99, 2.808),
        ] {
            let found = tolerance_factor(n, confidence);
            assert!(
                (found - expected).abs() < 2e-3,
                "{n}, {confidence}: {found}"
            );
        }
    }

    /// The numbers of runs of the tables (Wilks; 59 for 95 % of all with 95 % confidence, 90 with 99 %).
    #[test]
    fn runs_are_enough_as_in_the_tables() {
        for (runs, confidence) in [(59, 0.95), (90, 0.99), (45, 0.9)] {
            assert!(
                enough(runs, confidence) && !enough(runs - 1, confidence),
                "{runs}"
            );
        }
    }

    #[test]
    fn moments_are_those_of_a_sample() {
        let (mean, deviation) = moments(&[1.0, 2.0, 3.0, 4.0]);
        assert_eq!(mean, 2.5);
        assert!((deviation - (5.0_f64 / 3.0).sqrt()).abs() < 1e-15);
    }
}
