//! What the chopping frequency buys: the tilt channels' noise if the bridges were chopped at another.
//!
//! The board is scaled in time: carrier, strobes, the multiplexer's turns and the conversions of one
//! at f are those of the reference board with a clock slower by f / 16 kHz; the band-pass is centred on
//! f with the same quality; the low-pass stays, and the aperture as far as whole cycles allow. Its covariance is carried exactly from one
//! conversion to the next. (The magnetometers cannot follow: their carrier is the resonance.)

use cardan_scenario::Scenario;
use cardan_sensors::{Accelerometer, Axis, LinearSensor};
use cardan_spec::timing::{CARRIER_HZ, CONVERSION_CYCLES, CPU_HZ, TURN_CYCLES};
use cardan_spec::{CHANNELS, Channel, TILT_FULL_SCALE_G};

use crate::chain::OUTPUT;
use crate::design::{ChainDesign, Kind};
use crate::error::Error;
use crate::matrix::{self, Matrix, Vector};
use crate::switching::Wiring;
use crate::turns::{BOTH, Motion, Turns};

/// A board that chops the tilt bridges at some frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Chopped {
    /// A channel's turn with the band-pass in seconds.
    pub turn_s: f64,
    /// Gain, group delay, residue.
    pub design: ChainDesign,
    /// Deviation of the noise in averages over the windows asked for, in g.
    pub noise_g: Vec<f64>,
}

/// Designs a board that chops at `carrier_hz`, and computes its noise in averages of the conversions
/// within each of `windows_s` seconds (one at least).
///
/// # Errors
/// Parameters that give no working design at this frequency.
pub fn chopped(scenario: &Scenario, carrier_hz: f64, windows_s: &[f64]) -> Result<Chopped, Error> {
    let ratio = carrier_hz / CARRIER_HZ as f64;
    let clock_hz = CPU_HZ as f64 * ratio;
    let mut scenario = scenario.clone();
    scenario.frontend.band_pass_hz *= ratio;
    scenario.frontend.aperture_cycles =
        (scenario.frontend.aperture_cycles * ratio).round().max(1.0);
    let p = &scenario.frontend;
    let unit = &scenario.sensors.accelerometer;
    let sensor = LinearSensor {
        // Its own: the designed one has the default noise.
        input_noise: Accelerometer::new(unit, Axis::X).linear().input_noise,
        ..Accelerometer::as_designed(unit, Axis::X).linear()
    };
    let kind = Kind {
        scenario: &scenario,
        sensor,
        wiring: Wiring::of(Channel::TiltX),
        full_scale: TILT_FULL_SCALE_G,
        clock_hz,
    };
    let design = kind.finish(p.tilt_low_pass_hz)?;
    let counts = windows_s.iter().map(|window| {
        let rounds = window * clock_hz / (CHANNELS as u64 * CONVERSION_CYCLES) as f64;
        (rounds.round() as usize).max(1)
    });
    let mut patterns = kind.patterns(p, design.band_pass_gain, design.low_pass_hz, true);
    let turns = Turns::new(&mut patterns, kind.wiring, p.aperture_cycles as u64);
    let deviations = noise(&turns.motions(), &counts.collect::<Vec<_>>())
        .ok_or_else(|| Error::design("frontend", "the chain has no stationary noise"))?;
    // Full scale is half the supply at the low-pass's output times the last gain.
    let g_per_volt = TILT_FULL_SCALE_G * p.output_gain / (0.5 * cardan_spec::REFERENCE_V);
    Ok(Chopped {
        turn_s: TURN_CYCLES as f64 / clock_hz,
        design,
        noise_g: deviations.iter().map(|volts| volts * g_per_volt).collect(),
    })
}

/// Noise of the same amplifier without chopping, in averages over each of `windows_s` seconds, in g: its
/// bridge signal straight into the low-pass, after `observed_s` seconds without a new zero. Integrals
/// of the density over frequency.
#[must_use]
pub fn unchopped(scenario: &Scenario, observed_s: f64, windows_s: &[f64]) -> Vec<f64> {
    let unit = &scenario.sensors.accelerometer;
    let p = &scenario.frontend;
    let sensor = Accelerometer::as_designed(unit, Axis::X).linear();
    let white = p.lna_noise_nv_per_rthz * 1e-9;
    let bridge = sensor.output_noise_v;
    let volts_per_g = unit.sensitivity_mv_per_g * 1e-3;
    let density = |f: f64| white * white * (1.0 + p.lna_flicker_corner_hz / f) + bridge * bridge;
    let low_pass = |f: f64| 1.0 / (1.0 + (f / p.tilt_low_pass_hz).powi(4));
    let average = |f: f64, window: f64| {
        let x = std::f64::consts::PI * f * window;
        let sinc = if x < 1e-9 { 1.0 } else { libm::sin(x) / x };
        sinc * sinc
    };
    let deviation = |&window: &f64| {
        // Over the logarithm of frequency, by the midpoint rule.
        let (from, to) = (libm::log(1.0 / observed_s), libm::log(1e4));
        let step = (to - from) / INTEGRAL_STEPS as f64;
        let square: f64 = (0..INTEGRAL_STEPS)
            .map(|index| {
                let f = libm::exp(from + (index as f64 + 0.5) * step);
                density(f) * low_pass(f) * average(f, window) * f * step
            })
            .sum();
        square.sqrt() / volts_per_g
    };
    windows_s.iter().map(deviation).collect()
}

const INTEGRAL_STEPS: usize = 20_000;

/// Deviations in averages of `counts` conversions, at the low-pass's output, over all places of a
/// period at which they begin; none without a stationary state.
fn noise(motions: &[(Motion, bool)], counts: &[usize]) -> Option<Vec<f64>> {
    let rounds = rounds(motions);
    let mut start = stationary(&rounds)?;
    let most = *counts.iter().max()?;
    let mut squares = vec![0.0; most];
    for place in 0..rounds.len() {
        let mut sum = Sum::of(start);
        for (square, round) in squares.iter_mut().zip(rounds.iter().cycle().skip(place)) {
            sum.carry(round);
            sum.add();
            *square += sum.square / rounds.len() as f64;
        }
        start = rounds[place].covariance_after(&start);
    }
    let deviation = |&count: &usize| squares[count - 1].sqrt() / count as f64;
    Some(counts.iter().map(deviation).collect())
}

/// A period's motions from one conversion of the first channel to its next; the channels take turns
/// with the converter.
fn rounds(motions: &[(Motion, bool)]) -> Vec<Motion> {
    let first = motions
        .iter()
        .position(|(_, is_hold)| *is_hold)
        .map_or(0, |at| at + 1);
    let (before, after) = motions.split_at(first.min(motions.len()));
    let mut rounds = Vec::new();
    let (mut round, mut holds) = (None::<Motion>, 0);
    for (motion, is_hold) in after.iter().chain(before) {
        round = Some(round.map_or_else(|| motion.clone(), |so_far| so_far.then(motion)));
        holds += usize::from(*is_hold);
        if *is_hold && holds % CHANNELS == 0 {
            rounds.extend(round.take());
        }
    }
    rounds
}

/// The covariance before the first of a period's rounds.
fn stationary(rounds: &[Motion]) -> Option<Matrix<BOTH>> {
    let (first, rest) = rounds.split_first()?;
    let mut periods = rest
        .iter()
        .fold(first.clone(), |all, round| all.then(round));
    // 2^24 periods of 2 ms are nine hours.
    for _ in 0..24 {
        periods = periods.then(&periods);
    }
    (matrix::one_norm(&periods.map) < 1e-9).then_some(periods.added)
}

/// A sum of outputs of the first channel beside the state of both.
struct Sum {
    state: Matrix<BOTH>,
    /// Covariance of state and sum.
    cross: Vector<BOTH>,
    /// Variance of the sum.
    square: f64,
}

impl Sum {
    fn of(state: Matrix<BOTH>) -> Self {
        Self {
            state,
            cross: [0.0; BOTH],
            square: 0.0,
        }
    }

    fn add(&mut self) {
        self.square += 2.0 * self.cross[OUTPUT] + self.state[OUTPUT][OUTPUT];
        matrix::add_scaled(&mut self.cross, &self.state[OUTPUT], 1.0);
    }

    fn carry(&mut self, motion: &Motion) {
        self.state = motion.covariance_after(&self.state);
        self.cross = matrix::apply(&motion.map, &self.cross);
    }
}
