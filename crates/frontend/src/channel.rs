//! One channel: its state, advanced from event to event only when somebody asks for its voltage.

use cardan_scenario::experience::{Experience, Stimulus};
use cardan_scenario::hardware::Frontend as Parameters;
use cardan_scenario::random::Random;
use cardan_sensors::{Accelerometer, Flicker, Magnetometer};
use cardan_spec::REFERENCE_V;
use cardan_spec::timing::CPU_HZ;

use crate::chain::{BAND_PASS, OUTPUT, STATES};
use crate::design::PERIOD_CYCLES;
use crate::matrix::{self, Vector};
use crate::pattern::{Patterns, Segment};
use crate::saturation::{Stage, Watch};
use crate::switching::{EdgeQueue, Switching};

/// Periods for which a value of 1/f noise is held: 1 ms, short against the sensors' lags.
pub(crate) const FLICKER_PERIODS: u64 = 16;

/// The sensor of a channel.
#[derive(Clone, Debug)]
pub(crate) enum Unit {
    /// Thermal accelerometer.
    Tilt(Accelerometer),
    /// Lorentz magnetometer.
    Field(Magnetometer),
}

impl Unit {
    /// Input of the linear part.
    pub(crate) fn input(&self, experience: &Experience) -> f64 {
        match self {
            Unit::Tilt(unit) => unit.input(experience),
            Unit::Field(unit) => unit.input(experience),
        }
    }
}

/// Experiences by carrier period, so that four channels ask the stimulus once.
#[derive(Clone, Debug)]
pub(crate) struct Inputs<S> {
    stimulus: S,
    recent: Vec<(u64, Experience)>,
}

/// Periods remembered; more than channels are usually apart.
const REMEMBERED: usize = 64;

impl<S: Stimulus> Inputs<S> {
    pub(crate) fn new(stimulus: S) -> Self {
        Self {
            stimulus,
            recent: vec![(u64::MAX, Experience::default()); REMEMBERED],
        }
    }

    /// The experience at the middle of period `period`, held over it.
    pub(crate) fn during(&mut self, period: u64) -> &Experience {
        let slot = &mut self.recent[period as usize % REMEMBERED];
        if slot.0 != period {
            let cycle = (period * PERIOD_CYCLES + PERIOD_CYCLES / 2) as f64;
            *slot = (period, self.stimulus.at(cycle / CPU_HZ as f64));
        }
        &slot.1
    }
}

/// Limits and scales of a channel's stages.
#[derive(Clone, Debug)]
pub(crate) struct Stages {
    /// Gain of the last amplifier.
    pub output_gain: f64,
    /// Voltage at its output for no signal.
    pub output_zero_v: f64,
    /// Largest sensor state, at the band-pass's level, that the first amplifier passes.
    pub lna_limit_v: f64,
    /// Largest amplitude of the band-pass.
    pub band_pass_limit_v: f64,
}

impl Stages {
    pub(crate) fn new(p: &Parameters, band_pass_gain: f64) -> Self {
        Self {
            output_gain: p.output_gain * (1.0 + p.gain_error),
            output_zero_v: 0.5 * REFERENCE_V + 1e-3 * p.output_offset_mv,
            lna_limit_v: p.lna_swing_v * band_pass_gain,
            band_pass_limit_v: p.band_pass_swing_v,
        }
    }
}

/// One channel.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    unit: Unit,
    stages: Stages,
    patterns: Patterns,
    switching: Switching,
    state: Vector<STATES>,
    random: Random,
    flicker: Option<Flicker>,
    watch: Watch,
    segments: Vec<Segment>,
}

impl Channel {
    /// A channel at rest in what it experiences first.
    pub(crate) fn new(
        unit: Unit,
        stages: Stages,
        patterns: Patterns,
        switching: Switching,
        random: Random,
        flicker: Option<Flicker>,
        first: &Experience,
    ) -> Self {
        // Settled under the low carrier: 0 = A x + B u.
        let system = patterns.system(switching.switches());
        let mut drive = [0.0; STATES];
        matrix::add_scaled(&mut drive, &system.b[0], -unit.input(first));
        matrix::add_scaled(&mut drive, &system.b[1], -1.0);
        let state = matrix::solve(&system.a, &drive).unwrap_or([0.0; STATES]);
        let (watch, segments) = (Watch::default(), Vec::new());
        Self {
            unit,
            stages,
            patterns,
            switching,
            state,
            random,
            flicker,
            watch,
            segments,
        }
    }

    /// The cycle up to which the state is known.
    pub(crate) fn now(&self) -> u64 {
        self.switching.now()
    }

    /// Number of the next edge not yet used.
    pub(crate) fn next_edge(&self) -> u64 {
        self.switching.next_edge()
    }

    /// Saturation met so far.
    pub(crate) fn watch(&self) -> &Watch {
        &self.watch
    }

    /// Voltage at the converter's pin at `cycle`.
    pub(crate) fn voltage<S: Stimulus>(
        &mut self,
        cycle: u64,
        edges: &EdgeQueue,
        inputs: &mut Inputs<S>,
    ) -> f64 {
        self.advance(cycle, edges, inputs);
        let free = self.stages.output_zero_v + self.stages.output_gain * self.state[OUTPUT];
        self.watch
            .see(Stage::Output, cycle, !(0.0..=REFERENCE_V).contains(&free));
        free.clamp(0.0, REFERENCE_V)
    }

    /// Goes on to `cycle`, period by period.
    pub(crate) fn advance<S: Stimulus>(
        &mut self,
        cycle: u64,
        edges: &EdgeQueue,
        inputs: &mut Inputs<S>,
    ) {
        while self.switching.now() < cycle {
            let period = self.switching.now() / PERIOD_CYCLES;
            let end = (period + 1) * PERIOD_CYCLES;
            self.segments.clear();
            self.switching
                .collect(end.min(cycle), edges, &mut self.segments);
            self.step(inputs.during(period));
            if end <= cycle && (period + 1).is_multiple_of(FLICKER_PERIODS) {
                self.flicker.iter_mut().for_each(Flicker::step);
            }
        }
    }

    fn step(&mut self, experience: &Experience) {
        let slow_noise = self.flicker.as_ref().map_or(0.0, Flicker::value);
        let input = self.unit.input(experience) + slow_noise;
        let composed = self.patterns.get(&self.segments);
        self.state = composed.step.mean(&self.state, &[input, 1.0]);
        for column in &composed.noise {
            matrix::add_scaled(&mut self.state, column, self.random.normal());
        }
        self.watch_filters();
    }

    /// Looks for amplitudes beyond the stages' swing at the end of a step. The envelope of a
    /// resonant pair of states is its length, so a peak between two looks is not missed.
    fn watch_filters(&mut self) {
        let x = &self.state;
        let square = |i: usize| x[i] * x[i] + x[i + 1] * x[i + 1];
        let sensor = match self.unit {
            Unit::Tilt(_) => x[1] * x[1],
            Unit::Field(_) => square(0),
        };
        let over = |value: f64, limit: f64| value > limit * limit;
        let cycle = self.switching.now();
        self.watch
            .see(Stage::Lna, cycle, over(sensor, self.stages.lna_limit_v));
        let band_pass = square(BAND_PASS);
        self.watch.see(
            Stage::BandPass,
            cycle,
            over(band_pass, self.stages.band_pass_limit_v),
        );
    }
}
