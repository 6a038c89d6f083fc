//! Runs an image on both engines and compares states and speeds.
//!
//! `cargo run --release -p cardan-translator --example compare -- IMAGE [CYCLES] [THRESHOLD]`

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use cardan_emulator::engine::{Engine, Interpreter};
use cardan_emulator::{ATMEGA328P, Image, Machine, Unconnected};
use cardan_translator::{Limits, Translator};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments
        .next()
        .ok_or("usage: compare IMAGE [CYCLES] [THRESHOLD]")?;
    let cycles = arguments
        .next()
        .map_or(Ok(400_000_000), |text| text.parse())?;
    let mut limits = Limits::default();
    if let Some(text) = arguments.next() {
        limits.threshold = text.parse()?;
    }
    let image = Image::read(Path::new(&file), &ATMEGA328P)?;
    let mut translator =
        Translator::with_limits(limits).ok_or("no code generator for this host")?;
    let interpreted = run(&image, cycles, &mut Interpreter, "interpreter");
    let translated = run(&image, cycles, &mut translator, "translator");
    println!("{:?}", translator.work());
    println!("states are equal: {}", interpreted == translated);
    Ok(())
}

fn run<G: Engine>(image: &Image, cycles: u64, engine: &mut G, name: &str) -> Machine {
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(image);
    let begin = Instant::now();
    let stop = machine.run_with(engine, &mut Unconnected, cycles);
    let seconds = begin.elapsed().as_secs_f64();
    let done = machine.cycle() as f64 / 1e6;
    println!(
        "{name}: {done:.1} Mcycles, {:.1} Mcycles/s, {stop:?}",
        done / seconds
    );
    machine
}
