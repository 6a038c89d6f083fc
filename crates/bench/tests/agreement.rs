//! The engines agree on a short run of the bundled scenario.

mod rig;

use cardan_bench::App;
use cardan_bench::app::{Configuration, Feed};
use cardan_bench::attitude::Attitude;
use cardan_scenario::Scenario;

use rig::{Recorder, largest, node, run};

/// The bundled scenario on the emulated controller.
fn tumble(seconds: f64) -> (Configuration, Recorder) {
    let scenario = Scenario::load("tumble").expect("is bundled");
    let (configuration, emulated, summary) = rig::emulate(&scenario, seconds, true);
    assert_eq!(summary.crash, None);
    assert_eq!((summary.late_conversions, summary.lost_conversions), (0, 0));
    (configuration, emulated)
}

#[test]
fn native_and_emulated_agree_in_every_bit() {
    let (configuration, emulated) = tumble(2.0);
    let conversions = &emulated.conversions;
    assert_eq!(
        conversions.len() as u64,
        (configuration.solutions + 12) * 64
    );
    let (native, _) = run(
        Attitude.native(&configuration, None).expect("runs"),
        conversions,
    );
    assert_eq!(native.frames.len() as u64, configuration.solutions);
    assert_eq!(native.words.len(), Attitude.nodes().len());
    assert_eq!(native.frames, emulated.frames);
    assert_eq!(native.words, emulated.words);
    let formats: Vec<_> = Attitude.nodes().iter().map(|node| node.format).collect();
    let tunable = Attitude
        .native(&configuration, Some(&formats))
        .expect("runs");
    let (tunable, _) = run(tunable, conversions);
    assert_eq!(tunable.words, native.words);
    assert_eq!(tunable.frames, native.frames);
}

/// The way from `b` to `a` in the node's unit, the short one where that is an angle.
fn difference(unit: &str, a: f64, b: f64) -> f64 {
    match unit {
        "half_turn" => (a - b) - 2.0 * ((a - b) / 2.0).round(),
        _ => a - b,
    }
}

#[test]
fn golden_is_near_native_in_every_node_and_nearer_to_the_real_interpretation() {
    let (configuration, emulated) = tumble(2.0);
    let conversions = &emulated.conversions;
    let show = |engine| run(engine, conversions).0;
    let native = show(Attitude.native(&configuration, None).expect("runs"));
    let golden = show(Attitude.golden(&configuration, Feed::Codes));
    let real = show(Attitude.real(&configuration, 0, None).expect("runs"));
    let allowed = Attitude.tolerances();
    for (shared, node) in Attitude.golden_nodes().into_iter().enumerate() {
        let info = Attitude.nodes()[node];
        let (golden, real) = (&golden.reals[shared], &real.reals[node]);
        let words = &native.words[node];
        assert!(
            golden.len() as u64 >= configuration.solutions,
            "{}",
            info.name
        );
        assert_eq!(
            (golden.len(), golden.len()),
            (real.len(), words.len()),
            "{}",
            info.name
        );
        let rounding = largest(
            (golden.iter().zip(words))
                .map(|(&golden, &raw)| difference(info.unit, info.format.real(raw), golden)),
        );
        let algorithm = largest(
            (golden.iter().zip(real)).map(|(&golden, &real)| difference(info.unit, real, golden)),
        );
        println!(
            "{:16} native-golden {rounding:.3e} ({:.2} LSB) real-golden {algorithm:.3e}",
            info.name,
            rounding / info.format.lsb()
        );
        let most = allowed.iter().find(|allowed| allowed.node == info.name);
        let most = most.expect("every shared node has a limit").max_abs + SETTINGS;
        assert!(
            algorithm <= most,
            "{}: {algorithm:e} of {most:e}",
            info.name
        );
        let most = most_steps(info.name) * info.format.lsb();
        assert!(rounding <= most, "{}: {rounding:e} of {most:e}", info.name);
    }
}

/// What settings with 28 fractional bits leave of 1 over the horizontal field, which golden has exactly.
const SETTINGS: f64 = 1.0 / (1_u64 << 27) as f64;

/// Steps of a node's word by which rounding may take it from golden in this run.
fn most_steps(node: &str) -> f64 {
    match node {
        // Each set alone has dead spots, where an inverse sine or cosine magnifies rounding.
        "yaw_1" | "yaw_2" => 40.0,
        _ => 12.0,
    }
}

#[test]
fn frames_tell_the_yaw_of_the_truth_to_the_sensors_noise() {
    let (configuration, emulated) = tumble(2.0);
    assert_eq!(emulated.frames.len() as u64, configuration.solutions);
    assert_eq!(emulated.truths.len(), emulated.frames.len());
    let mut squares = Vec::new();
    for (truth, frame) in emulated.truths.iter().zip(&emulated.frames) {
        let (angles, flags) = Attitude.decode_frame(frame).expect("whole");
        let yaw = truth.values.as_ref().expect("synthetic")[0];
        let error = 180.0 * difference("half_turn", angles[0], yaw);
        if flags == 0 {
            squares.push(error * error);
        }
    }
    assert!(
        squares.len() * 10 > emulated.frames.len() * 9,
        "{} unflagged",
        squares.len()
    );
    let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    println!("yaw rms {rms} degrees");
    assert!(rms > 0.1 && rms < 2.0, "{rms} degrees");
}

#[test]
fn rounding_steps_are_the_real_interpretation_with_the_first_nodes_rounded() {
    let (configuration, emulated) = tumble(1.0);
    let steps = Attitude
        .rounding_steps(&configuration, None)
        .expect("deployed formats");
    let (steps, _) = run(steps, &emulated.conversions);
    let first = Attitude.stages().len();
    // Before, at and behind the average, whose words the steps behind it share.
    for quantised in [1, 4, 5, 6, 30, Attitude.nodes().len()] {
        let engine = Attitude.real(&configuration, quantised, None);
        let (shown, _) = run(engine.expect("runs"), &emulated.conversions);
        for (member, name) in ["yaw", "pitch", "roll"].into_iter().enumerate() {
            let expected = &shown.reals[node(name)];
            assert!(!expected.is_empty());
            let found = &steps.stages[&(first + quantised - 1, member)];
            assert_eq!(found, expected, "{quantised} nodes, {name}");
        }
    }
}
