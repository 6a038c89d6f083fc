//! Processor time per simulated second of the co-simulation and of its parts, on one thread.
//!
//! `cargo run --release -p cardan-bench --example cosimulation -- [SECONDS] [REPEATS] [CASE]`; CASE is a
//! part of the names of the cases to run. The whole is chip, analog side, board checks and a sink
//! that only counts; the chip alone meets the same volts all the time and nobody behind its pins.
//! Times are the thread's processor time as Linux tells it; on a shared machine the shortest run
//! counts.

use cardan_bench::attitude::Attitude;
use cardan_bench::image::Firmware;
use cardan_bench::{App, Conversion, Sink, SinkError, Truth};
use cardan_emulator::engine::{Engine, Interpreter};
use cardan_emulator::{ATMEGA328P, AnalogInput, Environment, Machine, Pin};
use cardan_scenario::Scenario;
use cardan_spec::timing::CPU_HZ;
use cardan_translator::Translator;

/// Counts what a run shows.
#[derive(Default)]
struct Counter {
    conversions: u64,
    words: u64,
    edges: u64,
    frames: u64,
}

impl Sink for Counter {
    fn conversion(&mut self, _: &Conversion) -> Result<(), SinkError> {
        self.conversions += 1;
        Ok(())
    }
    fn word(&mut self, _: usize, _: i64, _: u64) -> Result<(), SinkError> {
        self.words += 1;
        Ok(())
    }
    fn frame(&mut self, _: u64, _: &[u8]) -> Result<(), SinkError> {
        self.frames += 1;
        Ok(())
    }
    fn pin(&mut self, _: u64, _: Pin, _: bool) -> Result<(), SinkError> {
        self.edges += 1;
        Ok(())
    }
    fn truth(&mut self, _: &Truth) -> Result<(), SinkError> {
        Ok(())
    }
}

/// A chip whose inputs rest, and whose outputs nobody looks at.
struct Resting;

impl Environment for Resting {
    fn analog(&mut self, _: u64, input: AnalogInput) -> f64 {
        match input {
            AnalogInput::Pin(0) => 2.9,
            AnalogInput::Pin(_) => 2.7,
            _ => 0.0,
        }
    }
}

fn main() -> Result<(), String> {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u32| {
        arguments.next().map_or(Ok(default), |text| {
            text.parse().map_err(|error| format!("{text}: {error}"))
        })
    };
    let (seconds, repeats) = (number(10)?, number(3)?);
    let wanted = arguments.next().unwrap_or_default();
    for (image, tapped) in [("plain", false), ("tapped", true)] {
        let bytes = Attitude.bundled(tapped).ok_or("no bundled image")?;
        let firmware = Firmware::parse(image, bytes).map_err(|error| error.to_string())?;
        let show = |what: &str, times: &mut dyn FnMut() -> Result<f64, String>| {
            let case = format!("{image}, {what}");
            if !case.contains(&wanted) {
                return Ok(());
            }
            let mut best = f64::INFINITY;
            for _ in 0..repeats {
                best = best.min(times()?);
            }
            let (ms, factor) = (1e3 * best / f64::from(seconds), f64::from(seconds) / best);
            println!("{case:32} {ms:7.2} ms per simulated second, {factor:5.1} times real time");
            Ok::<(), String>(())
        };
        show("chip alone, interpreter", &mut || {
            chip(&firmware, seconds, &mut Interpreter)
        })?;
        if let Some(mut translator) = Translator::new() {
            show("chip alone, translator", &mut || {
                chip(&firmware, seconds, &mut translator)
            })?;
        }
        for name in ["tumble-quiet", "tumble"] {
            show(&format!("whole, {name}"), &mut || {
                whole(name, &firmware, seconds)
            })?;
        }
    }
    Ok(())
}

/// Processor seconds of the chip alone.
fn chip(firmware: &Firmware, seconds: u32, engine: &mut impl Engine) -> Result<f64, String> {
    let mut machine = Machine::new(&ATMEGA328P, CPU_HZ);
    machine.load(&firmware.image);
    let started = processor_seconds()?;
    machine.run_with(engine, &mut Resting, u64::from(seconds) * CPU_HZ);
    Ok(processor_seconds()? - started)
}

/// Processor time of this thread so far.
fn processor_seconds() -> Result<f64, String> {
    let file = "/proc/thread-self/schedstat";
    let text = std::fs::read_to_string(file).map_err(|error| format!("{file}: {error}"))?;
    let nanoseconds = text.split(' ').next().unwrap_or_default();
    let nanoseconds: u64 = nanoseconds
        .parse()
        .map_err(|error| format!("{file}: {nanoseconds:?}: {error}"))?;
    Ok(nanoseconds as f64 * 1e-9)
}

/// Processor seconds of the whole.
fn whole(scenario: &str, firmware: &Firmware, seconds: u32) -> Result<f64, String> {
    let scenario = Scenario::load(scenario).map_err(|error| error.to_string())?;
    let (_, mut engine) = Attitude.emulated(&scenario, 1, f64::from(seconds), firmware)?;
    let mut counter = Counter::default();
    let started = processor_seconds()?;
    let summary = engine
        .run(&mut counter)
        .map_err(|error| error.to_string())?;
    let taken = processor_seconds()? - started;
    if counter.frames == 0 || summary.mistimed > 0 {
        return Err(format!("the run is not the reference's: {summary:?}"));
    }
    Ok(taken)
}
