//! What the designer of the board computes from the parameters: gains, corners, group delay.
//!
//! All of it comes from the model itself in its periodic steady state under the nominal carrier,
//! x(k+1) = Phi x(k) + Gamma u(k) + Slope u' over one period T, for sensors without deviations:
//!
//! - scale: the output for a constant input of one is C s with s = (I - Phi)^-1 Gamma; the
//!   band-pass's gain makes full scale reach the rails exactly;
//! - group delay at zero frequency: a ramp comes out late by
//!   C (I - Phi)^-1 (s T - Slope) / C s;
//! - the magnetometers' low-pass corner makes that delay equal to the tilt channels'. By parts:
//!   1/w_gas + 1/w_detector + sqrt(2)/w_tilt = 2 Q_m/w_m + sqrt(2)/w_field, about 9.4 ms, and with
//!   the reference parameters about 31 Hz. Band-pass (2 Q/w) and track-and-hold (T/2) are common.

use cardan_scenario::Scenario;
use cardan_scenario::experience::REFERENCE_K;
use cardan_sensors::{Accelerometer, Axis, LinearSensor, Magnetometer};
use cardan_spec::timing::{CPU_HZ, HALF_CARRIER_CYCLES};
use cardan_spec::{FIELD_FULL_SCALE_UT, REFERENCE_V, TILT_FULL_SCALE_G};
use cardan_units::Cycles;

use crate::chain::{BAND_PASS, Chain, OUTPUT, STATES};
use crate::error::Error;
use crate::matrix::{self, Vector};
use crate::pattern::Patterns;
use crate::propagate::{SIGNAL, SLOPE};
use crate::switching::{Edge, EdgeQueue, Pin, Switching};

/// Cycles of one carrier period.
pub const PERIOD_CYCLES: u64 = 2 * HALF_CARRIER_CYCLES;

/// What distinguishes the chains of a kind of channel by design.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainDesign {
    /// Gain from the first amplifier's output to the band-pass's at its centre.
    pub band_pass_gain: f64,
    /// Corner of the low-pass in hertz.
    pub low_pass_hz: f64,
    /// Group delay at zero frequency in seconds.
    pub group_delay_s: f64,
    /// Amplitude of the band-pass's output at full scale in volts.
    pub full_scale_amplitude_v: f64,
}

/// The board's design.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Design {
    /// Tilt channels.
    pub tilt: ChainDesign,
    /// Magnetometer channels.
    pub field: ChainDesign,
}

impl Design {
    /// Designs the board for the scenario's parameters.
    ///
    /// # Errors
    /// Parameters with which no gain or corner gives the specified scale or delay.
    pub fn new(scenario: &Scenario) -> Result<Self, Error> {
        let accelerometer = Accelerometer::as_designed(&scenario.sensors.accelerometer, Axis::X);
        let magnetometer = Magnetometer::as_designed(&scenario.sensors.magnetometer, Axis::X);
        let tilt = Kind {
            scenario,
            sensor: accelerometer.linear(),
            strobe: Pin::Strobe,
            full_scale: TILT_FULL_SCALE_G,
        };
        let field = Kind {
            scenario,
            sensor: magnetometer.linear(REFERENCE_K),
            strobe: Pin::Carrier,
            full_scale: FIELD_FULL_SCALE_UT,
        };
        let tilt = tilt.finish(scenario.frontend.tilt_low_pass_hz)?;
        let low_pass_hz = field.corner_for(tilt.group_delay_s)?;
        Ok(Self {
            tilt,
            field: field.finish(low_pass_hz)?,
        })
    }

    /// Group delay of all channels, from specific force or field to the converter's pin, seconds.
    #[must_use]
    pub fn group_delay_s(&self) -> f64 {
        self.tilt.group_delay_s
    }

    /// The instant, in seconds after reset, whose attitude a solution tells: the centre of its
    /// conversions less the group delay.
    #[must_use]
    pub fn output_instant_s(&self, first_hold: Cycles, last_hold: Cycles) -> f64 {
        (first_hold.0 + last_hold.0) as f64 / (2.0 * CPU_HZ as f64) - self.group_delay_s()
    }
}

/// A kind of channel before its design is settled.
struct Kind<'a> {
    scenario: &'a Scenario,
    sensor: LinearSensor,
    strobe: Pin,
    full_scale: f64,
}

/// Response of a chain to an input of one, per period.
struct Response {
    /// Steady state.
    settled: Vector<STATES>,
    group_delay_s: f64,
}

impl Kind<'_> {
    fn chain(&self, band_pass_gain: f64, low_pass_hz: f64) -> Chain<'_> {
        Chain {
            sensor: self.sensor,
            parameters: &self.scenario.frontend,
            band_pass_gain,
            low_pass_hz,
            noisy: false,
        }
    }

    /// The gain that makes full scale reach the rails, and what follows from it.
    fn finish(&self, low_pass_hz: f64) -> Result<ChainDesign, Error> {
        let response = self.response(&self.chain(1.0, low_pass_hz))?;
        let p = &self.scenario.frontend;
        let output_v = self.full_scale * p.output_gain * response.settled[OUTPUT];
        let band_pass_gain = 0.5 * REFERENCE_V / output_v;
        if !(band_pass_gain > 0.0 && band_pass_gain < 1e9) {
            let message = "with these parameters the track-and-hold does not meet the signal's \
                           peaks, so no gain makes full scale reach the rails";
            return Err(Error::design(
                "frontend.band_pass_hz, frontend.aperture_cycles",
                message,
            ));
        }
        let (v, z) = (response.settled[BAND_PASS], response.settled[BAND_PASS + 1]);
        let amplitude = (v * v + z * z).sqrt() * self.full_scale * band_pass_gain;
        if amplitude > p.band_pass_swing_v {
            let message = format!(
                "full scale needs an amplitude of {amplitude:.3} V; expected at least that, or a \
                 larger frontend.output_gain"
            );
            return Err(Error::design("frontend.band_pass_swing_v", &message));
        }
        Ok(ChainDesign {
            band_pass_gain,
            low_pass_hz,
            group_delay_s: response.group_delay_s,
            full_scale_amplitude_v: amplitude,
        })
    }

    /// The low-pass corner at which the group delay is `delay_s`.
    fn corner_for(&self, delay_s: f64) -> Result<f64, Error> {
        // A Butterworth corner adds sqrt(2)/(2 pi f): the delay is all but linear in 1/f.
        let slope = std::f64::consts::SQRT_2 / (2.0 * std::f64::consts::PI);
        let mut period = 1.0 / self.scenario.frontend.tilt_low_pass_hz;
        for _ in 0..6 {
            let response = self.response(&self.chain(1.0, 1.0 / period))?;
            period += (delay_s - response.group_delay_s) / slope;
            if period.is_nan() || period <= 1e-4 {
                let message = "the magnetometer alone is slower than the whole tilt channel, so \
                               their delays cannot be made equal: lower the quality or the tilt \
                               channel's corners";
                return Err(Error::design("sensors.magnetometer.quality", message));
            }
        }
        Ok(1.0 / period)
    }

    fn response(&self, chain: &Chain<'_>) -> Result<Response, Error> {
        let mut patterns = Patterns::new(chain, CPU_HZ as f64);
        let step = patterns.step(&self.period_pattern());
        let gap = matrix::sum_scaled(&matrix::identity(), &step.phi, -1.0);
        let unstable = || Error::design("frontend", "the chain has no steady state");
        let settled = matrix::solve(&gap, &step.gamma[SIGNAL]).ok_or_else(unstable)?;
        let mut behind = step.gamma[SLOPE].map(|x| -x);
        matrix::add_scaled(&mut behind, &settled, step.span_s);
        let delayed = matrix::solve(&gap, &behind).ok_or_else(unstable)?;
        let group_delay_s = delayed[OUTPUT] / settled[OUTPUT];
        Ok(Response {
            settled,
            group_delay_s,
        })
    }

    /// Segments of one period of the nominal carrier, once apertures overlap as they will.
    fn period_pattern(&self) -> Vec<crate::pattern::Segment> {
        let aperture = self.scenario.frontend.aperture_cycles as u64;
        let periods = 2 + aperture / PERIOD_CYCLES;
        let mut edges = EdgeQueue::default();
        for half in 0..=2 * periods {
            for edge in nominal_edges(half) {
                edges.push(edge);
            }
        }
        let mut switching = Switching::new(self.strobe, aperture);
        let mut segments = Vec::new();
        for period in 1..=periods {
            segments.clear();
            switching.collect(period * PERIOD_CYCLES, &edges, &mut segments);
        }
        segments
    }
}

/// The strobe's and the carrier's edge of half period `half` after reset, as Timer1 makes them.
#[must_use]
pub fn nominal_edges(half: u64) -> [Edge; 2] {
    use cardan_spec::timing::{CARRIER_COUNT, STROBE_COUNT};
    let at = |count: u16| half * HALF_CARRIER_CYCLES + u64::from(count) + 1;
    let high = half.is_multiple_of(2);
    [
        Edge {
            cycle: at(STROBE_COUNT),
            pin: Pin::Strobe,
            high,
        },
        Edge {
            cycle: at(CARRIER_COUNT),
            pin: Pin::Carrier,
            high,
        },
    ]
}
