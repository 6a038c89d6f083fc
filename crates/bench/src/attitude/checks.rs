//! Checks of the stages before the firmware, each by what that stage alone must do.
//!
//! The error budget cannot do this: its parts are differences of neighbouring stages and add up by
//! construction. Here the converter's codes are held against the voltages it held, the voltages
//! against ideal sensors at the same instants, the output instants against the hold instants, and the
//! controller's load against what the design needs.

use cardan_frontend::Design;
use cardan_frontend::adc::LSB_V;
use cardan_outputs::Check;
use cardan_spec::timing::{Averaging, CPU_HZ, MOST_INTERRUPT_LATENCY_CYCLES};
use cardan_spec::{MOST_CHANNELS, REFERENCE_V};
use cardan_units::{AdcCode, Volts, ideal_bipolar_code};

use crate::app::Evidence;
use crate::engine::{Conversion, Summary};

/// Names of the channels in conversion order.
const NAMES: [&str; MOST_CHANNELS] = ["tilt_x", "tilt_y", "field_x", "field_y", "tilt_z"];

/// Largest share of the time that the core may be awake. The tapped image takes 20 %, the same in C 32 %;
/// half of the time stays in reserve.
const MOST_LOAD: f64 = 0.50;
/// Most bytes of stack: twice what the tapped image takes.
const MOST_STACK_BYTES: f64 = 900.0;

/// All checks of a run.
pub(super) fn all(evidence: &Evidence<'_>) -> Result<Vec<Check>, String> {
    let design = Design::new(evidence.scenario)
        .map_err(|error| format!("scenario {}: {error}", evidence.scenario.name))?;
    let mut checks = Vec::new();
    checks.extend(front_end(evidence));
    checks.extend(converter(evidence));
    checks.push(output_instants(evidence, &design));
    checks.extend(controller(evidence.summary));
    Ok(checks)
}

/// Mean and root mean square.
#[derive(Default)]
struct Spread {
    sum: f64,
    square: f64,
    largest: f64,
    count: usize,
}

impl Spread {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut spread = Self::default();
        for value in values {
            spread.sum += value;
            spread.square += value * value;
            spread.largest = spread.largest.max(value.abs());
            spread.count += 1;
        }
        spread
    }

    fn mean(&self) -> f64 {
        self.sum / self.count as f64
    }

    fn rms(&self) -> f64 {
        (self.square / self.count as f64).sqrt()
    }
}

/// Conversions of a channel after the warm-up.
fn settled<'a>(
    evidence: &Evidence<'a>,
    channel: usize,
) -> impl Iterator<Item = &'a Conversion> + use<'a> {
    let warm_up = evidence.configuration.averaging().warm_up_conversions();
    let settled = evidence.conversions.iter().skip(warm_up);
    settled.filter(move |conversion| usize::from(conversion.channel) == channel)
}

/// The mean of a channel's voltages less what ideal sensors would have given.
fn front_end(evidence: &Evidence<'_>) -> Vec<Check> {
    let tolerance = &evidence.scenario.tolerance.channels;
    let Some(most) = tolerance.bias_lsb else {
        return Vec::new();
    };
    let check = |channel: usize| {
        let difference = |conversion: &Conversion| {
            let held = ideal_bipolar_code(Volts(conversion.ideal_volts), Volts(REFERENCE_V));
            held - conversion.experienced_code
        };
        let spread = Spread::of(settled(evidence, channel).map(difference));
        Check {
            party: "sensors and front end".to_owned(),
            what: format!(
                "mean of the held voltage of {} less that of ideal sensors",
                NAMES[channel]
            ),
            value: spread.mean(),
            least: -most,
            most,
            unit: "LSB".to_owned(),
            reason: tolerance.reason.clone(),
        }
    };
    (0..evidence.configuration.averaging().channels())
        .map(check)
        .collect()
}

/// Codes against the voltages that the converter held.
fn converter(evidence: &Evidence<'_>) -> Vec<Check> {
    let scenario = evidence.scenario;
    let adc = &scenario.adc;
    let noise = if scenario.noise.enabled {
        adc.noise_lsb
    } else {
        0.0
    };
    // Offset, gain, bow and misplaced steps as the scenario states them, at their largest.
    let fixed = adc.offset_lsb.abs() + adc.gain_lsb.abs() + adc.inl_lsb.abs() + 0.5 * adc.dnl_lsb;
    let quantisation = 1.0 / 12_f64.sqrt();
    let expected = noise.hypot(quantisation);
    let mut checks = Vec::new();
    let channels = evidence.configuration.averaging().channels();
    for (channel, name) in NAMES.iter().enumerate().take(channels) {
        // At the ends of the scale codes are limited.
        let inside = settled(evidence, channel)
            .filter(|conversion| !AdcCode(conversion.code).is_clipped())
            .filter(|conversion| (LSB_V..REFERENCE_V - LSB_V).contains(&conversion.ideal_volts));
        let error = |conversion: &Conversion| {
            let held = ideal_bipolar_code(Volts(conversion.ideal_volts), Volts(REFERENCE_V));
            f64::from(AdcCode(conversion.code).bipolar()) - held
        };
        let spread = Spread::of(inside.map(error));
        if spread.count == 0 {
            continue;
        }
        let least_known = 4.0 * expected / (spread.count as f64).sqrt();
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
        // A signal at rest may stand anywhere within its step.
        let at_rest = if noise > 0.0 { 0.1 } else { 0.5 };
        add(
            "mean",
            spread.mean(),
            fixed + at_rest + least_known,
            "the scenario's offset, gain and nonlinearity, and what is left of a step",
        );
        add(
            "root mean square",
            spread.rms(),
            1.25 * (expected + fixed) + least_known,
            "a step's own 0.29 LSB and the scenario's noise, with a quarter more",
        );
    }
    checks
}

/// The output instant of each solution: the centre of its hold instants less the group delay.
fn output_instants(evidence: &Evidence<'_>, design: &Design) -> Check {
    let averaging = evidence.configuration.averaging();
    let solutions = evidence
        .conversions
        .get(averaging.warm_up_conversions()..)
        .unwrap_or_default()
        .chunks_exact(averaging.conversions());
    let instant = |solution: &[Conversion]| centre_s(solution, averaging) - design.group_delay_s();
    let truths = evidence.truth_times_s.iter();
    let errors = solutions
        .zip(truths)
        .map(|(solution, &told)| told - instant(solution));
    Check {
        party: "truth".to_owned(),
        what: "largest difference of the output instants from the centres of the hold instants"
            .to_owned(),
        value: Spread::of(errors).largest,
        least: 0.0,
        most: 1e-9,
        unit: "s".to_owned(),
        reason: "the design's definition, computed twice".to_owned(),
    }
}

/// Centre of the hold instants that are averaged, in seconds after reset.
fn centre_s(solution: &[Conversion], averaging: Averaging) -> f64 {
    let counted = (solution.iter().enumerate()).filter(|(index, _)| averaging.counts(*index));
    let (sum, count) = counted.fold((0.0, 0.0), |(sum, count), (_, conversion)| {
        (sum + conversion.cycle as f64, count + 1.0)
    });
    sum / count / CPU_HZ as f64
}

fn controller(summary: &Summary) -> Vec<Check> {
    let check = |what: &str, value: f64, most: f64, unit: &str, reason: &str| Check {
        party: Check::CONTROLLER.to_owned(),
        what: what.to_owned(),
        value,
        least: 0.0,
        most,
        unit: unit.to_owned(),
        reason: reason.to_owned(),
    };
    let awake = summary.cycles.saturating_sub(summary.sleeping_cycles) as f64;
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
