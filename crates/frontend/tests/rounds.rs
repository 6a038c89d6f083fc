//! Rounds of four and of five conversions against the tilt channels' multiplexer: a turn of either
//! channel takes 16 conversions together, so that rounds of four see four phases of it, over and over,
//! and rounds of five all 16 in 16 rounds, which is a block.

#[allow(dead_code, reason = "each test program uses a part of it")]
mod common;

use cardan_frontend::design::nominal_edges;
use cardan_frontend::{Design, Error, Frontend};
use cardan_scenario::{Experience, Scenario};
use cardan_spec::timing::{
    ADC_HOLD_CYCLES, BLOCK_ROUNDS, CONVERSION_CYCLES, CPU_HZ, STROBE_COUNT, TURN_CYCLES,
};
use cardan_spec::{Channel, TILT_FULL_SCALE_G, ThirdTilt};
use cardan_units::Cycles;

use common::{Script, clock, quiet};

/// Steps of the converter per full scale.
const STEPS: f64 = 512.0;

fn with(third_tilt: ThirdTilt) -> Scenario {
    let mut scenario = quiet();
    scenario.sensors.third_tilt = third_tilt;
    scenario
}

/// Hold instants in seconds and averages over full scale of a channel's conversions: `settled` rounds
/// after the start, then `count`.
fn conversions(
    scenario: &Scenario,
    force: impl Fn(f64) -> [f64; 3],
    channel: Channel,
    settled: usize,
    count: usize,
) -> Vec<(f64, f64)> {
    let stimulus = Script(move |t: f64| Experience {
        specific_force_g: force(t),
        ..Experience::default()
    });
    let mut board = Frontend::new(scenario, 1, stimulus).expect("a working design");
    let mut edges = nominal_edges().peekable();
    let round = scenario.sensors.third_tilt.channels() as u64 * CONVERSION_CYCLES;
    let first = u64::from(STROBE_COUNT) + 1 + ADC_HOLD_CYCLES;
    (settled..settled + count)
        .map(|k| {
            let hold = first + k as u64 * round + channel as u64 * CONVERSION_CYCLES;
            clock(&mut board, &mut edges, hold);
            let volts = board.voltage(Cycles(hold), channel).expect("in order").0;
            (hold as f64 / CPU_HZ as f64, volts / 2.5 - 1.0)
        })
        .collect()
}

/// Means over any `length` conversions in a row.
fn means(values: &[f64], length: usize) -> Vec<f64> {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / length as f64;
    values.windows(length).map(mean).collect()
}

/// The largest size; what is no number is larger than all.
fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    let sizes = values.into_iter().map(f64::abs);
    sizes.max_by(f64::total_cmp).expect("values")
}

#[test]
fn a_block_of_five_channels_holds_every_phase_of_both_turns_once() {
    let channels = ThirdTilt::Measured.channels() as u64;
    let phase = |k: u64| k * channels * CONVERSION_CYCLES % (2 * TURN_CYCLES);
    let mut phases: Vec<u64> = (0..BLOCK_ROUNDS as u64).map(phase).collect();
    phases.sort_unstable();
    let all: Vec<u64> = (0..2 * TURN_CYCLES)
        .step_by(CONVERSION_CYCLES as usize)
        .collect();
    assert_eq!(phases, all);
}

#[test]
fn what_an_average_keeps_of_the_neighbour_is_what_the_design_says() {
    for third_tilt in [ThirdTilt::Absent, ThirdTilt::Measured] {
        let scenario = with(third_tilt);
        let design = Design::new(&scenario).expect("a working design");
        let share = 0.99;
        let driven = move |_| [share * TILT_FULL_SCALE_G, 0.0, 0.0];
        let read = conversions(&scenario, driven, Channel::TiltY, 400, 64);
        let residue: Vec<f64> = read
            .iter()
            .map(|(_, value)| STEPS * value / share)
            .collect();
        let off = |length| {
            largest(
                means(&residue, length)
                    .iter()
                    .map(|r| r - design.tilt.residue_lsb),
            )
        };
        let single = largest(residue.iter().copied());
        println!(
            "{third_tilt:?}: {} LSB by design, single {single}; averages of 1, 4, 16 off by {:e}, {:e}, {:e}",
            design.tilt.residue_lsb,
            off(1),
            off(4),
            off(16)
        );
        assert!(
            off(BLOCK_ROUNDS) < 2e-5,
            "{third_tilt:?}: {}",
            off(BLOCK_ROUNDS)
        );
        // Not in an average alone, but in every conversion.
        assert!(single < 0.1, "{third_tilt:?}: {single}");
    }
}

#[test]
fn the_ripple_of_holding_a_ramp_is_gone_from_a_block_and_small_in_shorter_averages() {
    for third_tilt in [ThirdTilt::Absent, ThirdTilt::Measured] {
        let scenario = with(third_tilt);
        let delay_s = Design::new(&scenario)
            .expect("a working design")
            .group_delay_s();
        let rate = 1.0;
        let ramp = move |t: f64| [rate * t - 0.5, 0.0, 0.0];
        let read = conversions(&scenario, ramp, Channel::TiltX, 400, 60);
        // By how many microseconds each conversion tells another instant than the design says.
        let early = |&(hold_s, value): &(f64, f64)| {
            1e6 * ((value * TILT_FULL_SCALE_G + 0.5) / rate - (hold_s - delay_s))
        };
        let early: Vec<f64> = read.iter().map(early).collect();
        let off = |length| largest(means(&early, length));
        println!(
            "{third_tilt:?}: averages of 1, 2, 4, 8, 16: {:.3}, {:.3}, {:.3}, {:.3}, {:.5} us",
            off(1),
            off(2),
            off(4),
            off(8),
            off(16)
        );
        assert!(off(1) < 7.0, "{third_tilt:?}: {}", off(1));
        assert!(
            off(BLOCK_ROUNDS) < 0.02,
            "{third_tilt:?}: {}",
            off(BLOCK_ROUNDS)
        );
        let four = if third_tilt == ThirdTilt::Measured {
            0.25 * off(1)
        } else {
            0.02
        };
        assert!(off(4) < four, "{third_tilt:?}: {}", off(4));
    }
}

#[test]
fn a_measured_third_axis_has_scale_sign_and_delay_of_the_others() {
    let scenario = with(ThirdTilt::Measured);
    let delay_s = Design::new(&scenario)
        .expect("a working design")
        .group_delay_s();
    for force in [-1.0, 0.25, 1.0] {
        let read = conversions(
            &scenario,
            move |_| [0.3, 0.0, force],
            Channel::TiltZ,
            400,
            4,
        );
        for (_, value) in read {
            assert!(
                (value - force / TILT_FULL_SCALE_G).abs() < 1e-6,
                "{force}: {value}"
            );
        }
    }
    let read = conversions(
        &scenario,
        |t: f64| [0.0, 0.0, t - 0.5],
        Channel::TiltZ,
        400,
        20,
    );
    for (hold_s, value) in read {
        let told = value * TILT_FULL_SCALE_G + 0.5;
        assert!((told - (hold_s - delay_s)).abs() < 2e-6, "{hold_s}: {told}");
    }
}

#[test]
fn the_fifth_pin_is_open_unless_the_third_axis_is_measured() {
    for third_tilt in [ThirdTilt::Absent, ThirdTilt::Comparator] {
        let scenario = with(third_tilt);
        let read = conversions(&scenario, |_| [0.0, 0.0, 1.0], Channel::TiltZ, 60, 2);
        assert!(
            read.iter().all(|(_, value)| *value == -1.0),
            "0 V: {read:?}"
        );
    }
}

#[test]
fn a_third_axis_that_leaves_the_range_at_rest_is_refused_where_it_is_measured() {
    let still = || Script(|_: f64| Experience::default());
    let mut scenario = with(ThirdTilt::Measured);
    scenario.sensors.accelerometer.offset_z_mg = 300.0;
    let refused = Frontend::new(&scenario, 1, still())
        .err()
        .expect("beyond full scale");
    assert!(matches!(refused, Error::Design { .. }), "{refused}");
    assert!(refused.to_string().contains("TiltZ"), "{refused}");
    // A comparator's axis may.
    scenario.sensors.third_tilt = ThirdTilt::Comparator;
    assert!(Frontend::new(&scenario, 1, still()).is_ok());
}
