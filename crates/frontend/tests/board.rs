//! The whole board against what the design promises: scale, sign, delay, order of events, noise.

mod common;

use cardan_frontend::design::nominal_edges;
use cardan_frontend::{Design, Error, Frontend, Pin, Stage};
use cardan_scenario::{Experience, Scenario, Stimulus, Trajectory};
use cardan_spec::timing::{CPU_HZ, HALF_CARRIER_CYCLES};
use cardan_spec::{Channel, FIELD_FULL_SCALE_UT, TILT_FULL_SCALE_G, ThirdTilt};
use cardan_units::Cycles;

use common::{Script, clock, constant, quiet, voltages};

#[test]
fn constant_inputs_give_the_nominal_calibration_to_a_millionth_of_full_scale() {
    let residue = Design::new(&quiet())
        .expect("a working design")
        .tilt
        .residue_lsb
        / 512.0;
    for share in [-0.99, -0.5, 0.25, 0.95] {
        let stimulus = || constant(share * TILT_FULL_SCALE_G, share * FIELD_FULL_SCALE_UT);
        for (channel, expected) in [
            (Channel::TiltX, share),
            // What the shared band-pass leaves of x.
            (Channel::TiltY, residue * share),
            (Channel::FieldX, 0.0),
            (Channel::FieldY, share),
        ] {
            let times = (0..20).map(|k| 0.4 + 137.3e-6 * f64::from(k));
            for volts in voltages(&quiet(), 1, stimulus(), channel, times) {
                let found = volts / 2.5 - 1.0;
                assert!(
                    (found - expected).abs() < 1e-6,
                    "{channel:?} {share}: {found}"
                );
            }
        }
    }
}

#[test]
fn a_ramp_comes_out_later_by_the_nominal_group_delay_on_every_channel() {
    let (force_rate, field_rate) = (1.0, 50.0);
    // Along one axis: of the other one's force the shared band-pass leaves 6e-6.
    let ramp = |axis: usize| {
        Script(move |t: f64| {
            let mut now = Experience::default();
            now.specific_force_g[axis] = [1.0, -1.0][axis] * force_rate * t;
            now.field_ut[axis] = [1.0, -1.0][axis] * field_rate * t;
            now
        })
    };
    let board = Frontend::new(&quiet(), 1, ramp(0)).expect("a working design");
    let delay_s = board.design().group_delay_s();
    let corner_hz = board.design().field.low_pass_hz;
    println!("{delay_s} s, {corner_hz} Hz");
    assert!((10.0e-3..10.4e-3).contains(&delay_s), "{delay_s}");
    assert!((27.0..29.0).contains(&corner_hz), "{corner_hz}");
    for (channel, rate, full_scale) in [
        (Channel::TiltX, force_rate, TILT_FULL_SCALE_G),
        (Channel::TiltY, -force_rate, TILT_FULL_SCALE_G),
        (Channel::FieldX, field_rate, FIELD_FULL_SCALE_UT),
        (Channel::FieldY, -field_rate, FIELD_FULL_SCALE_UT),
    ] {
        let times = (0..16).map(|k| 0.5 + 0.5e-3 * f64::from(k));
        let found = voltages(
            &quiet(),
            1,
            ramp(channel as usize % 2),
            channel,
            times.clone(),
        );
        let late = found.iter().zip(times).map(|(volts, t)| {
            let input = (volts / 2.5 - 1.0) * full_scale;
            t - input / rate - delay_s
        });
        let late: Vec<f64> = late.collect();
        // The ripple of the track-and-hold moves the instant: by up to half a carrier period, or what
        // the low-pass leaves of half a millisecond at 500 Hz.
        assert!(late.iter().all(|s| s.abs() < 1e-5), "{channel:?}: {late:?}");
        let mean = late.iter().sum::<f64>() / late.len() as f64;
        println!("{channel:?}: {mean:e} s");
        assert!(mean.abs() < 2e-7, "{channel:?}: {mean}");
    }
}

#[test]
fn without_a_carrier_nothing_comes_through() {
    let mut board = Frontend::new(&quiet(), 1, constant(1.0, 50.0)).expect("a working design");
    for channel in Channel::ALL {
        let volts = board
            .voltage(Cycles(CPU_HZ / 10), channel)
            .expect("in order")
            .0;
        assert!((volts - 2.5).abs() < 1e-9, "{channel:?}: {volts}");
    }
}

#[test]
fn a_strobe_in_the_wrong_phase_loses_the_signal() {
    // Strobing the tilt channels at the carrier's edges samples the zero crossings. The multiplexer
    // stays with x.
    let mut board = Frontend::new(&quiet(), 1, constant(1.0, 0.0)).expect("a working design");
    board
        .pin_edge(Cycles(0), Pin::Settled, true)
        .expect("in order");
    for half in 0..12_000 {
        let (cycle, high) = (Cycles((half + 1) * HALF_CARRIER_CYCLES), half % 2 == 0);
        board.pin_edge(cycle, Pin::Strobe, high).expect("in order");
        board.pin_edge(cycle, Pin::Carrier, high).expect("in order");
    }
    let volts = board
        .voltage(Cycles(6_000_000), Channel::TiltX)
        .expect("in order")
        .0;
    assert!((volts - 2.5).abs() < 0.4, "{volts}");
}

#[test]
fn after_a_step_of_the_neighbour_no_average_keeps_more_of_it_than_the_design_says() {
    use cardan_spec::timing::{ADC_HOLD_CYCLES, CONVERSION_CYCLES};
    // x goes from one end of the scale to the other, y stays at zero.
    let step = Script(|t: f64| Experience {
        specific_force_g: [
            if t < 0.2 { -1.0 } else { 1.0 } * TILT_FULL_SCALE_G,
            0.0,
            0.0,
        ],
        ..Experience::default()
    });
    let mut board = Frontend::new(&quiet(), 1, step).expect("a working design");
    let most = board.design().tilt.residue_lsb;
    assert!((1e-4..0.1).contains(&most), "{most} LSB");
    let mut edges = nominal_edges().peekable();
    let (mut worst, mut sum) = (0.0_f64, 0.0);
    for round in 0..1000_u64 {
        let hold = (4 * round + 1) * CONVERSION_CYCLES + ADC_HOLD_CYCLES;
        clock(&mut board, &mut edges, hold);
        let volts = board.voltage(Cycles(hold), Channel::TiltY);
        sum += (volts.expect("in order").0 - 2.5) / 5.0 * 1024.0 / 16.0;
        if round % 16 == 15 {
            worst = worst.max(sum.abs());
            sum = 0.0;
        }
    }
    println!("{worst} LSB of {most}");
    // Second-order low-pass: a step overshoots by 4 %, and so does its residue.
    assert!(worst > 0.9 * most && worst < 1.1 * most, "{worst} {most}");
}

#[test]
fn asking_more_often_changes_nothing_but_rounding() {
    let motion = || {
        Script(|t: f64| Experience {
            specific_force_g: [0.8 * (6.0 * t).sin(), 0.0, -1.0],
            field_ut: [30.0 * (5.0 * t).cos(), 0.0, 0.0],
            ..Experience::default()
        })
    };
    for channel in [Channel::TiltX, Channel::FieldX] {
        let seldom = voltages(
            &quiet(),
            1,
            motion(),
            channel,
            (1..=10).map(|k| 0.02 * f64::from(k)),
        );
        let often = voltages(
            &quiet(),
            1,
            motion(),
            channel,
            (1..=2000).map(|k| 1e-4 * f64::from(k)),
        );
        for (k, volts) in seldom.iter().enumerate() {
            let same = often[200 * (k + 1) - 1];
            assert!((volts - same).abs() < 1e-9, "{channel:?}: {volts} {same}");
        }
        // Half a second of edges is more than wait before all channels are brought up to date.
        let late = voltages(&quiet(), 1, motion(), channel, std::iter::once(0.5));
        let times = (1..=500).map(|k| 1e-3 * f64::from(k));
        let steadily = voltages(&quiet(), 1, motion(), channel, times);
        assert!(
            (late[0] - steadily[499]).abs() < 1e-9,
            "{channel:?}: {late:?}"
        );
    }
}

#[test]
fn beyond_full_scale_the_output_clips_at_the_rail_and_says_so() {
    let mut board = Frontend::new(&quiet(), 1, constant(1.3, 0.0)).expect("a working design");
    clock(&mut board, &mut nominal_edges().peekable(), 4_000_000);
    let volts = board
        .voltage(Cycles(4_000_000), Channel::TiltX)
        .expect("in order")
        .0;
    assert_eq!(volts, 5.0);
    let seen = board.saturations();
    assert!(
        seen.iter()
            .any(|s| s.stage == Stage::Output && s.channel == Channel::TiltX)
    );
    assert!(
        seen.iter().all(|s| s.stage == Stage::Output),
        "the filters have headroom: {seen:?}"
    );
}

#[test]
fn far_beyond_full_scale_the_filter_that_saturates_is_named() {
    let mut board = Frontend::new(&quiet(), 1, constant(5.0, 0.0)).expect("a working design");
    clock(&mut board, &mut nominal_edges().peekable(), 4_000_000);
    board
        .voltage(Cycles(4_000_000), Channel::TiltX)
        .expect("in order");
    let seen = board.saturations();
    let found = seen
        .iter()
        .find(|s| s.stage == Stage::BandPass)
        .expect("saturated");
    assert_eq!(found.channel, Channel::TiltX);
    assert!(found.first_cycle < 20_000, "at once: {found:?}");
}

#[test]
fn events_out_of_order_are_refused() {
    let mut board = Frontend::new(&quiet(), 1, constant(0.0, 0.0)).expect("a working design");
    board
        .pin_edge(Cycles(1000), Pin::Carrier, true)
        .expect("in order");
    let late = board.pin_edge(Cycles(999), Pin::Carrier, false);
    assert_eq!(
        late,
        Err(Error::OutOfOrder {
            cycle: 999,
            reached: 1000
        })
    );
    board
        .voltage(Cycles(2000), Channel::TiltX)
        .expect("in order");
    assert!(board.voltage(Cycles(1999), Channel::TiltX).is_err());
    assert!(
        board.voltage(Cycles(1999), Channel::TiltY).is_ok(),
        "channels are independent"
    );
}

#[test]
fn the_same_seed_repeats_every_bit_and_another_does_not() {
    let run = |seed| {
        let times = (1..50).map(|k| 2e-3 * f64::from(k));
        voltages(
            &Scenario::default(),
            seed,
            constant(0.5, 20.0),
            Channel::FieldY,
            times,
        )
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn the_published_scenario_has_the_published_deviations_at_the_pins() {
    let scenario = Scenario::load("published").expect("bundled");
    for (channel, full_scale, expected) in [
        (Channel::TiltX, TILT_FULL_SCALE_G, 29.7e-3),
        (Channel::FieldX, FIELD_FULL_SCALE_UT, 0.82),
    ] {
        let times = (100..20_000).map(|k| 2e-3 * f64::from(k));
        let volts = voltages(&scenario, 1, constant(0.0, 0.0), channel, times);
        let n = volts.len() as f64;
        let square = volts
            .iter()
            .map(|v| (v / 2.5 - 1.0) * (v / 2.5 - 1.0))
            .sum::<f64>()
            / n;
        let rms = square.sqrt() * full_scale;
        println!("{channel:?}: {rms}");
        // 40 s of 36 Hz are 2,900 independent values: 1.3 % standard error.
        assert!((rms / expected - 1.0).abs() < 0.05, "{channel:?}: {rms}");
    }
}

#[test]
fn on_the_tumble_the_averages_tell_the_attitude_at_the_output_instant() {
    use cardan_spec::timing::{ADC_HOLD_CYCLES, BLOCK_CONVERSIONS, CONVERSION_CYCLES};
    let scenario = Scenario::load("tumble-quiet").expect("bundled");
    let trajectory = std::sync::Arc::new(Trajectory::new(&scenario, 1).expect("valid"));
    let mut board = Frontend::new(&scenario, 1, trajectory.clone()).expect("a working design");
    let mut edges = nominal_edges().peekable();
    let (mut squares, mut count) = ([0.0; 4], 0.0);
    for solution in 0..1250 {
        let mut sums = [0.0; 4];
        let hold = |k: usize| {
            (solution * BLOCK_CONVERSIONS + k) as u64 * CONVERSION_CYCLES + ADC_HOLD_CYCLES
        };
        for k in 0..BLOCK_CONVERSIONS {
            clock(&mut board, &mut edges, hold(k));
            let volts = board
                .voltage(Cycles(hold(k)), Channel::ALL[k % 4])
                .expect("in order")
                .0;
            sums[k % 4] += (volts / 2.5 - 1.0) / 16.0;
        }
        if solution >= 12 {
            let last = hold(BLOCK_CONVERSIONS - 1);
            let instant = board
                .design()
                .output_instant_s(Cycles(hold(0)), Cycles(last));
            let Experience {
                specific_force_g: f,
                field_ut: b,
                ..
            } = trajectory.at(instant);
            let truth = [f[0] / 1.2, f[1] / 1.2, b[0] / 60.0, b[1] / 60.0];
            (0..4).for_each(|c| squares[c] += (sums[c] - truth[c]) * (sums[c] - truth[c]));
            count += 1.0;
        }
    }
    let rms = squares.map(|square: f64| (square / count).sqrt());
    println!("rms deviation of the averages, of full scale: {rms:?}");
    // 0.3 degrees at 1.2 g and 46 of 60 uT full scale are 4e-3; latency alone at 60 degrees/s, were
    // it wrong by 1 ms, would be 1e-3.
    assert!(rms.iter().all(|r| *r < 5e-4), "{rms:?}");
}

#[test]
fn the_bits_of_a_noisy_run_are_the_same_on_every_host_and_in_every_build() {
    use cardan_frontend::AdcErrors;
    let scenario = Scenario::load("tumble").expect("bundled");
    let trajectory = std::sync::Arc::new(Trajectory::new(&scenario, 1).expect("valid"));
    let mut board = Frontend::new(&scenario, 1, trajectory).expect("a working design");
    let adc = AdcErrors::new(&scenario, 1);
    let mut edges = nominal_edges().peekable();
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for conversion in 0..2000_u64 {
        let hold = conversion * 2000 + 259;
        clock(&mut board, &mut edges, hold);
        let channel = Channel::ALL[conversion as usize % 4];
        let volts = board.voltage(Cycles(hold), channel).expect("in order");
        for byte in adc.apply(volts, conversion).0.to_bits().to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    // FNV-1a of the 2,000 voltages. A change of any model or default changes it: then, and only
    // then, it is to be recorded anew.
    assert_eq!(hash, RECORDED_BITS, "{hash:#018x}");
}

/// See the test above.
const RECORDED_BITS: u64 = 0x9601_acaf_b640_b497;

/// A board read by its converter every 2000 cycles, and its third axis at the end of every 64 of them.
fn third_axis(scenario: &Scenario, force_z: f64, read_channels: bool) -> Vec<f64> {
    let stimulus = Script(move |t: f64| Experience {
        specific_force_g: [0.3 * t, 0.0, force_z],
        ..Experience::default()
    });
    let mut board = Frontend::new(scenario, 1, stimulus).expect("a working design");
    let mut edges = nominal_edges().peekable();
    let mut voltages = Vec::new();
    for conversion in 1..=64 * 50 {
        let cycle = conversion * 2000 + 509;
        clock(&mut board, &mut edges, cycle);
        if read_channels {
            let channel = Channel::ALL[conversion as usize % 4];
            board.voltage(Cycles(cycle), channel).expect("in order");
        }
        if conversion % 64 == 0 {
            let read = board.third_tilt(Cycles(cycle + 77)).expect("in order");
            voltages.extend(read.map(|volts| volts.0));
        }
    }
    voltages
}

#[test]
fn the_third_axis_shows_the_force_along_body_z_where_it_is_fitted_and_nothing_otherwise() {
    let mut scenario = quiet();
    assert_eq!(third_axis(&scenario, -1.0, true), []);
    scenario.sensors.third_tilt = ThirdTilt::Comparator;
    scenario.sensors.accelerometer.offset_z_mg = 30.0;
    scenario.sensors.accelerometer.sensitivity_error_z = -0.1;
    for force_z in [-1.0, 0.2, 1.0] {
        let expected = 2.5 * (1.0 + (0.9 * force_z + 0.03) / TILT_FULL_SCALE_G);
        let found = *third_axis(&scenario, force_z, true).last().expect("read");
        assert!((found - expected).abs() < 3e-6, "{force_z}: {found}");
    }
}

#[test]
fn the_third_axis_has_noise_of_its_own_and_changes_none_of_the_others() {
    let mut scenario = Scenario::default();
    let level = || constant(0.3, 20.0);
    let times = || (0..200).map(|k| 0.3 + 0.5e-3 * f64::from(k));
    let others = |scenario: &Scenario| {
        Channel::ALL.map(|channel| voltages(scenario, 5, level(), channel, times()))
    };
    let without = others(&scenario);
    scenario.sensors.third_tilt = ThirdTilt::Comparator;
    assert_eq!(others(&scenario), without);
    let read = third_axis(&scenario, 0.0, true);
    assert!(
        read.iter().any(|volts| (volts - read[0]).abs() > 1e-4),
        "noise"
    );
    // Reading the other channels in between moves nothing.
    assert_eq!(third_axis(&scenario, 0.0, false), read);
}
