//! Checks of the stages before the firmware, each by what that stage alone must do.
//!
//! The error budget cannot do this: its parts are differences of neighbouring stages and add up by
//! construction. Here the converter's codes are held against the voltages it held, the voltages
//! against ideal sensors at the same instants, the output instants against the hold instants, and the
//! controller's load against what the design needs.

use std::collections::VecDeque;

use cardan_frontend::Design;
use cardan_outputs::Check;
use cardan_scenario::Scenario;
use cardan_spec::timing::{
    Averaging, BYTE_CYCLES, CONVERSION_CYCLES, CPU_HZ, MOST_INTERRUPT_LATENCY_CYCLES,
    MOST_SEND_LAG_CYCLES,
};
use cardan_spec::{MOST_CHANNELS, REFERENCE_V};
use cardan_units::{AdcCode, Volts, ideal_bipolar_code};

use crate::app::{Checker, Configuration};
use crate::engine::{Conversion, Summary};

/// Names of the channels in conversion order.
const NAMES: [&str; MOST_CHANNELS] = ["tilt_x", "tilt_y", "field_x", "field_y", "tilt_z"];

/// Largest share of the time that the core may be awake. The tapped image takes 20 %, the same in C 32 %;
/// half of the time stays in reserve.
const MOST_LOAD: f64 = 0.50;
/// Less than this is nothing.
const LEAST: f64 = 1e-3;
/// Most bytes of stack: twice what the tapped image takes.
const MOST_STACK_BYTES: f64 = 900.0;

/// Code at either end of the bipolar scale.
const FULL_SCALE: f64 = 511.5;
/// Deviations of the converter's noise that a code may be off its voltage before it says anything of the mean.
const NOISE_REACH: f64 = 5.0;

/// The largest of `count` normal values, in deviations, as good as never exceeded.
fn most_deviations(count: u64) -> f64 {
    1.0 + (2.0 * libm::log(count.max(1) as f64)).sqrt()
}

/// Mean and root mean square.
#[derive(Clone, Copy, Debug, Default)]
struct Spread {
    sum: f64,
    square: f64,
    largest: f64,
    count: u64,
}

impl Spread {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.square += value * value;
        // What is not a number stays: `max` alone would pass over it.
        self.largest = if self.largest.is_nan() || value.is_nan() {
            f64::NAN
        } else {
            self.largest.max(value.abs())
        };
        self.count += 1;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count as f64
    }

    fn rms(&self) -> f64 {
        (self.square / self.count as f64).sqrt()
    }

    /// Standard deviation.
    fn deviation(&self) -> f64 {
        (self.rms().powi(2) - self.mean().powi(2)).max(0.0).sqrt()
    }
}

/// Noise of a conversion, in LSB, that spreads the codes of a voltage at rest over the steps.
const LEAST_DITHER_LSB: f64 = 0.3;
/// Standard deviation of a signal, in LSB, from which on its gain is looked at.
const LEAST_MOTION_LSB: f64 = 5.0;
/// Deviations of noise that a gain or a delay may be off by it.
const OPEN: f64 = 6.0;
/// Delays that noise leaves open by more, in milliseconds, say nothing.
const MOST_OPEN_MS: f64 = 10.0;
/// Solutions from which on gain, delay and single means are looked at.
const LEAST_MEANS: u64 = 50;
/// Noise of the solutions' means, in LSB, from which on the largest of them is looked at.
const LEAST_NOISE_LSB: f64 = 0.3;

/// How the held voltages of a channel follow those of ideal sensors, in codes.
#[derive(Clone, Copy, Debug, Default)]
struct Follows {
    count: f64,
    sum: f64,
    error_sum: f64,
    square: f64,
    product: f64,
    /// The last value, and sums of the error's products with its changes and of their squares.
    last: Option<f64>,
    change_product: f64,
    change_square: f64,
    /// The error's mean over the conversions of the current solution, and of all such means.
    mean: (f64, f64),
    means: Spread,
}

impl Follows {
    fn add(&mut self, expected: f64, error: f64) {
        self.count += 1.0;
        self.sum += expected;
        self.error_sum += error;
        self.square += expected * expected;
        self.product += expected * error;
        if let Some(last) = self.last.replace(expected) {
            self.change_product += (expected - last) * error;
            self.change_square += (expected - last) * (expected - last);
        }
        self.mean.0 += error;
        self.mean.1 += 1.0;
    }

    fn solution(&mut self) {
        let (sum, count) = std::mem::take(&mut self.mean);
        if count > 0.0 {
            self.means.add(sum / count);
        }
    }

    /// Variance of the expected value.
    fn variance(&self) -> f64 {
        self.square / self.count - (self.sum / self.count).powi(2)
    }

    /// By which part of the expected value the held one is too large.
    fn gain(&self) -> f64 {
        let covariance = self.product / self.count - self.sum * self.error_sum / self.count.powi(2);
        covariance / self.variance()
    }

    /// By how many steps between conversions the held value is late.
    fn delay(&self) -> f64 {
        -self.change_product / self.change_square
    }
}

/// What is kept of a run.
pub(super) struct Checks {
    scenario: Scenario,
    averaging: Averaging,
    solutions: u64,
    group_delay_s: f64,
    conversions: usize,
    /// By channel: the held voltage less that of ideal sensors, in codes.
    held: [Spread; MOST_CHANNELS],
    follows: [Follows; MOST_CHANNELS],
    /// By channel: the code less the held voltage, in codes, where noise cannot reach the ends of the scale.
    converted: [Spread; MOST_CHANNELS],
    /// By channel: the code less the held voltage limited to the scale, in codes.
    limited: [Spread; MOST_CHANNELS],
    /// Instants at which the inputs of the solutions were complete whose messages are not there.
    complete: VecDeque<u64>,
    /// From there to the end of the message less its own bytes, in cycles.
    latency: Spread,
    /// Conversions that came late, or never.
    late: u64,
    lost: u64,
    /// Sum of the hold instants that the current solution averages, in cycles, and their number.
    holds: (f64, f64),
    /// Output instants that are due, and those that were told, as long as the others are not there.
    due: VecDeque<f64>,
    told: VecDeque<f64>,
    instants: Spread,
}

impl Checks {
    pub(super) fn new(scenario: &Scenario, configuration: &Configuration) -> Result<Self, String> {
        let design = Design::new(scenario)
            .map_err(|error| format!("scenario {}: {error}", scenario.name))?;
        Ok(Self {
            scenario: scenario.clone(),
            averaging: configuration.averaging(),
            group_delay_s: design.group_delay_s(),
            conversions: 0,
            held: Default::default(),
            converted: Default::default(),
            follows: Default::default(),
            limited: Default::default(),
            complete: VecDeque::new(),
            latency: Spread::default(),
            late: 0,
            lost: 0,
            solutions: configuration.solutions,
            holds: (0.0, 0.0),
            due: VecDeque::new(),
            told: VecDeque::new(),
            instants: Spread::default(),
        })
    }

    /// Compares the output instants of which both are known.
    fn compare_instants(&mut self) {
        while let (Some(&due), Some(&told)) = (self.due.front(), self.told.front()) {
            self.instants.add(told - due);
            self.due.pop_front();
            self.told.pop_front();
        }
    }

    /// A conversion's part in the output instant: the centre of the hold instants less the group delay.
    fn hold(&mut self, index: usize, cycle: u64) {
        if self.averaging.counts(index) {
            self.holds.0 += cycle as f64;
            self.holds.1 += 1.0;
        }
        if index + 1 == self.averaging.conversions() {
            let (sum, count) = std::mem::take(&mut self.holds);
            self.due
                .push_back(sum / count / CPU_HZ as f64 - self.group_delay_s);
            self.compare_instants();
        }
    }

    /// A channel's held voltages against those that ideal sensors would have given.
    fn front_end(&self) -> Vec<Check> {
        let channels = 0..self.averaging.channels();
        channels
            .flat_map(|channel| self.of_channel(channel))
            .collect()
    }

    fn of_channel(&self, channel: usize) -> Vec<Check> {
        let tolerance = &self.scenario.tolerance.channels;
        let (follows, name) = (&self.follows[channel], NAMES[channel]);
        let mut checks = Vec::new();
        let mut add = |what: &str, value: f64, limit: Option<f64>, unit: &str| {
            let Some(most) = limit else { return };
            checks.push(Check {
                party: "sensors and front end".to_owned(),
                what: format!("{what} of the held voltage of {name} less that of ideal sensors"),
                value,
                least: -most,
                most,
                unit: unit.to_owned(),
                reason: tolerance.reason.clone(),
            });
        };
        add("mean", self.held[channel].mean(), tolerance.bias_lsb, "LSB");
        if follows.means.count < LEAST_MEANS {
            return checks;
        }
        // What the noise of the solutions' means leaves open; it is nearly white from solution to solution.
        let noise = follows.means.deviation();
        if follows.variance() > LEAST_MOTION_LSB.powi(2) {
            let open = OPEN * noise / (follows.means.count as f64 * follows.variance()).sqrt();
            let limit = tolerance.gain.map(|limit| limit + open);
            add("gain", follows.gain(), limit, "of the signal");
        }
        // The noise of single conversions is as correlated as the low-pass makes it.
        let per_solution = follows.count / (follows.means.count as f64).max(1.0);
        let step_ms =
            1e3 * (self.averaging.channels() as u64 * CONVERSION_CYCLES) as f64 / CPU_HZ as f64;
        let open_ms = step_ms * OPEN * noise * per_solution.sqrt() / follows.change_square.sqrt();
        if open_ms < MOST_OPEN_MS {
            let limit = tolerance.delay_ms.map(|limit| limit + open_ms);
            add("delay", step_ms * follows.delay(), limit, "ms");
        }
        // Without noise there is nothing to measure a single mean by.
        if noise > LEAST_NOISE_LSB {
            let peak = follows.means.largest / noise;
            add(
                "largest mean over a solution",
                peak,
                tolerance.peak,
                "root mean squares",
            );
        }
        checks
    }

    /// Noise of a conversion, in LSB.
    fn noise_lsb(&self) -> f64 {
        if self.scenario.noise.enabled {
            self.scenario.adc.noise_lsb
        } else {
            0.0
        }
    }

    /// Codes against the voltages that the converter held.
    fn converter(&self) -> Vec<Check> {
        let (adc, noise) = (&self.scenario.adc, self.noise_lsb());
        // Offset, gain, bow and misplaced steps as the scenario states them, at their largest.
        let fixed =
            adc.offset_lsb.abs() + adc.gain_lsb.abs() + adc.inl_lsb.abs() + 0.5 * adc.dnl_lsb;
        let quantisation = 1.0 / 12_f64.sqrt();
        let expected = noise.hypot(quantisation);
        let mut checks = Vec::new();
        let channels = self.averaging.channels();
        for (channel, name) in NAMES.iter().enumerate().take(channels) {
            let mut add = |what: &str, value: f64, most: f64, reason: &str| {
                checks.push(Check {
                    party: "converter".to_owned(),
                    what: format!("{what} of the codes of {name} less the voltages held"),
                    value,
                    least: -most,
                    most,
                    unit: "LSB".to_owned(),
                    reason: reason.to_owned(),
                });
            };
            let limited = &self.limited[channel];
            if limited.count > 0 {
                add(
                    "largest",
                    limited.largest,
                    fixed + 0.5 + 1e-6 + noise * most_deviations(limited.count),
                    "half a step, the scenario's offset, gain and nonlinearity, and the largest of so many \
                     values of its noise; codes at the ends of the scale only where the voltage is",
                );
            }
            let spread = &self.converted[channel];
            if spread.count == 0 {
                continue;
            }
            let least_known = 4.0 * expected / (spread.count as f64).sqrt();
            // A signal at rest may stand anywhere within its step.
            let at_rest = if noise > LEAST_DITHER_LSB { 0.1 } else { 0.5 };
            add(
                "mean",
                spread.mean(),
                fixed + at_rest + least_known,
                "the scenario's offset, gain and nonlinearity, and what is left of a step",
            );
            add(
                "root mean square",
                spread.rms(),
                (1.25 * (expected + fixed)).max(fixed + at_rest) + least_known,
                "a step's own 0.29 LSB and the scenario's noise, with a quarter more",
            );
        }
        checks
    }

    /// From complete inputs to the end of the message, without the message's own bytes.
    fn output_latency(&self) -> Check {
        Check {
            party: "device".to_owned(),
            what: "longest time from complete inputs to the first byte of their message".to_owned(),
            value: self.latency.largest,
            least: 1.0,
            // Solved before the next block's conversions are complete, then sent.
            most: (self.averaging.block_cycles() + MOST_SEND_LAG_CYCLES) as f64,
            unit: "cycles".to_owned(),
            reason: "the design solves before the next block is complete, and sends at once"
                .to_owned(),
        }
    }

    /// The run's length, and what the chip counted against what was published.
    fn counts(&self, summary: &Summary) -> Vec<Check> {
        let shortest = self.averaging.warm_up_cycles() + self.solutions * self.averaging.cycles();
        let check =
            |party: &str, what: &str, value: u64, least: u64, most: u64, unit: &str| Check {
                party: party.to_owned(),
                what: what.to_owned(),
                value: value as f64,
                least: least as f64,
                most: most as f64,
                unit: unit.to_owned(),
                reason: "counted twice".to_owned(),
            };
        let longest = shortest + 2 * self.averaging.block_cycles();
        vec![
            check(
                "device",
                "length of the run",
                summary.cycles,
                shortest,
                longest,
                "cycles",
            ),
            check(
                Check::CONTROLLER,
                "late conversions that were published",
                self.late,
                0,
                summary.late_conversions,
                "",
            ),
            check(
                Check::CONTROLLER,
                "lost conversions that were published",
                self.lost,
                0,
                summary.lost_conversions,
                "",
            ),
        ]
    }

    fn output_instants(&self) -> Check {
        Check {
            party: "truth".to_owned(),
            what: "largest difference of the output instants from the centres of the hold instants"
                .to_owned(),
            value: self.instants.largest,
            least: 0.0,
            most: 1e-9,
            unit: "s".to_owned(),
            reason: "the design's definition, computed twice".to_owned(),
        }
    }
}

impl Checker for Checks {
    fn conversion(&mut self, conversion: &Conversion) {
        let settled = self
            .conversions
            .checked_sub(self.averaging.warm_up_conversions());
        self.conversions += 1;
        self.late += u64::from(conversion.late);
        self.lost += u64::from(conversion.lost);
        let Some(settled) = settled else { return };
        let reach = NOISE_REACH * self.noise_lsb();
        self.hold(settled % self.averaging.conversions(), conversion.cycle);
        let channel = usize::from(conversion.channel);
        let (Some(held_spread), Some(converted)) =
            (self.held.get_mut(channel), self.converted.get_mut(channel))
        else {
            return;
        };
        let held = ideal_bipolar_code(Volts(conversion.ideal_volts), Volts(REFERENCE_V));
        held_spread.add(held - conversion.experienced_code);
        let expected = conversion.experienced_code;
        self.follows[channel].add(expected, held - expected);
        if settled % self.averaging.conversions() == self.averaging.conversions() - 1 {
            self.follows.iter_mut().for_each(Follows::solution);
        }
        let code = f64::from(AdcCode(conversion.code).bipolar());
        // At the ends of the scale codes are limited, and noise pulls them inwards.
        if held.abs() < FULL_SCALE - 1.0 - reach {
            converted.add(code - held);
        }
        // What is not a number stays.
        let limited = held.clamp(-FULL_SCALE, FULL_SCALE);
        self.limited[channel].add(code - limited);
    }

    fn instant(&mut self, time_s: f64, complete: u64) {
        self.told.push_back(time_s);
        self.complete.push_back(complete);
        self.compare_instants();
    }

    fn message(&mut self, bytes: &[u8], cycle: u64) {
        let sent = bytes.len() as u64 * BYTE_CYCLES;
        if let Some(complete) = self.complete.pop_front() {
            self.latency
                .add(cycle as f64 - sent as f64 - complete as f64);
        }
    }

    fn finish(&self, summary: &Summary) -> Vec<Check> {
        let mut checks = self.front_end();
        checks.extend(self.converter());
        checks.push(self.output_instants());
        checks.push(self.output_latency());
        checks.extend(controller(summary));
        checks.extend(self.counts(summary));
        checks
    }
}

fn controller(summary: &Summary) -> Vec<Check> {
    let check = |what: &str, value: f64, most: f64, unit: &str, reason: &str| Check {
        party: Check::CONTROLLER.to_owned(),
        what: what.to_owned(),
        value,
        // Whatever runs is awake at times, stacks, and lets interrupts wait.
        least: if most > 0.0 { LEAST } else { 0.0 },
        most,
        unit: unit.to_owned(),
        reason: reason.to_owned(),
    };
    let awake = summary.cycles as f64 - summary.sleeping_cycles as f64;
    let damage = summary.first_damage.as_deref();
    let mut checks = vec![check(
        "interrupts that return with other registers than they found",
        summary.damaged_returns as f64,
        0.0,
        "returns",
        damage.unwrap_or("every handler restores what it uses"),
    )];
    // A run in which no return was looked at has checked nothing.
    checks.push(Check {
        least: 1.0,
        ..check(
            "interrupts whose registers were compared at their return",
            summary.checked_returns as f64,
            u64::MAX as f64,
            "returns",
            "at least one: otherwise nothing was checked",
        )
    });
    checks.extend([
        check(
            "share of the time awake",
            awake / summary.cycles as f64,
            MOST_LOAD,
            "",
            "half of the time stays in reserve; the tapped image takes 0.2, without sleep it is 1",
        ),
        check(
            "longest interrupt latency",
            summary.isr_latency_max_cycles as f64,
            MOST_INTERRUPT_LATENCY_CYCLES as f64,
            "cycles",
            "what the sample interrupt may wait before its trigger's next match",
        ),
        check(
            "stack",
            summary.stack_peak as f64,
            MOST_STACK_BYTES,
            "bytes",
            "what is left beside the static data",
        ),
    ]);
    checks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_a_number_is_not_passed_over_by_what_comes_later() {
        let mut spread = Spread::default();
        for value in [1.0, f64::NAN, 2.0] {
            spread.add(value);
        }
        assert!(spread.largest.is_nan() && spread.mean().is_nan() && spread.rms().is_nan());
    }
}
