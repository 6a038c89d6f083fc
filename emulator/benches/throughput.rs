//! Throughput against simavr: medians of alternating runs of the same programs.
//!
//! `cargo bench -p cardan-emulator [-- RUNS]` prints simulated megacycles per host second. Needs
//! gcc, gcc-avr, avr-libc and libsimavr-dev; timings are for people, nothing passes or fails.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use cardan_emulator::{ATMEGA328P, Image, Machine, Unconnected};

/// Program and cycles per run.
const PROGRAMS: [(&str, u64); 4] = [
    ("sieve", 200_000_000),
    ("cordic", 200_000_000),
    ("interrupts", 200_000_000),
    ("sleeper", 1_000_000_000),
];

fn main() -> Result<(), Box<dyn Error>> {
    // `cargo bench` passes flags of its own; the first number is ours.
    let runs = std::env::args()
        .find_map(|text| text.parse().ok())
        .unwrap_or(5usize);
    let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches");
    let scratch = tempfile::tempdir()?;
    let simavr = scratch.path().join("simavr_run");
    tool(
        "gcc",
        &[
            "-O2",
            "-o",
            text(&simavr),
            text(&home.join("simavr_run.c")),
            "-lsimavr",
        ],
    )?;
    println!(
        "{:12} {:>10} {:>10} {:>7}   (Mcycles/s, median of {runs})",
        "program", "cardan", "simavr", "ratio"
    );
    for (name, cycles) in PROGRAMS {
        let (elf, binary) = build(&home, scratch.path(), name)?;
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for _ in 0..runs {
            ours.push(run_ours(&elf, cycles)?);
            theirs.push(run_simavr(&simavr, &binary, cycles)?);
        }
        let (ours, theirs) = (median(ours), median(theirs));
        println!("{name:12} {ours:10.1} {theirs:10.1} {:7.2}", ours / theirs);
    }
    Ok(())
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap_or_default()
}

fn tool(program: &str, arguments: &[&str]) -> Result<String, Box<dyn Error>> {
    let output = Command::new(program).args(arguments).output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned().into());
    }
    Ok(String::from_utf8(output.stdout)?)
}

fn build(home: &Path, scratch: &Path, name: &str) -> Result<(PathBuf, PathBuf), Box<dyn Error>> {
    let source = home.join("programs").join(format!("{name}.c"));
    let (elf, binary) = (
        scratch.join(format!("{name}.elf")),
        scratch.join(format!("{name}.bin")),
    );
    let flags = [
        "-mmcu=atmega328p",
        "-DF_CPU=16000000UL",
        "-Os",
        "-std=gnu99",
        "-o",
    ];
    let mut arguments = flags.to_vec();
    arguments.extend([text(&elf), text(&source)]);
    tool("avr-gcc", &arguments)?;
    tool("avr-objcopy", &["-O", "binary", text(&elf), text(&binary)])?;
    Ok((elf, binary))
}

/// Megacycles per second of one run, loading included.
fn run_ours(elf: &Path, cycles: u64) -> Result<f64, Box<dyn Error>> {
    let begin = Instant::now();
    let image = Image::read(elf, &ATMEGA328P)?;
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    let stop = machine.run(&mut Unconnected, cycles);
    let seconds = begin.elapsed().as_secs_f64();
    if machine.cycle() < cycles {
        return Err(format!("ended early: {stop:?}").into());
    }
    Ok(machine.cycle() as f64 / 1e6 / seconds)
}

fn run_simavr(program: &Path, binary: &Path, cycles: u64) -> Result<f64, Box<dyn Error>> {
    let answer = tool(text(program), &[text(binary), &cycles.to_string()])?;
    let mut numbers = answer.split_whitespace();
    let seconds: f64 = numbers.next().ok_or("no time")?.parse()?;
    let done: f64 = numbers.next().ok_or("no cycles")?.parse()?;
    Ok(done / 1e6 / seconds)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
