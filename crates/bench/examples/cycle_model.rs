//! Fits the coefficients of the cycle estimate to measured images, and shows how far off it is.
//!
//! `cargo run --release -p cardan-bench --example cycle_model -- FILE=CYCLES...`, where FILE holds word
//! lengths and CYCLES is what `cardan build --wordlengths FILE` measured per solution. Ways that no
//! image takes keep their bundled coefficients: the fit is pulled towards those.

use cardan_bench::attitude::AttitudeDatapath;
use cardan_datapath::wordlengths::{align, parse};
use cardan_datapath::{Format, Node};
use cardan_firmware::calibration::NOMINAL;
use cardan_firmware::nodes::{Accumulator, NODES, Sample};
use cardan_spec::ThirdTilt;
use cardan_spec::timing::Averaging;
use cardan_tune::cost::{Coefficients, Cycles, counts};
use cardan_tune::{Case, Problem};
use nalgebra::{DMatrix, DVector};

/// Weight of the bundled coefficients: a coefficient that is off by its own size weighs as much as an
/// image that is off by this share.
const PULL: f64 = 0.05;

fn main() -> Result<(), String> {
    let problem = problem()?;
    let mut images = Vec::new();
    for argument in std::env::args().skip(1) {
        let (file, cycles) = argument.rsplit_once('=').ok_or("expected FILE=CYCLES")?;
        let cycles: f64 = cycles
            .parse()
            .map_err(|error| format!("{cycles}: {error}"))?;
        let formats = formats(file)?;
        let taken = counts(&problem, &problem.tuning[0].tape, &formats);
        images.push((file.to_owned(), taken, cycles));
    }
    let bundled = Coefficients::bundled()?.cycles;
    let fitted = fit(&bundled, &images)?;
    println!("image, measured, bundled, fitted");
    for (file, taken, cycles) in &images {
        let told = |estimate: f64| {
            format!(
                "{estimate:.0} ({:+.1} %)",
                100.0 * (estimate / cycles - 1.0)
            )
        };
        let fitted: f64 = fitted
            .iter()
            .zip(taken.to_array())
            .map(|(c, n)| c * n)
            .sum();
        println!(
            "{file}, {cycles:.0}, {}, {}",
            told(bundled.of(taken)),
            told(fitted)
        );
    }
    println!("coefficients in the order of the file:");
    let rounded: Vec<String> = fitted.iter().map(|value| format!("{value:.1}")).collect();
    println!("{}", rounded.join(" "));
    Ok(())
}

/// The data flow of the solution; inputs do not matter to it.
fn problem() -> Result<Problem, String> {
    let without_third_tilt = |at| [vec![400 + at; 64], vec![0]].concat();
    let steps: Vec<Vec<i32>> = (0..8).map(without_third_tilt).collect();
    let datapath = AttitudeDatapath {
        words: NOMINAL,
        averaging: Averaging::DEFAULT,
        third_tilt: ThirdTilt::Absent,
    };
    let case = Case::record("flow", &datapath, &steps);
    Ok(Problem {
        name: "attitude".to_owned(),
        nodes: NODES.to_vec(),
        background: vec![Sample::INDEX, Accumulator::INDEX],
        domain_flag: 0,
        quantities: Vec::new(),
        combined: Vec::new(),
        tuning: vec![case.map_err(|error| error.to_string())?],
        held_out: Vec::new(),
    })
}

fn formats(file: &str) -> Result<Vec<Format>, String> {
    let text = std::fs::read_to_string(file).map_err(|error| format!("{file}: {error}"))?;
    parse(&text, file)
        .and_then(|declared| align(&declared, &NODES, file))
        .map_err(|error| error.to_string())
}

/// Least squares of the relative errors, with the bundled coefficients as a further observation each.
fn fit(bundled: &Cycles, images: &[(String, Cycles, f64)]) -> Result<Vec<f64>, String> {
    let start = bundled.to_array();
    let rows = images.len() + Cycles::COUNT;
    let mut matrix = DMatrix::zeros(rows, Cycles::COUNT);
    let mut wanted = DVector::zeros(rows);
    for (row, (_, taken, cycles)) in images.iter().enumerate() {
        for (column, (count, start)) in taken.to_array().iter().zip(start).enumerate() {
            matrix[(row, column)] = count * start / cycles;
        }
        wanted[row] = 1.0;
    }
    for column in 0..Cycles::COUNT {
        matrix[(images.len() + column, column)] = PULL;
        wanted[images.len() + column] = PULL;
    }
    let factors = matrix.svd(true, true).solve(&wanted, 1e-12)?;
    Ok(factors
        .iter()
        .zip(start)
        .map(|(factor, start)| factor * start)
        .collect())
}
