//! The converter's multiplexer and sampling capacitor, which all channels share.
//!
//! The capacitor comes from the channel before with that channel's voltage and settles to the new
//! one through driver and multiplexer until the hold instant. What remains of the neighbour is
//! exp(-t/RC) of the difference. Track-and-hold pairs and low-passes stand before it, one per channel;
//! what the tilt channels' shared band-pass carries over is `turns`' concern.

use cardan_scenario::hardware::Adc;
use cardan_spec::REFERENCE_V;
use cardan_spec::timing::{ADC_PRESCALER, CPU_HZ};

use crate::adc::LSB_V;
use crate::error::Error;

/// ADC clocks for which an auto-triggered conversion connects the capacitor before it holds
/// (data sheet, ADC timing).
const SAMPLE_CLOCKS: u64 = 2;

/// Largest admissible residue of a neighbour at the other end of the scale, in steps.
pub(crate) const MOST_RESIDUE_LSB: f64 = 0.1;

/// The sampling capacitor.
#[derive(Clone, Debug)]
pub(crate) struct Sampler {
    /// Share of the voltage before that is left at the hold instant.
    residue: f64,
    held_v: f64,
}

impl Sampler {
    /// # Errors
    /// Resistance and capacitance that leave more than [`MOST_RESIDUE_LSB`] of a neighbour.
    pub(crate) fn new(adc: &Adc) -> Result<Self, Error> {
        let time_s = (SAMPLE_CLOCKS * ADC_PRESCALER) as f64 / CPU_HZ as f64;
        let tau_s = adc.source_ohm * adc.sample_pf * 1e-12;
        let residue = if tau_s > 0.0 {
            libm::exp(-time_s / tau_s)
        } else {
            0.0
        };
        let residue_lsb = residue * REFERENCE_V / LSB_V;
        if residue_lsb > MOST_RESIDUE_LSB {
            let least = libm::log(REFERENCE_V / LSB_V / MOST_RESIDUE_LSB);
            let most_ohm = time_s / least / (adc.sample_pf * 1e-12);
            let message = format!(
                "{residue_lsb:.2} LSB of the channel before remain on the sampling capacitor; \
                 expected at most {MOST_RESIDUE_LSB}, that is up to {most_ohm:.0} ohm with this \
                 adc.sample_pf"
            );
            return Err(Error::design("adc.source_ohm", &message));
        }
        Ok(Self {
            residue,
            held_v: 0.0,
        })
    }

    /// The voltage held after sampling a pin at `pin_v`.
    pub(crate) fn take(&mut self, pin_v: f64) -> f64 {
        self.held_v = pin_v + (self.held_v - pin_v) * self.residue;
        self.held_v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_source_leaves_a_share_of_the_neighbour_and_a_slower_one_is_refused() {
        // 100 kohm and 14 pF: 1.4 us, 11.4 time constants in 16 us.
        let mut slow = Sampler::new(&Adc {
            source_ohm: 1e5,
            ..Adc::default()
        })
        .expect("allowed");
        slow.take(5.0);
        let left = slow.take(0.0) / LSB_V;
        assert!(
            (left / (1024.0 * libm::exp(-16e-6 / 1.4e-6)) - 1.0).abs() < 1e-4,
            "{left}"
        );
        let slower = Sampler::new(&Adc {
            source_ohm: 1.3e5,
            ..Adc::default()
        });
        let message = slower.expect_err("refused").to_string();
        assert!(
            message.contains("adc.source_ohm") && message.contains("ohm with"),
            "{message}"
        );
    }
}
