//! The two tilt channels behind their multiplexer in its periodic steady state.
//!
//! A period is a turn of either channel. Over a turn each channel's step is known, with the band-pass
//! (its strobes included) and without; between turns the band-pass's two states go to the other
//! channel. That makes a linear map of both states, 16 numbers, over the period. One channel is driven,
//! the other is at zero: what reaches its output is the residue. Both are looked at when the converter
//! holds, and averaged over a period: the ripple of holding a signal for 2 ms, some microseconds of
//! delay at a single instant, is gone from it.

use cardan_spec::timing::{ADC_HOLD_CYCLES, CONVERSION_CYCLES, STROBE_COUNT, TURN_CYCLES};

use crate::chain::{BAND_PASS, OUTPUT, STATES};
use crate::design::{Response, nominal_edges};
use crate::matrix::{self, Vector};
use crate::pattern::Patterns;
use crate::propagate::Step;
use crate::switching::{EdgeQueue, Switching, Wiring};

/// States of both channels.
pub(crate) const BOTH: usize = 2 * STATES;

/// The first conversion's hold instant after the timers' start.
const FIRST_HOLD: u64 = STROBE_COUNT as u64 + 1 + ADC_HOLD_CYCLES;

/// States of the driven channel, which has the first turn, and of the other.
type Pair = [Vector<STATES>; 2];

/// A channel's steps through a turn, each to the next hold instant and the last to the turn's end.
pub(crate) struct Turns {
    with_band_pass: Vec<Step<STATES>>,
    without: Vec<Step<STATES>>,
}

/// The response of a tilt channel to an input of one; none without a steady state.
pub(crate) fn response(
    patterns: &mut Patterns,
    wiring: Wiring,
    aperture_cycles: u64,
) -> Option<Response> {
    let turns = Turns::new(patterns, wiring, aperture_cycles);
    let gap = turns.gap();
    let zero = [[0.0; STATES]; 2];
    let steady = matrix::solve(&gap, &joined(&turns.end(zero, 1.0, 0.0)))?;
    let looks = turns.period(parted(&steady), 1.0, 0.0);
    let output = mean(&looks, 0);
    // A ramp through zero at the period's start: the state there is behind by what it lags.
    let mut behind = joined(&turns.end(zero, 0.0, 1.0)).map(|x| -x);
    matrix::add_scaled(&mut behind, &steady, turns.period_s());
    let behind = matrix::solve(&gap, &behind)?.map(|x| -x);
    let ramp = turns.period(parted(&behind), 0.0, 1.0);
    let held = ramp.iter().filter(|look| look.is_hold);
    let instant = held.clone().map(|look| look.t_s).sum::<f64>() / held.count() as f64;
    let [v, z] = looks[turns.with_band_pass.len() - 1].band_pass;
    Some(Response {
        output,
        amplitude: (v * v + z * z).sqrt(),
        group_delay_s: instant - mean(&ramp, 0) / output,
        neighbour: mean(&looks, 1),
    })
}

/// Both channels at the end of a step.
struct Look {
    t_s: f64,
    /// The converter holds, else a turn ends.
    is_hold: bool,
    outputs: [f64; 2],
    /// The driven channel's.
    band_pass: [f64; 2],
}

/// Mean output of a channel over the hold instants.
fn mean(looks: &[Look], channel: usize) -> f64 {
    let held = looks.iter().filter(|look| look.is_hold);
    held.clone().map(|look| look.outputs[channel]).sum::<f64>() / held.count() as f64
}

impl Turns {
    pub(crate) fn new(patterns: &mut Patterns, wiring: Wiring, aperture_cycles: u64) -> Self {
        let mut edges = EdgeQueue::default();
        nominal_edges()
            .take_while(|edge| edge.cycle <= 2 * TURN_CYCLES)
            .for_each(|edge| edges.push(edge));
        let mut switching = Switching::new(wiring, aperture_cycles);
        let mut segments = Vec::new();
        let mut turn = |end: u64| {
            let holds = (FIRST_HOLD..2 * TURN_CYCLES).step_by(CONVERSION_CYCLES as usize);
            let within = holds.filter(|&hold| end - TURN_CYCLES < hold && hold < end);
            let step = |until: u64| {
                segments.clear();
                switching.collect(until, &edges, &mut segments);
                patterns.step(&segments)
            };
            within.chain([end]).map(step).collect()
        };
        Self {
            with_band_pass: turn(TURN_CYCLES),
            without: turn(2 * TURN_CYCLES),
        }
    }

    fn period_s(&self) -> f64 {
        let steps = self.with_band_pass.iter().chain(&self.without);
        steps.map(|step| step.span_s).sum()
    }

    /// One period of both from `states` on, the driven channel's input starting at `from`.
    fn period(&self, states: Pair, from: f64, per_second: f64) -> Vec<Look> {
        self.pass(states, from, per_second).0
    }

    /// The states after it.
    fn end(&self, states: Pair, from: f64, per_second: f64) -> Pair {
        self.pass(states, from, per_second).1
    }

    fn pass(&self, mut states: Pair, from: f64, per_second: f64) -> (Vec<Look>, Pair) {
        let (mut looks, mut t_s) = (Vec::new(), 0.0);
        let turns = [
            [&self.with_band_pass, &self.without],
            [&self.without, &self.with_band_pass],
        ];
        for (has_it, [driven, other]) in turns.into_iter().enumerate() {
            for (number, (mine, others)) in driven.iter().zip(other).enumerate() {
                let line = [from + per_second * t_s, 0.0, per_second];
                states[0] = mine.mean(&states[0], &line);
                states[1] = others.mean(&states[1], &[0.0; 3]);
                t_s += mine.span_s;
                looks.push(Look {
                    t_s,
                    is_hold: number + 1 < driven.len(),
                    outputs: states.map(|state| state[OUTPUT]),
                    band_pass: [states[0][BAND_PASS], states[0][BAND_PASS + 1]],
                });
            }
            let band_pass = [states[has_it][BAND_PASS], states[has_it][BAND_PASS + 1]];
            states[1 - has_it][BAND_PASS..BAND_PASS + 2].copy_from_slice(&band_pass);
        }
        (looks, states)
    }

    /// A period's steps of both channels, and whether the converter holds at the end of each.
    pub(crate) fn motions(&self) -> Vec<(Motion, bool)> {
        let turns = [
            (&self.with_band_pass, &self.without),
            (&self.without, &self.with_band_pass),
        ];
        let mut motions = Vec::new();
        for (has_it, (first, second)) in turns.into_iter().enumerate() {
            for (number, (a, b)) in first.iter().zip(second).enumerate() {
                let is_hold = number + 1 < first.len();
                let step = Motion::of([a, b]);
                let motion = if is_hold {
                    step
                } else {
                    step.handing_over(has_it)
                };
                motions.push((motion, is_hold));
            }
        }
        motions
    }

    /// Identity less the period's map.
    fn gap(&self) -> matrix::Matrix<BOTH> {
        let identity = matrix::identity::<BOTH>();
        let map = identity.map(|unit| joined(&self.end(parted(&unit), 0.0, 0.0)));
        matrix::sum_scaled(&identity, &map, -1.0)
    }
}

fn joined(pair: &Pair) -> Vector<BOTH> {
    std::array::from_fn(|at| pair[at / STATES][at % STATES])
}

fn parted(both: &Vector<BOTH>) -> Pair {
    std::array::from_fn(|channel| std::array::from_fn(|at| both[channel * STATES + at]))
}

/// A linear map of both channels' states, and the covariance of what noise adds meanwhile.
#[derive(Clone)]
pub(crate) struct Motion {
    pub(crate) map: matrix::Matrix<BOTH>,
    pub(crate) added: matrix::Matrix<BOTH>,
}

impl Motion {
    fn of(steps: [&Step<STATES>; 2]) -> Self {
        let blocks = |part: fn(&Step<STATES>) -> &matrix::Matrix<STATES>| {
            std::array::from_fn(|column| {
                let mut both = [0.0; BOTH];
                let (channel, at) = (column / STATES, column % STATES);
                let block = &part(steps[channel])[at];
                both[channel * STATES..][..STATES].copy_from_slice(block);
                both
            })
        };
        Self {
            map: blocks(|step| &step.phi),
            added: blocks(|step| &step.q),
        }
    }

    /// The same, then channel `from` hands the band-pass's states to the other.
    fn handing_over(&self, from: usize) -> Self {
        let mut rows = matrix::identity::<BOTH>();
        for state in BAND_PASS..BAND_PASS + 2 {
            rows[(1 - from) * STATES + state] = rows[from * STATES + state];
        }
        let map = matrix::transposed(&rows);
        self.then(&Self {
            map,
            added: [[0.0; BOTH]; BOTH],
        })
    }

    /// This, then `next`.
    pub(crate) fn then(&self, next: &Self) -> Self {
        Self {
            map: matrix::product(&next.map, &self.map),
            added: next.covariance_after(&self.added),
        }
    }

    /// The covariance after it of a state that has `before`.
    pub(crate) fn covariance_after(&self, before: &matrix::Matrix<BOTH>) -> matrix::Matrix<BOTH> {
        matrix::sum_scaled(&matrix::carried(&self.map, before), &self.added, 1.0)
    }
}
