//! Runs an image for some cycles and prints its serial output and statistics.
//!
//! `cargo run --release -p cardan-emulator --example run -- IMAGE [CYCLES]`

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use cardan_emulator::{ATMEGA328P, AnalogInput, Environment, Image, Machine};

/// Collects serial output; half the reference on every analog pin.
#[derive(Default)]
struct Desk {
    serial: Vec<u8>,
    edges: u64,
}

impl Environment for Desk {
    fn uart_tx(&mut self, _cycle: u64, byte: u8) {
        self.serial.push(byte);
    }

    fn pin_edge(&mut self, _cycle: u64, _pin: cardan_emulator::Pin, _level: bool) {
        self.edges += 1;
    }

    fn analog(&mut self, _cycle: u64, _input: AnalogInput) -> f64 {
        2.5
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().ok_or("usage: run IMAGE [CYCLES]")?;
    let cycles = arguments
        .next()
        .map_or(Ok(100_000_000), |text| text.parse())?;
    let image = Image::read(Path::new(&file), &ATMEGA328P)?;
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    let mut desk = Desk::default();
    let begin = Instant::now();
    let stop = machine.run(&mut desk, cycles);
    let seconds = begin.elapsed().as_secs_f64();
    println!("{}", String::from_utf8_lossy(&desk.serial));
    println!(
        "{stop:?} at {:#06x}, {} pin edges",
        machine.pc(),
        desk.edges
    );
    let statistics = machine.statistics();
    println!("{statistics:?}");
    for report in machine.reports() {
        println!("{report}");
    }
    println!("{:.1} Mcycles/s", statistics.cycles as f64 / 1e6 / seconds);
    Ok(())
}
