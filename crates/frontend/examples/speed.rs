//! Host time per simulated second of the four channels at the full event rate of the reference
//! firmware, noise off and on: `cargo run --release -p cardan-frontend --example speed`.

use std::sync::Arc;
use std::time::Instant;

use cardan_frontend::design::nominal_edges;
use cardan_frontend::{AdcErrors, Frontend};
use cardan_scenario::{Scenario, Stimulus, Trajectory};
use cardan_spec::Channel;
use cardan_spec::timing::{ADC_HOLD_CYCLES, CONVERSION_CYCLES, CPU_HZ, HALF_CARRIER_CYCLES};
use cardan_units::Cycles;

const SECONDS: u64 = 5;
/// Runs of the board: on a shared machine the shortest counts.
const REPEATS: u32 = 5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for name in ["tumble-quiet", "tumble"] {
        let scenario = Scenario::load(name)?;
        let trajectory = Arc::new(Trajectory::new(&scenario, 1)?);
        let started = Instant::now();
        let mut sum = 0.0;
        for period in 0..SECONDS * CPU_HZ / (2 * HALF_CARRIER_CYCLES) {
            sum += trajectory.at(period as f64 * 62.5e-6).field_ut[0];
        }
        report(name, "stimulus alone", started, sum);
        let started = Instant::now();
        let board = Frontend::new(&scenario, 1, Arc::clone(&trajectory))?;
        report(name, "set-up (x5)", started, board.design().group_delay_s());
        for _ in 0..REPEATS {
            let mut board = board.clone();
            let started = Instant::now();
            let sum = run(&mut board)?;
            report(name, "board", started, sum);
        }
        let adc = AdcErrors::new(&scenario, 1);
        let started = Instant::now();
        let mut sum = 0.0;
        for sequence in 0..SECONDS * CPU_HZ / CONVERSION_CYCLES {
            sum += adc.apply(cardan_units::Volts(2.5), sequence).0;
        }
        report(name, "converter errors", started, sum);
    }
    Ok(())
}

fn run<S: Stimulus>(board: &mut Frontend<S>) -> Result<f64, cardan_frontend::Error> {
    let mut sum = 0.0;
    let mut conversion = 0;
    for edge in nominal_edges().take_while(|edge| edge.cycle <= SECONDS * CPU_HZ) {
        let hold = conversion * CONVERSION_CYCLES + ADC_HOLD_CYCLES;
        if hold <= edge.cycle {
            let channel = Channel::ALL[conversion as usize % Channel::ALL.len()];
            sum += board.voltage(Cycles(hold), channel)?.0;
            conversion += 1;
        }
        board.pin_edge(Cycles(edge.cycle), edge.pin, edge.high)?;
    }
    Ok(sum)
}

fn report(scenario: &str, part: &str, started: Instant, checksum: f64) {
    let ms = started.elapsed().as_secs_f64() * 1e3 / SECONDS as f64;
    println!(
        "{scenario:13} {part:17} {ms:8.3} ms per simulated second (checksum {:016x})",
        checksum.to_bits()
    );
}
