//! Engines of the attitude sensor run by themselves, and all that they show.
#![allow(dead_code, reason = "each test program uses a part")]

use std::collections::BTreeMap;

use cardan_bench::app::Configuration;
use cardan_bench::attitude::Attitude;
use cardan_bench::image::Firmware;
use cardan_bench::{App, Conversion, Engine, Sink, SinkError, Summary, Truth};
use cardan_scenario::Scenario;

/// Everything an engine shows.
#[derive(Default)]
pub(crate) struct Recorder {
    pub(crate) conversions: Vec<Conversion>,
    pub(crate) words: Vec<Vec<i64>>,
    pub(crate) reals: Vec<Vec<f64>>,
    pub(crate) frames: Vec<Vec<u8>>,
    pub(crate) truths: Vec<Truth>,
    /// By stage and member.
    pub(crate) stages: BTreeMap<(usize, usize), Vec<f64>>,
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
    fn stage(&mut self, stage: usize, member: usize, value: f64, _: u64) -> Result<(), SinkError> {
        let values = self.stages.entry((stage, member)).or_default();
        values.push(value);
        Ok(())
    }
    fn truth(&mut self, truth: &Truth) -> Result<(), SinkError> {
        self.truths.push(truth.clone());
        Ok(())
    }
}

/// What an engine shows of these conversions, or of its own.
pub(crate) fn run(mut engine: Box<dyn Engine>, conversions: &[Conversion]) -> (Recorder, Summary) {
    let mut recorder = Recorder::default();
    let mut feed = conversions.iter().copied().map(Ok);
    let summary = engine.run(&mut feed, &mut recorder).expect("runs");
    (recorder, summary)
}

/// A run of a bundled image on the emulated controller.
pub(crate) fn emulate(
    scenario: &Scenario,
    seconds: f64,
    tapped: bool,
) -> (Configuration, Recorder, Summary) {
    let image = Attitude.bundled(tapped).expect("bundled");
    let firmware = Firmware::parse("bundled.elf", image).expect("parses");
    if tapped {
        firmware
            .check_formats(Attitude.nodes(), Attitude.formats_hash())
            .expect("same formats");
    }
    let (configuration, mut device) = Attitude
        .emulated(scenario, 1, seconds, &firmware)
        .expect("fits");
    let mut recorder = Recorder::default();
    let summary = device.run(&mut recorder).expect("runs");
    (configuration, recorder, summary)
}

/// Index of a node.
pub(crate) fn node(name: &str) -> usize {
    let found = Attitude.nodes().iter().position(|node| node.name == name);
    found.expect("a node of that name")
}

/// The same among those that golden has.
pub(crate) fn shared(name: &str) -> usize {
    let at = node(name);
    let golden = Attitude.golden_nodes();
    let found = golden.iter().position(|&index| index == at);
    found.expect("golden knows it")
}

/// The largest of these sizes; what is no number is larger than all.
pub(crate) fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    let sizes = values.into_iter().map(f64::abs);
    sizes.max_by(f64::total_cmp).expect("a value")
}
