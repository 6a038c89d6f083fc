//! A device that measures its third tilt axis: five channels on their schedule, the same bits on the host,
//! golden near, whatever is averaged.

mod rig;

use cardan_bench::app::Feed;
use cardan_bench::attitude::Attitude;
use cardan_bench::image::Firmware;
use cardan_bench::{App, Conversion};
use cardan_scenario::Scenario;
use cardan_spec::timing::CONVERSION_CYCLES;
use cardan_spec::{ACCELERATION_LIMIT, Channel, MOST_CHANNELS, ThirdTilt, frame};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

use rig::{emulate, largest, node, run, shared};

fn scenario(averaging: f64, period: f64) -> Scenario {
    let mut scenario = Scenario::load("somersault").expect("is bundled");
    scenario.set("sensors.third_tilt", 2.0).expect("a kind");
    scenario
        .set("controller.averaging", averaging)
        .expect("a key");
    scenario.set("controller.period", period).expect("a key");
    scenario
}

const AVERAGINGS: [(f64, f64); 6] = [
    (16.0, 16.0),
    (1.0, 16.0),
    (4.0, 16.0),
    (8.0, 32.0),
    (64.0, 64.0),
    (32.0, 128.0),
];

#[test]
fn five_channels_keep_the_schedule_and_native_the_bits_for_every_averaging() {
    for (averaging, period) in AVERAGINGS {
        let (configuration, emulated, summary) = emulate(&scenario(averaging, period), 1.0, true);
        let what = format!("{averaging} of {period}");
        assert_eq!(configuration.third_tilt(), ThirdTilt::Measured);
        assert_eq!(summary.crash, None, "{what}");
        let counts = [
            summary.late_conversions,
            summary.lost_conversions,
            summary.missed_deadlines,
            summary.mistimed,
        ];
        assert_eq!(counts, [0; 4], "{what}: {:?}", summary.first_mistimed);
        let conversions = &emulated.conversions;
        let timing = configuration.averaging();
        let expected = timing.warm_up_conversions() as u64
            + configuration.solutions * timing.conversions() as u64;
        assert_eq!(conversions.len() as u64, expected, "{what}");
        for (index, pair) in conversions.windows(2).enumerate().skip(1) {
            assert_eq!(
                usize::from(pair[0].channel),
                index % MOST_CHANNELS,
                "{what}"
            );
            assert_eq!(pair[1].cycle - pair[0].cycle, CONVERSION_CYCLES, "{what}");
        }
        let (native, _) = run(
            Attitude.native(&configuration, None).expect("runs"),
            conversions,
        );
        assert_eq!(
            native.frames.len() as u64,
            configuration.solutions,
            "{what}"
        );
        assert_eq!(native.frames, emulated.frames, "{what}");
        assert_eq!(native.words, emulated.words, "{what}");
        let formats: Vec<_> = Attitude.nodes().iter().map(|node| node.format).collect();
        let tunable = Attitude.native(&configuration, Some(&formats));
        let (tunable, _) = run(tunable.expect("runs"), conversions);
        assert_eq!(tunable.words, native.words, "{what}");
        assert_eq!(tunable.frames, native.frames, "{what}");
        println!(
            "{what}: latency at most {} cycles",
            summary.isr_latency_max_cycles
        );
    }
}

#[test]
fn golden_reads_the_third_axis_as_native_does_and_as_it_truly_is() {
    let (configuration, emulated, _) = emulate(&scenario(16.0, 16.0), 2.0, true);
    let conversions = &emulated.conversions;
    let (native, _) = run(
        Attitude.native(&configuration, None).expect("runs"),
        conversions,
    );
    let format = Attitude.nodes()[node("tilt_z")].format;
    let native: Vec<f64> = native.words[node("tilt_z")]
        .iter()
        .map(|&raw| format.real(raw))
        .collect();
    let golden = |feed| {
        let (golden, _) = run(Attitude.golden(&configuration, feed), conversions);
        golden.reals[shared("tilt_z")].clone()
    };
    let worst = |one: &[f64], other: &[f64]| {
        assert!(one.len() == other.len() && one.len() as u64 == configuration.solutions);
        largest(one.iter().zip(other).map(|(a, b)| a - b))
    };
    let (codes, volts, direct) = (
        golden(Feed::Codes),
        golden(Feed::IdealVolts),
        golden(Feed::Direct),
    );
    let [rounding, steps] = [worst(&native, &codes), worst(&codes, &volts)];
    println!("native {rounding:e} g from golden, steps of the converter {steps:e} g");
    assert!(rounding > 0.0 && rounding < 8e-5, "{rounding}");
    // Half a step of 2.34 mg without noise; its own noise is in the codes, averaged over 16.
    assert!(steps > 0.0 && steps < 2.4e-3, "{steps}");
    // Noise of some mg, and of the motion 10 ms of averaging.
    assert!(worst(&volts, &direct) < 0.02, "{}", worst(&volts, &direct));
    // Both signs, as large as gravity, and the truth's.
    let ends = |values: &[f64]| {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        (
            least,
            values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        )
    };
    let (least, most) = ends(&direct);
    assert!(
        least < -0.5 && most > 0.5 && least >= -1.0 && most <= 1.0,
        "{least} {most}"
    );
    assert_eq!(direct.len(), emulated.truths.len());
    for (told, truth) in direct.iter().zip(&emulated.truths) {
        let angles = truth.values.as_ref().expect("synthetic");
        let [pitch, roll] = [angles[1], angles[2]].map(|angle| angle * std::f64::consts::PI);
        let down = libm::cos(pitch) * libm::cos(roll);
        assert!((told - down).abs() < 3e-3, "{told} {down}");
    }
}

#[test]
fn the_schedule_is_kept_whatever_the_settings() {
    // The start-up takes another time for every setting, which must not show in any phase.
    for tapped in [false, true] {
        for kind in ThirdTilt::ALL {
            for (length, period) in [
                (1.0, 16.0),
                (2.0, 16.0),
                (16.0, 16.0),
                (1.0, 32.0),
                (4.0, 32.0),
                (8.0, 64.0),
                (64.0, 64.0),
            ] {
                let mut scenario = scenario(length, period);
                scenario.sensors.third_tilt = kind;
                let (configuration, shown, summary) = emulate(&scenario, 0.2, tapped);
                let what = format!("{kind:?}, {length} of {period}, tapped {tapped}");
                let timing = configuration.averaging();
                assert!(configuration.solutions > 0, "{what}");
                let conversions = timing.warm_up_conversions() as u64
                    + configuration.solutions * timing.conversions() as u64;
                assert_eq!(shown.conversions.len() as u64, conversions, "{what}");
                let counts = [
                    summary.late_conversions,
                    summary.lost_conversions,
                    summary.mistimed,
                ];
                assert_eq!(counts, [0; 3], "{what}: {:?}", summary.first_mistimed);
            }
        }
    }
}

#[test]
fn frames_carry_the_fifth_average_also_without_taps() {
    let (configuration, plain, summary) = emulate(&scenario(16.0, 16.0), 0.6, false);
    assert_eq!(summary.mistimed, 0, "{:?}", summary.first_mistimed);
    let native = Attitude.native(&configuration, None).expect("runs");
    let (native, _) = run(native, &plain.conversions);
    assert_eq!(plain.frames, native.frames);
    let averages = native.words[node("average")].chunks(MOST_CHANNELS);
    assert_eq!(averages.len(), plain.frames.len());
    for (frame, averages) in plain.frames.iter().zip(averages) {
        assert_eq!(frame.len(), frame::MOST_WIRE_LEN);
        assert!(Attitude.decode_frame(frame).is_some());
        let payload = cobs::decode_vec(&frame[..frame.len() - 1]).expect("whole");
        let word = |at: usize| i64::from(i16::from_le_bytes([payload[at], payload[at + 1]]));
        let sent = [2, 4, 6, 8, 18].map(word);
        assert_eq!(sent[..], *averages);
        for len in [frame.len() - 3, frame.len() - 2] {
            let mut cut = frame[..len].to_vec();
            cut.push(0);
            assert_eq!(Attitude.decode_frame(&cut), None, "a byte is missing");
        }
    }
    assert_eq!(plain.frames.len() as u64, configuration.solutions);
}

#[test]
fn an_eeprom_of_another_device_is_refused() {
    use cardan_bench::attitude::nominal_eeprom;
    use cardan_bench::image::EepromImage;
    let mut firmware =
        Firmware::parse("bundled.elf", Attitude.bundled(true).expect("bundled")).expect("parses");
    for (fitted, stored, refused) in [
        ("absent", ThirdTilt::Measured, true),
        ("comparator", ThirdTilt::Measured, true),
        ("measured", ThirdTilt::Comparator, true),
        ("measured", ThirdTilt::Measured, false),
        ("measured", ThirdTilt::Absent, false),
    ] {
        let mut scenario = scenario(16.0, 16.0);
        scenario.sensors.third_tilt = cardan_scenario::third_tilt::named(fitted).expect("a kind");
        firmware.eeprom = Some(EepromImage {
            name: "unit.bin".to_owned(),
            bytes: nominal_eeprom(stored),
        });
        let made = Attitude.emulated(&scenario, 1, 0.5, &firmware);
        let message = made.err();
        assert_eq!(
            message.is_some(),
            refused,
            "{fitted} {stored:?}: {message:?}"
        );
        let names =
            |text: &String| text.contains("unit.bin") && text.contains("sensors.third_tilt");
        assert!(message.iter().all(names), "{message:?}");
    }
}

/// Conversions whose tilt channels take any values at all, mostly none that gravity alone could give.
fn shaken(conversions: &[Conversion], per_solution: usize, warm_up: usize) -> Vec<Conversion> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut forces = [512_u16; MOST_CHANNELS];
    let mut shaken = conversions.to_vec();
    for (at, conversion) in shaken.iter_mut().skip(warm_up).enumerate() {
        if at % per_solution == 0 {
            forces = std::array::from_fn(|_| 1 + (random.next_u32() % 1022) as u16);
        }
        let channel = usize::from(conversion.channel);
        if [0, 1, Channel::TiltZ as usize].contains(&channel) {
            conversion.code = forces[channel];
        }
    }
    shaken
}

/// Beyond what gravity alone could be, firmware and golden still take the same for its direction: what they
/// make of it outlives the solution in the memory of motion.
#[test]
fn a_force_that_gravity_cannot_be_is_scaled_alike_by_firmware_and_golden() {
    let (configuration, emulated, _) = emulate(&scenario(16.0, 16.0), 4.0, false);
    let averaging = configuration.averaging();
    let conversions = shaken(
        &emulated.conversions,
        averaging.conversions(),
        averaging.warm_up_conversions(),
    );
    let (real, _) = run(
        Attitude.real(&configuration, 0, None).expect("runs"),
        &conversions,
    );
    let (golden, _) = run(Attitude.golden(&configuration, Feed::Codes), &conversions);
    // The series ends 1.8e-5 off; readings are up to 1.2 g.
    for (name, most) in [("gravity_x", 3e-5), ("gravity_y", 3e-5), ("down", 3e-5)] {
        let (real, golden) = (&real.reals[node(name)], &golden.reals[shared(name)]);
        assert_eq!(real.len() as u64, configuration.solutions);
        assert_eq!(golden.len(), real.len());
        let worst = largest(real.iter().zip(golden).map(|(a, b)| a - b));
        assert!(worst < most, "{name}: {worst:e}");
    }
    let squares = &real.reals[node("gravity_square")];
    let beyond = |square: &&f64| (**square - 1.0).abs() > ACCELERATION_LIMIT;
    let count = squares.iter().filter(beyond).count();
    assert!(count > squares.len() / 2, "{count} of {}", squares.len());
    let (short, long) = (
        squares.iter().any(|&s| s < 0.3),
        squares.iter().any(|&s| s > 2.0),
    );
    assert!(short && long);
}
