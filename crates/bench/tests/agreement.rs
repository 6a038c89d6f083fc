//! The engines agree on a short run of the bundled scenario.

use cardan_bench::app::{Configuration, Feed};
use cardan_bench::attitude::Attitude;
use cardan_bench::image::Firmware;
use cardan_bench::{App, Conversion, Engine, Sink, SinkError, Summary, Truth};
use cardan_scenario::Scenario;

/// Everything an engine shows.
#[derive(Default)]
struct Recorder {
    conversions: Vec<Conversion>,
    words: Vec<Vec<i64>>,
    reals: Vec<Vec<f64>>,
    frames: Vec<Vec<u8>>,
    truths: Vec<Truth>,
}

fn push<T>(streams: &mut Vec<Vec<T>>, node: usize, value: T) {
    if streams.len() <= node {
        streams.resize_with(node + 1, Vec::new);
    }
    streams[node].push(value);
}

impl Sink for Recorder {
    fn conversion(&mut self, conversion: &Conversion) -> Result<(), SinkError> {
        self.conversions.push(*conversion);
        Ok(())
    }
    fn word(&mut self, node: usize, raw: i64, _: u64) -> Result<(), SinkError> {
        push(&mut self.words, node, raw);
        Ok(())
    }
    fn real(&mut self, node: usize, value: f64, _: u64) -> Result<(), SinkError> {
        push(&mut self.reals, node, value);
        Ok(())
    }
    fn frame(&mut self, _: u64, bytes: &[u8]) -> Result<(), SinkError> {
        self.frames.push(bytes.to_vec());
        Ok(())
    }
    fn truth(&mut self, truth: &Truth) -> Result<(), SinkError> {
        self.truths.push(*truth);
        Ok(())
    }
}

fn run(mut engine: Box<dyn Engine>, conversions: &[Conversion]) -> (Recorder, Summary) {
    let mut recorder = Recorder::default();
    let mut feed = conversions.iter().copied().map(Ok);
    let summary = engine.run(&mut feed, &mut recorder).expect("runs");
    (recorder, summary)
}

fn emulate(scenario: &str, seconds: f64) -> (Configuration, Recorder, Summary) {
    let scenario = Scenario::load(scenario).expect("is bundled");
    let firmware =
        Firmware::parse("tapped.elf", Attitude.bundled(true).expect("bundled")).expect("parses");
    firmware
        .check_formats(Attitude.nodes(), Attitude.formats_hash())
        .expect("same formats");
    let (configuration, mut device) = Attitude
        .emulated(&scenario, 1, seconds, &firmware)
        .expect("fits");
    let mut recorder = Recorder::default();
    let summary = device.run(&mut recorder).expect("runs");
    (configuration, recorder, summary)
}

#[test]
fn native_and_emulated_agree_in_every_bit_and_golden_is_near() {
    let (configuration, emulated, summary) = emulate("tumble", 2.0);
    println!("{summary:?}");
    let conversions = &emulated.conversions;
    assert_eq!(summary.crash, None);
    assert_eq!((summary.late_conversions, summary.lost_conversions), (0, 0));
    assert_eq!(
        conversions.len() as u64,
        (configuration.solutions + 12) * 64
    );
    let (native, _) = run(
        Attitude.native(&configuration, None).expect("runs"),
        conversions,
    );
    assert_eq!(native.frames, emulated.frames);
    assert_eq!(native.words, emulated.words);
    let formats: Vec<_> = Attitude.nodes().iter().map(|node| node.format).collect();
    let tunable = Attitude
        .native(&configuration, Some(&formats))
        .expect("runs");
    let (tunable, _) = run(tunable, conversions);
    assert_eq!(tunable.words, native.words);
    assert_eq!(tunable.frames, native.frames);
    let (golden, _) = run(Attitude.golden(&configuration, Feed::Codes), conversions);
    let (real, _) = run(
        Attitude.real(&configuration, 0, None).expect("runs"),
        conversions,
    );
    for (shared, node) in Attitude.golden_nodes().into_iter().enumerate() {
        let info = Attitude.nodes()[node];
        let (mut worst, mut algorithm) = (0.0_f64, 0.0_f64);
        for ((golden, real), raw) in golden.reals[shared]
            .iter()
            .zip(&real.reals[node])
            .zip(&native.words[node])
        {
            let wrap = |d: f64| {
                if info.unit == "half_turn" {
                    d - 2.0 * (d / 2.0).round()
                } else {
                    d
                }
            };
            worst = worst.max(wrap(info.format.real(*raw) - golden).abs());
            algorithm = algorithm.max(wrap(real - golden).abs());
        }
        println!(
            "{:16} {:6} native-golden {worst:.3e} ({:.2} LSB) real-golden {algorithm:.3e}",
            info.name,
            golden.reals[shared].len(),
            worst / info.format.lsb()
        );
    }
    let mut sum = 0.0;
    for (truth, frame) in emulated.truths.iter().zip(&emulated.frames) {
        let (angles, flags) = Attitude.decode_frame(frame).expect("whole");
        let truth = truth
            .yaw_pitch_roll_rad
            .expect("synthetic")
            .map(f64::to_degrees);
        let error = (angles[0] * 180.0 - truth[0] + 540.0).rem_euclid(360.0) - 180.0;
        sum += error * error;
        if sum < 0.0 {
            println!("{flags}");
        }
    }
    println!("yaw rms {}", (sum / emulated.truths.len() as f64).sqrt());
}

#[test]
fn rounding_steps_are_the_real_interpretation_with_the_first_nodes_rounded() {
    let (configuration, emulated, _) = emulate("tumble", 1.0);
    let steps = Attitude
        .rounding_steps(&configuration, None, &emulated.conversions)
        .expect("deployed formats");
    // Before, at and behind the average, whose words the steps behind it share.
    for quantised in [0, 1, 4, 5, 6, 30, Attitude.nodes().len()] {
        let engine = Attitude.real(&configuration, quantised, None);
        let (shown, _) = run(engine.expect("runs"), &emulated.conversions);
        let expected = Attitude
            .attitude_nodes()
            .map(|node| shown.reals[node].clone());
        assert!(!expected[0].is_empty());
        assert_eq!(steps.attitudes(quantised), expected, "{quantised} nodes");
    }
}
