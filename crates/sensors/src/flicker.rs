//! 1/f noise as a sum of Ornstein-Uhlenbeck processes with corners spaced by a constant ratio.
//!
//! A process of variance s^2 and corner f_k has the one-sided density (2 s^2 / pi f_k) /
//! (1 + (f/f_k)^2). Corners spaced by the ratio r add up to s^2 / (ln(r) f), so s^2 = n^2 f_c ln(r)
//! gives n^2 f_c / f: noise of corner f_c over a white density n. Each process is stepped with its
//! exact transition, so the step does not matter.

use cardan_scenario::random::{Random, Source};

/// Ratio of neighbouring corners; the density then follows 1/f within 2 %.
const RATIO: f64 = 4.0;
/// Lowest corner in hertz: flat under it, so that the noise has a variance.
const LOWEST_HZ: f64 = 1e-3;
/// Number of processes: corners up to 262 Hz, five times the sensors' bandwidth.
const COUNT: usize = 10;

/// One source of 1/f noise, sampled at a fixed interval.
#[derive(Clone, Debug)]
pub struct Flicker {
    values: [f64; COUNT],
    /// Per step: what remains of the value, and the deviation of what is added.
    steps: [(f64, f64); COUNT],
    random: Random,
}

impl Flicker {
    /// Noise of `corner_hz` over a white one-sided density, stepped by `interval_s`; starts
    /// stationary.
    #[must_use]
    pub fn new(density: f64, corner_hz: f64, interval_s: f64, seed: u64, channel: u8) -> Self {
        let mut random = Random::new(seed, Source::Flicker(channel));
        let deviation = density * (corner_hz * libm::log(RATIO)).sqrt();
        let mut frequency_hz = LOWEST_HZ;
        let steps = std::array::from_fn(|_| {
            let rate = 2.0 * std::f64::consts::PI * frequency_hz;
            frequency_hz *= RATIO;
            let kept = libm::exp(-rate * interval_s);
            (kept, deviation * (1.0 - kept * kept).sqrt())
        });
        let values = std::array::from_fn(|_| deviation * random.normal());
        Self {
            values,
            steps,
            random,
        }
    }

    /// The present value.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.values.iter().sum()
    }

    /// Goes one interval on.
    pub fn step(&mut self) {
        for (value, (kept, added)) in self.values.iter_mut().zip(&self.steps) {
            *value = *kept * *value + *added * self.random.normal();
        }
    }

    /// One-sided density at `frequency_hz` that the processes have together, in units per rtHz.
    #[must_use]
    pub fn density(density: f64, corner_hz: f64, frequency_hz: f64) -> f64 {
        let variance = density * density * corner_hz * libm::log(RATIO);
        let mut corner = LOWEST_HZ;
        let mut sum = 0.0;
        for _ in 0..COUNT {
            let ratio = frequency_hz / corner;
            sum += 2.0 * variance / (std::f64::consts::PI * corner) / (1.0 + ratio * ratio);
            corner *= RATIO;
        }
        sum.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_density_follows_one_over_f_within_2_percent() {
        for frequency in [0.01, 0.03, 0.1, 0.4, 1.0, 3.0, 10.0, 20.0] {
            let power = Flicker::density(2.0, 3.0, frequency);
            let expected = (4.0_f64 * 3.0 / frequency).sqrt();
            assert!(
                (power / expected - 1.0).abs() < 0.02,
                "{frequency} Hz: {power} {expected}"
            );
        }
    }

    #[test]
    fn the_allan_deviation_at_rest_is_flat_at_its_theoretical_level() {
        // For a 1/f density h/f the Allan variance is 2 ln(2) h at every averaging time.
        let (density, corner) = (1.0_f64, 1.0_f64);
        let level = (2.0 * 2.0_f64.ln() * density * density * corner).sqrt();
        let interval_s = 0.02;
        let mut flicker = Flicker::new(density, corner, interval_s, 11, 0);
        let samples: Vec<f64> = (0..1_000_000)
            .map(|_| {
                flicker.step();
                flicker.value()
            })
            .collect();
        for length in [25_usize, 100, 400] {
            let means: Vec<f64> = samples
                .chunks_exact(length)
                .map(|c| c.iter().sum::<f64>() / length as f64)
                .collect();
            let square = means
                .windows(2)
                .map(|w| (w[1] - w[0]) * (w[1] - w[0]))
                .sum::<f64>()
                / (2.0 * (means.len() - 1) as f64);
            let ratio = square.sqrt() / level;
            // 2,500 independent differences: 2 % standard error at the longest time.
            assert!((0.92..1.08).contains(&ratio), "{length} samples: {ratio}");
        }
    }
}
