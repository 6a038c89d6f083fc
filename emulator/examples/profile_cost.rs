//! How much slower a profiled run is: alternating runs, the best of each.
//!
//! `cargo run --release -p cardan-emulator --example profile_cost -- IMAGE [CYCLES]`

use std::error::Error;
use std::time::Instant;

use cardan_emulator::{ATMEGA328P, Image, Machine, Observers, Profile, Symbols, Unconnected};

const RUNS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let file = arguments
        .next()
        .ok_or("usage: profile_cost IMAGE [CYCLES]")?;
    let cycles = arguments
        .next()
        .map_or(Ok(200_000_000), |text| text.parse())?;
    let bytes = std::fs::read(&file)?;
    let image = Image::parse(&file, &bytes, &ATMEGA328P)?;
    let symbols = Symbols::parse(&bytes);
    let mut best = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        for (is_profiled, best) in [false, true].into_iter().zip(&mut best) {
            let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
            machine.load(&image);
            let mut profile = Profile::new(&symbols, &machine);
            let begin = Instant::now();
            if is_profiled {
                let mut observers = Observers {
                    profile: Some(&mut profile),
                    watch: None,
                };
                machine.run_observed(&mut Unconnected, cycles, &mut observers);
            } else {
                machine.run(&mut Unconnected, cycles);
            }
            *best = best.min(begin.elapsed().as_secs_f64());
        }
    }
    println!(
        "{file}: {:.3} s plain, {:.3} s profiled: {:.2} times",
        best[0],
        best[1],
        best[1] / best[0]
    );
    Ok(())
}
