//! What the designer of the board computes from the parameters: gains, corners, group delay.
//!
//! All of it comes from the model itself in its periodic steady state under the nominal edges,
//! x(k+1) = Phi x(k) + Gamma u(k) + Slope u' over one period T, for sensors without deviations. T is
//! the carrier's for a magnetometer, the multiplexer's for the tilt channels, whose state is that of
//! both (`turns.rs`).
//!
//! - scale: the output for a constant input of one is C s with s = (I - Phi)^-1 Gamma; the
//!   band-pass's gain makes full scale reach the rails exactly;
//! - group delay at zero frequency: a ramp comes out late by
//!   C (I - Phi)^-1 (s T - Slope) / C s;
//! - the magnetometers' low-pass corner makes that delay equal to the tilt channels'. By parts:
//!   1/w_gas + 1/w_detector + sqrt(2)/w_tilt + 0.8 ms = 2 Q_m/w_m + sqrt(2)/w_field, where 0.8 ms are
//!   the mean age of what a tilt channel holds between its turns, about 10.2 ms, and with the
//!   reference parameters about 28 Hz. The band-pass (2 Q/w) is common;
//! - residue: what the other tilt channel's full scale leaves in this one's averages.

use cardan_scenario::Scenario;
use cardan_scenario::experience::REFERENCE_K;
use cardan_scenario::hardware::Frontend as Parameters;
use cardan_sensors::{Accelerometer, Axis, LinearSensor, Magnetometer};
use cardan_spec::timing::{CPU_HZ, HALF_CARRIER_CYCLES};
use cardan_spec::{Channel, FIELD_FULL_SCALE_UT, REFERENCE_V, TILT_FULL_SCALE_G, ThirdTilt};
use cardan_units::Cycles;

use crate::adc::LSB_V;
use crate::chain::{BAND_PASS, Chain, OUTPUT};
use crate::error::Error;
use crate::matrix;
use crate::pattern::Patterns;
use crate::propagate::{SIGNAL, SLOPE};
use crate::sampler::MOST_RESIDUE_LSB;
use crate::switching::{Edge, EdgeQueue, Pin, Switching, Wiring};
use crate::turns;

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
    /// What full scale of the channel that shares the band-pass leaves in this one's averages, in
    /// steps of the converter; 0 for a band-pass of its own.
    pub residue_lsb: f64,
}

/// The board's design.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Design {
    /// Tilt channels.
    pub tilt: ChainDesign,
    /// The third tilt channel, which shares no band-pass: at the comparator its delay is shorter; measured,
    /// its low-pass is lower, so that all delays are equal.
    pub third_tilt: ChainDesign,
    /// Magnetometer channels.
    pub field: ChainDesign,
}

impl Design {
    /// Designs the board for the scenario's parameters.
    ///
    /// # Errors
    /// Parameters with which no gain or corner gives the specified scale or delay, or with which a
    /// tilt channel keeps more than 0.1 steps of the other.
    pub fn new(scenario: &Scenario) -> Result<Self, Error> {
        let accelerometer = Accelerometer::as_designed(&scenario.sensors.accelerometer, Axis::X);
        let magnetometer = Magnetometer::as_designed(&scenario.sensors.magnetometer, Axis::X);
        let tilt = |wiring: Wiring| Kind {
            scenario,
            sensor: accelerometer.linear(),
            wiring,
            full_scale: TILT_FULL_SCALE_G,
            clock_hz: CPU_HZ as f64,
        };
        let field = Kind {
            scenario,
            sensor: magnetometer.linear(REFERENCE_K),
            wiring: Wiring::of(Channel::FieldX),
            full_scale: FIELD_FULL_SCALE_UT,
            clock_hz: CPU_HZ as f64,
        };
        let corner_hz = scenario.frontend.tilt_low_pass_hz;
        let third_tilt = tilt(Wiring::of(Channel::TiltZ));
        let tilt = tilt(Wiring::of(Channel::TiltX)).finish(corner_hz)?;
        let third_tilt = match scenario.sensors.third_tilt {
            ThirdTilt::Measured => {
                let corner_hz = third_tilt.corner_for(tilt.group_delay_s)?;
                third_tilt.finish(corner_hz)?
            }
            ThirdTilt::Comparator | ThirdTilt::Absent => third_tilt.finish(corner_hz)?,
        };
        let low_pass_hz = field.corner_for(tilt.group_delay_s)?;
        Ok(Self {
            tilt,
            third_tilt,
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
pub(crate) struct Kind<'a> {
    pub(crate) scenario: &'a Scenario,
    pub(crate) sensor: LinearSensor,
    pub(crate) wiring: Wiring,
    pub(crate) full_scale: f64,
    /// The controller's clock, which times the edges.
    pub(crate) clock_hz: f64,
}

/// Response of a chain to an input of one.
pub(crate) struct Response {
    /// Low-pass's output.
    pub(crate) output: f64,
    /// Amplitude of the band-pass's output.
    pub(crate) amplitude: f64,
    pub(crate) group_delay_s: f64,
    /// Low-pass's output of the channel that shares the band-pass.
    pub(crate) neighbour: f64,
}

impl Response {
    fn residue_lsb(&self) -> f64 {
        (self.neighbour / self.output).abs() * 0.5 * REFERENCE_V / LSB_V
    }
}

impl Kind<'_> {
    pub(crate) fn patterns(
        &self,
        parameters: &Parameters,
        band_pass_gain: f64,
        low_pass_hz: f64,
        noisy: bool,
    ) -> Patterns {
        let chain = Chain {
            sensor: self.sensor,
            parameters,
            band_pass_gain,
            low_pass_hz,
            noisy,
        };
        Patterns::new(&chain, self.clock_hz)
    }

    /// The gain that makes full scale reach the rails, and what follows from it.
    pub(crate) fn finish(&self, low_pass_hz: f64) -> Result<ChainDesign, Error> {
        let p = &self.scenario.frontend;
        let response = self.response(p, low_pass_hz)?;
        let residue_lsb = response.residue_lsb();
        if residue_lsb > MOST_RESIDUE_LSB {
            return Err(self.slow_band_pass(residue_lsb));
        }
        let output_v = self.full_scale * p.output_gain * response.output;
        let band_pass_gain = 0.5 * REFERENCE_V / output_v;
        if !(band_pass_gain > 0.0 && band_pass_gain < 1e9) {
            let message = "with these parameters the track-and-hold does not meet the signal's \
                           peaks, so no gain makes full scale reach the rails";
            return Err(Error::design(
                "frontend.band_pass_hz, frontend.aperture_cycles",
                message,
            ));
        }
        let amplitude = response.amplitude * self.full_scale * band_pass_gain;
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
            residue_lsb,
        })
    }

    /// The low-pass corner at which the group delay is `delay_s`.
    fn corner_for(&self, delay_s: f64) -> Result<f64, Error> {
        // A Butterworth corner adds sqrt(2)/(2 pi f): the delay is all but linear in 1/f.
        let slope = std::f64::consts::SQRT_2 / (2.0 * std::f64::consts::PI);
        let p = &self.scenario.frontend;
        let mut period = 1.0 / p.tilt_low_pass_hz;
        for _ in 0..6 {
            let response = self.response(p, 1.0 / period)?;
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

    /// The band-pass is too slow for the multiplexer: which quality would do.
    fn slow_band_pass(&self, residue_lsb: f64) -> Error {
        let p = &self.scenario.frontend;
        let passes = |band_pass_quality: f64| {
            let other = Parameters {
                band_pass_quality,
                ..p.clone()
            };
            self.response(&other, p.tilt_low_pass_hz)
                .is_ok_and(|response| response.residue_lsb() <= MOST_RESIDUE_LSB)
        };
        // To a hundredth, downwards: what is told passes.
        let (mut most, mut refused) = (0, (100.0 * p.band_pass_quality) as u32 + 1);
        while refused - most > 1 {
            let middle = (most + refused) / 2;
            if passes(f64::from(middle) / 100.0) {
                most = middle;
            } else {
                refused = middle;
            }
        }
        let admissible = if most > 0 {
            let most = f64::from(most) / 100.0;
            format!("that is a quality of up to {most:.2} with this frontend.band_pass_hz")
        } else {
            "which no quality gives with this frontend.band_pass_hz".to_owned()
        };
        let message = format!(
            "{residue_lsb:.2} LSB of the tilt channel that has the band-pass before remain in an \
             average; expected at most {MOST_RESIDUE_LSB}, {admissible}"
        );
        Error::design(
            "frontend.band_pass_quality, frontend.band_pass_hz",
            &message,
        )
    }

    fn response(&self, parameters: &Parameters, low_pass_hz: f64) -> Result<Response, Error> {
        let mut patterns = self.patterns(parameters, 1.0, low_pass_hz, false);
        let response = if self.wiring.shares_band_pass() {
            turns::response(
                &mut patterns,
                self.wiring,
                parameters.aperture_cycles as u64,
            )
        } else {
            self.response_alone(&mut patterns)
        };
        response.ok_or_else(|| Error::design("frontend", "the chain has no steady state"))
    }

    /// The response with a band-pass of its own, looked at once per carrier period.
    fn response_alone(&self, patterns: &mut Patterns) -> Option<Response> {
        let step = patterns.step(&self.period_pattern());
        let gap = matrix::sum_scaled(&matrix::identity(), &step.phi, -1.0);
        let settled = matrix::solve(&gap, &step.gamma[SIGNAL])?;
        let mut behind = step.gamma[SLOPE].map(|x| -x);
        matrix::add_scaled(&mut behind, &settled, step.span_s);
        let delayed = matrix::solve(&gap, &behind)?;
        let (v, z) = (settled[BAND_PASS], settled[BAND_PASS + 1]);
        Some(Response {
            output: settled[OUTPUT],
            amplitude: (v * v + z * z).sqrt(),
            group_delay_s: delayed[OUTPUT] / settled[OUTPUT],
            neighbour: 0.0,
        })
    }

    /// Segments of one period of the nominal carrier, once apertures overlap as they will.
    fn period_pattern(&self) -> Vec<crate::pattern::Segment> {
        let aperture = self.scenario.frontend.aperture_cycles as u64;
        let periods = 2 + aperture / PERIOD_CYCLES;
        let mut edges = EdgeQueue::default();
        nominal_edges()
            .take_while(|edge| edge.cycle <= periods * PERIOD_CYCLES)
            .for_each(|edge| edges.push(edge));
        let mut switching = Switching::new(self.wiring, aperture);
        let mut segments = Vec::new();
        for period in 1..=periods {
            segments.clear();
            switching.collect(period * PERIOD_CYCLES, &edges, &mut segments);
        }
        segments
    }
}

/// The edges of all pins after reset, in order, as Timer1 and Timer2 make them when started together.
pub fn nominal_edges() -> impl Iterator<Item = Edge> + Clone {
    (0..).flat_map(half_period_edges)
}

/// The edges of half period `half`: at most one of Timer2's, which come first.
fn half_period_edges(half: u64) -> impl Iterator<Item = Edge> + Clone {
    use cardan_spec::timing::{CARRIER_COUNT, SETTLING_CYCLES, STROBE_COUNT, TURN_CYCLES};
    const { assert!(SETTLING_CYCLES % HALF_CARRIER_CYCLES <= STROBE_COUNT as u64) };
    const { assert!(TURN_CYCLES.is_multiple_of(HALF_CARRIER_CYCLES)) };
    let start = half * HALF_CARRIER_CYCLES;
    let every_turn = |first: u64, pin: Pin| {
        // The first one of this pin at or after the start of the half period.
        let number = start.saturating_sub(first).div_ceil(TURN_CYCLES);
        let edge = Edge {
            cycle: first + number * TURN_CYCLES,
            pin,
            high: number.is_multiple_of(2),
        };
        (edge.cycle < start + HALF_CARRIER_CYCLES).then_some(edge)
    };
    let every_half = |count: u16, pin: Pin| {
        Some(Edge {
            cycle: start + u64::from(count) + 1,
            pin,
            high: half.is_multiple_of(2),
        })
    };
    [
        every_turn(TURN_CYCLES, Pin::Select),
        every_turn(SETTLING_CYCLES, Pin::Settled),
        every_half(STROBE_COUNT, Pin::Strobe),
        every_half(CARRIER_COUNT, Pin::Carrier),
    ]
    .into_iter()
    .flatten()
}
