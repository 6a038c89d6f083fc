//! A bench of one's own: a step of voltage for a firmware that smooths it, and a model in `f64` beside each value
//! that the firmware publishes (`examples/firmware-c/smooth.c`).
//!
//! `cargo run --release -p cardan-emulator --example bench -- smooth.elf`

use std::path::Path;

use cardan_emulator::{ATMEGA328P, AnalogInput, Environment, Image, Machine};

/// What surrounds the chip, and what is expected of it.
#[derive(Default)]
struct Bench {
    /// Address of the firmware's table of values.
    taps: usize,
    model: f64,
    worst: f64,
    serial: String,
}

impl Environment for Bench {
    /// ADC0 in volts when the converter holds it: 1 V, from 4 ms on 2.5 V.
    fn analog(&mut self, cycle: u64, _input: AnalogInput) -> f64 {
        if cycle < 64_000 { 1.0 } else { 2.5 }
    }

    /// The firmware has sent a byte.
    fn uart_tx(&mut self, _cycle: u64, byte: u8) {
        self.serial.push(char::from(byte));
    }

    /// The firmware has published a value: `node` 0 is a code, 1 the smoothed code with 5 fractional bits.
    fn strobe(&mut self, _cycle: u64, node: u8, data: &[u8]) {
        let at = self.taps + 4 * usize::from(node);
        let word: [u8; 4] = data[at..at + 4].try_into().unwrap_or_default();
        let raw = f64::from(i32::from_le_bytes(word));
        match node {
            0 => self.model += (raw - self.model) / 8.0,
            _ => self.worst = self.worst.max((raw / 32.0 - self.model).abs()),
        }
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1).ok_or("usage: bench smooth.elf")?;
    let image = Image::read(Path::new(&file), &ATMEGA328P)?;
    let taps = image.symbol("CARDAN_TAPS").ok_or("no CARDAN_TAPS in it")?;
    let mut bench = Bench {
        taps: taps.address as usize,
        ..Bench::default()
    };
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    let stop = machine.run(&mut bench, 1_000_000);
    if bench.serial.is_empty() {
        return Err(format!("the firmware sent nothing: {stop:?}").into());
    }
    println!("the firmware sent {}", bench.serial.trim());
    println!("the model ends at {:.3} codes", bench.model);
    println!("largest difference: {:.3} codes", bench.worst);
    Ok(())
}
