//! Node operations per second of trials of the attitude datapath, beside the compiled firmware
//! arithmetic and, where `CARDAN_PYTHON` names a Python with it, apytypes on the same tape.
//!
//! `cargo run --release -p cardan-bench --example trial_speed [SOLUTIONS]`

use std::process::Command;
use std::time::Instant;

use cardan_bench::attitude::AttitudeDatapath;
use cardan_datapath::{DEFAULT_DOMAIN_FLAG, Deployed, Format, Overflow, Rounding, Silent};
use cardan_firmware::calibration::NOMINAL;
use cardan_firmware::nodes::NODES;
use cardan_numerics::tape::{Entry, Inputs, NO_NODE, Op, Ref, Tape};
use cardan_numerics::trial::Trial;
use cardan_numerics::{Algorithm, Steps};
use cardan_spec::ThirdTilt;
use cardan_spec::timing::Averaging;

fn solutions(count: usize) -> Vec<Vec<i32>> {
    let code = |at: usize, conversion: usize| {
        let phase = at as f64 / 90.0 + (conversion % 4) as f64 * 1.3;
        (512.0 + 300.0 * libm::sin(phase)) as i32 + (at * 7 + conversion) as i32 % 9
    };
    // No third tilt axis.
    let step = |at| {
        let codes = (0..64).map(|conversion| code(at, conversion));
        codes.chain([0]).collect()
    };
    (0..count).map(step).collect()
}

/// Best of some runs, in seconds.
fn best(mut run: impl FnMut()) -> f64 {
    let time = |_| {
        let begin = Instant::now();
        run();
        begin.elapsed().as_secs_f64()
    };
    (0..15).map(time).fold(f64::INFINITY, f64::min)
}

fn main() {
    let count = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let count = count.unwrap_or(4096);
    let datapath = AttitudeDatapath {
        words: NOMINAL,
        averaging: Averaging::DEFAULT,
        third_tilt: ThirdTilt::Absent,
    };
    let steps = solutions(count);
    let (tape, inputs) = Tape::record(&datapath, &steps).expect("is steady");
    let writes = |entry: &&Entry| entry.node != NO_NODE && entry.op.is_recorded();
    let per_step = tape.steady.iter().filter(writes).count();
    let total = (per_step * count) as f64;
    println!("{count} solutions of {per_step} node writes");

    let deployed: Vec<Format> = NODES.iter().map(|node| node.format).collect();
    // Every trial another format at the root: nothing is reused.
    let wide = |format: &Format| Format::new(32, format.frac, format.rounding, format.overflow);
    let sets = [
        ("deployed (16 and 32 bit)", deployed.clone()),
        ("all words 32 bit", deployed.iter().map(wide).collect()),
    ];
    for (name, formats) in sets {
        let mut trial = Trial::new(&tape, &inputs, DEFAULT_DOMAIN_FLAG);
        let mut flip = false;
        let seconds = best(|| {
            flip = !flip;
            let mut formats = formats.clone();
            for format in &mut formats {
                // Both give the same words where nothing overflows.
                format.overflow = if flip {
                    Overflow::Wrap
                } else {
                    Overflow::Saturate
                };
            }
            trial.run_all(&formats);
        });
        println!(
            "trial, {name}: {:.0} M node writes/s",
            total / seconds / 1e6
        );
    }
    let mut trial = Trial::new(&tape, &inputs, DEFAULT_DOMAIN_FLAG);
    trial.run_all(&deployed);
    let mut at = 0;
    let seconds = best(|| {
        let mut formats = deployed.clone();
        at = (at + 1) % formats.len();
        formats[at].rounding = Rounding::NearestEven;
        trial.run_all(&formats);
    });
    println!(
        "trial, one node changed: {:.0} M node writes/s",
        total / seconds / 1e6
    );

    on_all_cores(&tape, &inputs, &deployed, total);

    let algorithm = Steps {
        datapath: &datapath,
        inputs: &steps,
    };
    let seconds = best(|| {
        std::hint::black_box(algorithm.run(&Deployed::new(Silent)));
    });
    println!(
        "compiled `Deployed`: {:.0} M node writes/s",
        total / seconds / 1e6
    );
    apytypes(&tape, count);
}

/// What a search does: a trial per core, one node changed between any two runs.
fn on_all_cores(tape: &Tape, inputs: &Inputs, deployed: &[Format], total: f64) {
    const RUNS: usize = 40;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let work = |first: usize| {
        let mut trial = Trial::new(tape, inputs, DEFAULT_DOMAIN_FLAG);
        for run in 0..RUNS {
            let mut formats = deployed.to_vec();
            let at = (first + run) % formats.len();
            formats[at].rounding = Rounding::NearestEven;
            trial.run_all(&formats);
        }
    };
    let seconds = best(|| {
        std::thread::scope(|scope| {
            for core in 0..cores {
                scope.spawn(move || work(core * RUNS));
            }
        });
    });
    println!(
        "trials, one node changed, {cores} cores: {:.0} M node writes/s",
        total * (cores * RUNS) as f64 / seconds / 1e6
    );
}

/// An operation as words: its node, its name, its operands' numbers or its constant.
fn line(entry: &Entry, base: usize) -> String {
    let number = |operand: Ref| match operand {
        Ref::Before(index) => index as usize,
        Ref::Here(index) | Ref::Ago { index, .. } => base + index as usize,
    };
    let words = match entry.op.map(number) {
        Op::Input { frac, .. } => format!("input {frac}"),
        Op::Parameter { raw, frac } => format!("constant {}", libm::ldexp(raw.into(), -frac)),
        Op::Constant(value) => format!("constant {value}"),
        Op::Add(a, b) => format!("add {a} {b}"),
        Op::Sub(a, b) => format!("sub {a} {b}"),
        Op::Mul(a, b) => format!("mul {a} {b}"),
        Op::Div(a, b) => format!("div {a} {b}"),
        Op::Shift(a, power) => format!("shift {a} {power}"),
        Op::Neg(a) => format!("neg {a}"),
        Op::Abs(a) => format!("abs {a}"),
        Op::Select(_, a, b) => format!("select {a} {b}"),
        Op::Sqrt(a) => format!("sqrt {a}"),
        _ => "truth".to_owned(),
    };
    format!("op {} {words}", entry.node.cast_signed())
}

/// Times apytypes on arrays of as many lanes, operation by operation, in the same formats.
fn apytypes(tape: &Tape, count: usize) {
    let Some(python) = std::env::var_os("CARDAN_PYTHON") else {
        println!("apytypes: not timed, CARDAN_PYTHON names no Python");
        return;
    };
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/apytypes_speed.py");
    let mut lines = vec![count.to_string()];
    for node in &NODES {
        let f = node.format;
        lines.push(format!(
            "node {} {} {} {}",
            f.word,
            f.frac,
            f.rounding.name(),
            f.overflow.name()
        ));
    }
    let all = tape.before.iter().map(|entry| (entry, 0));
    let base = tape.before.len();
    let steady = tape.steady.iter().map(|entry| (entry, base));
    for (entry, base) in all.chain(steady) {
        lines.push(line(entry, base));
    }
    let file = std::env::temp_dir().join(format!("cardan-tape-{}.txt", std::process::id()));
    std::fs::write(&file, lines.join("\n")).expect("temporary file");
    let output = Command::new(python).arg(script).arg(&file).output();
    let _ = std::fs::remove_file(&file);
    match output {
        Ok(output) => print!(
            "{}{}",
            String::from_utf8_lossy(&output.stdout),
            String::from_utf8_lossy(&output.stderr)
        ),
        Err(error) => println!("apytypes: {error}"),
    }
}
