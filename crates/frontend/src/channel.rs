//! One channel: its state, advanced from event to event only when somebody asks for its voltage.

use cardan_scenario::experience::{Experience, Stimulus};
use cardan_scenario::hardware::Frontend as Parameters;
use cardan_scenario::random::{Random, Source};
use cardan_sensors::{Accelerometer, Flicker, LinearSensor, Magnetometer};
use cardan_spec::REFERENCE_V;
use cardan_spec::timing::CPU_HZ;

use crate::chain::{BAND_PASS, Chain, HOLD, OUTPUT, STATES};
use crate::design::{ChainDesign, PERIOD_CYCLES};
use crate::matrix::{self, Vector};
use crate::pattern::{Line, Patterns, Segment};
use crate::saturation::{Stage, Watch};
use crate::switching::{EdgeQueue, Switching, Wiring};

/// Spans for which a value of 1/f noise is held: 1 ms, short against the sensors' lags.
pub(crate) const FLICKER_SPANS: u64 = 8;

/// Change of temperature after which a resonator's matrices are made anew: at the default drift 3 ppm
/// of its resonance, a thousandth of its half-width.
const TEMPERATURE_STEP_K: f64 = 0.1;

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

    fn linear(&self, temperature_k: f64) -> LinearSensor {
        match self {
            Unit::Tilt(unit) => unit.linear(),
            Unit::Field(unit) => unit.linear(temperature_k),
        }
    }
}

/// Cycles over which inputs run straight from one value to the next: two carrier periods.
pub(crate) const SPAN_CYCLES: u64 = 2 * PERIOD_CYCLES;

/// Experiences at the ends of spans, so that four channels ask the stimulus once.
#[derive(Clone, Debug)]
pub(crate) struct Inputs<S> {
    stimulus: S,
    recent: Vec<(u64, Experience)>,
}

/// Spans remembered; more than channels are usually apart.
const REMEMBERED: usize = 64;

impl<S: Stimulus> Inputs<S> {
    pub(crate) fn new(stimulus: S) -> Self {
        Self {
            stimulus,
            recent: vec![(u64::MAX, Experience::default()); REMEMBERED],
        }
    }

    /// The experience at the start of span `span`.
    pub(crate) fn at(&mut self, span: u64) -> &Experience {
        let slot = &mut self.recent[span as usize % REMEMBERED];
        if slot.0 != span {
            *slot = (
                span,
                self.stimulus
                    .at((span * SPAN_CYCLES) as f64 / CPU_HZ as f64),
            );
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

/// What a channel is built from.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// Sensor.
    pub(crate) unit: Unit,
    /// Common parameters.
    pub(crate) parameters: Parameters,
    /// Gain and corner.
    pub(crate) design: ChainDesign,
    /// How its switches are driven.
    pub(crate) wiring: Wiring,
    /// Noise on or off.
    pub(crate) noisy: bool,
    /// True frequency of the controller's clock.
    pub(crate) clock_hz: f64,
}

impl Plan {
    fn patterns(&self, temperature_k: f64) -> Patterns {
        let chain = Chain {
            sensor: self.unit.linear(temperature_k),
            parameters: &self.parameters,
            band_pass_gain: self.design.band_pass_gain,
            low_pass_hz: self.design.low_pass_hz,
            noisy: self.noisy,
        };
        Patterns::new(&chain, self.clock_hz)
    }

    fn flicker(&self, seed: u64, index: u8) -> Option<Flicker> {
        let Unit::Tilt(unit) = &self.unit else {
            return None;
        };
        let (density, corner_hz) = unit.flicker();
        let interval_s = (FLICKER_SPANS * SPAN_CYCLES) as f64 / CPU_HZ as f64;
        (self.noisy && corner_hz > 0.0)
            .then(|| Flicker::new(density, corner_hz, interval_s, seed, index))
    }
}

/// Voltages inside a channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Inner {
    /// Output of the band-pass; none while the other tilt channel has it.
    pub band_pass_v: Option<f64>,
    /// Hold capacitors H+ and H-.
    pub hold_v: [f64; 2],
    /// Output of the low-pass, before the last amplifier.
    pub low_pass_v: f64,
}

/// One channel.
#[derive(Clone, Debug)]
pub(crate) struct Channel {
    plan: Plan,
    stages: Stages,
    /// Temperature for which the patterns are made.
    temperature_k: f64,
    patterns: Patterns,
    switching: Switching,
    state: Vector<STATES>,
    random: Random,
    flicker: Option<Flicker>,
    /// A span and the sensor's input at its start and end.
    line: (u64, f64, f64),
    watch: Watch,
    segments: Vec<Segment>,
}

impl Channel {
    /// Channel number `index` under `seed`, settled in what it experiences first.
    pub(crate) fn new(plan: Plan, seed: u64, index: u8, first: &Experience) -> Self {
        let temperature_k = first.temperature_k;
        let patterns = plan.patterns(temperature_k);
        let switching = Switching::new(plan.wiring, plan.parameters.aperture_cycles as u64);
        // Settled under the low carrier: 0 = A x + B u.
        let system = patterns.system(switching.switches());
        let mut drive = [0.0; STATES];
        matrix::add_scaled(&mut drive, &system.b[0], -plan.unit.input(first));
        matrix::add_scaled(&mut drive, &system.b[1], -1.0);
        Self {
            stages: Stages::new(&plan.parameters, plan.design.band_pass_gain),
            temperature_k,
            state: matrix::solve(&system.a, &drive).unwrap_or([0.0; STATES]),
            patterns,
            switching,
            random: Random::new(seed, Source::Channel(index)),
            flicker: plan.flicker(seed, index),
            line: (u64::MAX, 0.0, 0.0),
            watch: Watch::default(),
            segments: Vec::new(),
            plan,
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

    /// Voltages inside, in the instant up to which the state is known.
    pub(crate) fn inner(&self) -> Inner {
        Inner {
            band_pass_v: self
                .switching
                .has_band_pass()
                .then_some(self.state[BAND_PASS]),
            hold_v: [self.state[HOLD], self.state[HOLD + 1]],
            low_pass_v: self.state[OUTPUT],
        }
    }

    /// States of the band-pass in that instant. While another channel has it they stand for nothing.
    pub(crate) fn band_pass(&self) -> [f64; 2] {
        [self.state[BAND_PASS], self.state[BAND_PASS + 1]]
    }

    /// Takes over the shared band-pass as the other channel leaves it. Both put the same gain before
    /// it, so its voltages have one scale; the noise of a turn is that of the selected channel's first
    /// amplifier, and each channel draws its own.
    pub(crate) fn take_band_pass(&mut self, states: [f64; 2]) {
        self.state[BAND_PASS..BAND_PASS + 2].copy_from_slice(&states);
    }

    /// Goes on to `cycle`, span by span.
    pub(crate) fn advance<S: Stimulus>(
        &mut self,
        cycle: u64,
        edges: &EdgeQueue,
        inputs: &mut Inputs<S>,
    ) {
        while self.switching.now() < cycle {
            let start = self.switching.now();
            let span = start / SPAN_CYCLES;
            let end = (span + 1) * SPAN_CYCLES;
            self.segments.clear();
            self.switching
                .collect(end.min(cycle), edges, &mut self.segments);
            if self.line.0 != span {
                let from = inputs.at(span);
                self.line = (span, self.plan.unit.input(from), 0.0);
                self.follow_temperature(from.temperature_k);
                self.line.2 = self.plan.unit.input(inputs.at(span + 1));
            }
            self.step((start - span * SPAN_CYCLES) as f64);
            if end <= cycle && (span + 1).is_multiple_of(FLICKER_SPANS) {
                self.flicker.iter_mut().for_each(Flicker::step);
            }
        }
    }

    /// One pattern, which starts `offset` cycles into its span.
    fn step(&mut self, offset: f64) {
        let (_, from, to) = self.line;
        let per_cycle = (to - from) / SPAN_CYCLES as f64;
        let slow_noise = self.flicker.as_ref().map_or(0.0, Flicker::value);
        let signal = from + per_cycle * offset + slow_noise;
        let line = Line {
            start: signal,
            per_second: per_cycle * self.plan.clock_hz,
        };
        self.state = self
            .patterns
            .advance(&self.segments, &self.state, line, &mut self.random);
        self.watch_filters();
    }

    /// New matrices when the temperature has moved the resonance by a step.
    fn follow_temperature(&mut self, temperature_k: f64) {
        let moved = (temperature_k - self.temperature_k).abs() >= TEMPERATURE_STEP_K;
        if moved && matches!(self.plan.unit, Unit::Field(_)) {
            self.temperature_k = temperature_k;
            self.patterns = self.plan.patterns(temperature_k);
        }
    }

    /// Looks for amplitudes beyond the stages' swing at the end of a step. The envelope of a
    /// resonant pair of states is its length, so a peak between two looks is not missed. A shared
    /// band-pass is watched by the channel that has it.
    fn watch_filters(&mut self) {
        let x = &self.state;
        let square = |i: usize| x[i] * x[i] + x[i + 1] * x[i + 1];
        let sensor = match self.plan.unit {
            Unit::Tilt(_) => x[1] * x[1],
            Unit::Field(_) => square(0),
        };
        let over = |value: f64, limit: f64| value > limit * limit;
        let cycle = self.switching.now();
        self.watch
            .see(Stage::Lna, cycle, over(sensor, self.stages.lna_limit_v));
        let band_pass = square(BAND_PASS);
        let saturated =
            self.switching.has_band_pass() && over(band_pass, self.stages.band_pass_limit_v);
        self.watch.see(Stage::BandPass, cycle, saturated);
    }
}
