//! Errors of the converter, applied between the pin's voltage and the ideal quantiser.
//!
//! Apart from the front end because the error budget tells them apart. The disturbed voltage is what
//! an ideal converter needs to give the same code: white noise, offset, gain, a bow of integral
//! nonlinearity, and steps in wrong places (differential nonlinearity).

use cardan_scenario::Scenario;
use cardan_scenario::hardware::Adc as Parameters;
use cardan_scenario::random::{Random, Source};
use cardan_spec::REFERENCE_V;
use cardan_units::{AdcCode, Volts};

/// One step of the converter in volts.
pub const LSB_V: f64 = REFERENCE_V / AdcCode::COUNT as f64;

/// The errors of one converter.
#[derive(Clone, Debug)]
pub struct AdcErrors {
    parameters: Parameters,
    noise_lsb: f64,
    noise: Random,
    /// Shift of the lower edge of every code, in steps.
    edges_lsb: Vec<f64>,
}

impl AdcErrors {
    /// The converter of `scenario` under `seed`.
    #[must_use]
    pub fn new(scenario: &Scenario, seed: u64) -> Self {
        let parameters = scenario.adc.clone();
        let mut steps = Random::new(seed, Source::Steps);
        let shift = |_| parameters.dnl_lsb * (steps.uniform() - 0.5);
        Self {
            edges_lsb: (0..=AdcCode::COUNT).map(shift).collect(),
            noise_lsb: if scenario.noise.enabled {
                parameters.noise_lsb
            } else {
                0.0
            },
            noise: Random::new(seed, Source::Converter),
            parameters,
        }
    }

    /// The same converter, in a run whose noise has another seed.
    #[must_use]
    pub fn with_noise_of(self, seed: u64) -> Self {
        Self {
            noise: Random::new(seed, Source::Converter),
            ..self
        }
    }

    /// What the quantiser sees of `pin` in conversion number `sequence`: a pure function of both,
    /// the noise of a conversion does not depend on which others were made.
    #[must_use]
    pub fn apply(&self, pin: Volts, sequence: u64) -> Volts {
        let p = &self.parameters;
        let span = f64::from(AdcCode::COUNT);
        let mut lsb = pin.0 / LSB_V;
        if self.noise_lsb > 0.0 {
            // A block of 16 words holds eight draws; one nearly always suffices.
            lsb += self.noise_lsb * self.noise.at_block(sequence).normal();
        }
        let x = (lsb / span).clamp(0.0, 1.0);
        lsb += p.offset_lsb + p.gain_lsb * x + p.inl_lsb * 4.0 * x * (1.0 - x);
        if p.dnl_lsb > 0.0 {
            lsb = self.misplaced(lsb);
        }
        Volts(lsb * LSB_V)
    }

    /// Maps the interval between two misplaced code edges to that between the ideal ones.
    fn misplaced(&self, lsb: f64) -> f64 {
        let last = self.edges_lsb.len() - 2;
        let edge = |code: usize| code as f64 + self.edges_lsb[code];
        let mut code = (lsb.max(0.0) as usize).min(last);
        if code > 0 && lsb < edge(code) {
            code -= 1;
        } else if code < last && lsb >= edge(code + 1) {
            code += 1;
        }
        let (low, high) = (edge(code), edge(code + 1));
        let within = if high > low {
            ((lsb - low) / (high - low)).clamp(0.0, 0.999_999)
        } else {
            0.5
        };
        code as f64 + within
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn converter(change: impl FnOnce(&mut Scenario)) -> AdcErrors {
        let mut scenario = Scenario::default();
        change(&mut scenario);
        AdcErrors::new(&scenario, 4)
    }

    #[test]
    fn a_perfect_converter_changes_nothing() {
        let adc = converter(|s| s.noise.enabled = false);
        for code in 0..1024 {
            let volts = Volts((f64::from(code) + 0.5) * LSB_V);
            assert!((adc.apply(volts, 9).0 - volts.0).abs() < 1e-12);
        }
    }

    #[test]
    fn noise_has_the_stated_deviation_and_depends_on_the_conversion_only() {
        let adc = converter(|_| ());
        let n = 50_000;
        let error = |k| (adc.apply(Volts(2.5), k).0 - 2.5) / LSB_V;
        let square = (0..n).map(|k| error(k) * error(k)).sum::<f64>() / n as f64;
        // Standard error 0.3 %.
        assert!((square.sqrt() - 0.5).abs() < 0.008, "{square}");
        // Whatever the voltage and whatever was converted before.
        let other = converter(|_| ());
        let at = |volts: f64| (other.apply(Volts(volts), 17).0 - volts) / LSB_V;
        assert!((at(0.7) - error(17)).abs() < 1e-9 && (at(4.1) - error(17)).abs() < 1e-9);
        assert_ne!(error(17), error(18));
    }

    #[test]
    fn offset_gain_and_bow_shift_the_scale_as_named() {
        let at = |adc: &AdcErrors, x: f64| adc.apply(Volts(5.0 * x), 0).0 / LSB_V - 1024.0 * x;
        let bent = converter(|s| {
            s.noise.enabled = false;
            s.adc.offset_lsb = 2.0;
            s.adc.gain_lsb = -1.0;
            s.adc.inl_lsb = 0.5;
        });
        for (x, expected) in [(0.0, 2.0), (0.5, 2.0), (1.0, 1.0), (0.25, 2.125)] {
            assert!(
                (at(&bent, x) - expected).abs() < 1e-9,
                "{x}: {}",
                at(&bent, x)
            );
        }
    }

    #[test]
    fn misplaced_steps_keep_the_codes_in_order_and_within_their_bound() {
        let adc = converter(|s| {
            s.noise.enabled = false;
            s.adc.dnl_lsb = 0.5;
        });
        let code = |lsb: f64| (adc.apply(Volts(lsb * LSB_V), 0).0 / LSB_V).floor();
        let (mut before, mut misplaced) = (0.0, 0);
        for fine in 0..102_400 {
            let lsb = f64::from(fine) / 100.0;
            let now = code(lsb);
            assert!(now >= before && (now - lsb).abs() < 1.26, "{lsb}: {now}");
            before = now;
            misplaced += u32::from(now != lsb.floor());
        }
        // Steps up to a quarter of an LSB beside their place, an eighth on the average.
        let share = f64::from(misplaced) / 102_400.0;
        assert!((0.02..0.25).contains(&share), "{share} of the scale");
    }
}
