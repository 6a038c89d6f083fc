//! Throughput of both engines against simavr and QEMU: medians of alternating runs of the same
//! programs.
//!
//! `cargo bench -p cardan-translator [-- RUNS]` prints simulated megacycles per host second. Needs
//! gcc, gcc-avr, avr-libc and libsimavr-dev, and shows QEMU where `qemu-system-avr` (Debian:
//! qemu-system-misc) is installed. QEMU counts no cycles and its timers follow the host's clock: its
//! figure is the cycles that the chip needs for the same rounds of a program, by the host time from
//! QEMU's start to its answer. simavr does not trigger conversions by a timer, so it cannot run the
//! reference firmware. Timings are for people, nothing passes or fails.

use std::error::Error;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use cardan_emulator::engine::{Engine, Interpreter};
use cardan_emulator::{ATMEGA328P, Environment, Image, Machine, Unconnected};
use cardan_translator::Translator;

/// Program, cycles per run, and rounds of it for QEMU.
const PROGRAMS: [(&str, u64, Option<u32>); 4] = [
    ("sieve", 400_000_000, Some(2_000)),
    ("cordic", 400_000_000, Some(80_000)),
    ("interrupts", 400_000_000, None),
    ("sleeper", 1_000_000_000, None),
];
const FIRMWARE_CYCLES: u64 = 1_000_000_000;

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> Outcome<()> {
    // `cargo bench` passes flags of its own; the first number is ours.
    let runs = std::env::args()
        .find_map(|text| text.parse().ok())
        .unwrap_or(5usize);
    let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches");
    let scratch = tempfile::tempdir()?;
    let simavr = scratch.path().join("simavr_run");
    let source = home.join("simavr_run.c");
    tool(
        "gcc",
        &["-O2", "-o", text(&simavr), text(&source), "-lsimavr"],
    )?;
    let has_qemu = tool("qemu-system-avr", &["--version"]).is_ok();
    println!("Mcycles/s, median of {runs} alternating runs");
    println!(
        "{:12} {:>11} {:>11} {:>9} {:>9}",
        "program", "interpreter", "translator", "simavr", "QEMU"
    );
    for (name, cycles, rounds) in PROGRAMS {
        let (elf, binary) = build(&home, scratch.path(), name, None)?;
        let rounds = rounds.filter(|_| has_qemu);
        let in_rounds = rounds
            .map(|rounds| build(&home, scratch.path(), name, Some(rounds)))
            .transpose()?;
        let mut figures = [const { Vec::new() }; 4];
        for _ in 0..runs {
            let [interpreter, translator, peer, qemu] = &mut figures;
            interpreter.push(run_ours(&elf, cycles, &mut Interpreter)?);
            translator.extend(run_translator(&elf, cycles)?);
            peer.push(run_simavr(&simavr, &binary, cycles)?);
            if let Some((elf, _)) = &in_rounds {
                qemu.push(run_qemu(elf)?);
            }
        }
        print_row(name, figures);
    }
    let firmware = home.join("../../../firmware/boards/atmega328p/images/plain.elf");
    let mut figures = [const { Vec::new() }; 4];
    for _ in 0..runs {
        let [interpreter, translator, ..] = &mut figures;
        interpreter.push(run_ours(&firmware, FIRMWARE_CYCLES, &mut Interpreter)?);
        translator.extend(run_translator(&firmware, FIRMWARE_CYCLES)?);
    }
    print_row("firmware", figures);
    Ok(())
}

fn print_row(name: &str, figures: [Vec<f64>; 4]) {
    let [interpreter, translator, simavr, qemu] = figures.map(|values| match median(values) {
        Some(value) => format!("{value:.0}"),
        None => "-".to_owned(),
    });
    println!("{name:12} {interpreter:>11} {translator:>11} {simavr:>9} {qemu:>9}");
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap_or_default()
}

fn tool(program: &str, arguments: &[&str]) -> Outcome<String> {
    let output = Command::new(program).args(arguments).output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned().into());
    }
    Ok(String::from_utf8(output.stdout)?)
}

/// ELF and binary of a program, endless or with so many rounds.
fn build(
    home: &Path,
    scratch: &Path,
    name: &str,
    rounds: Option<u32>,
) -> Outcome<(PathBuf, PathBuf)> {
    let source = home.join("programs").join(format!("{name}.c"));
    let stem = rounds.map_or(name.to_owned(), |_| format!("{name}_rounds"));
    let elf = scratch.join(format!("{stem}.elf"));
    let binary = scratch.join(format!("{stem}.bin"));
    let rounds = rounds.map_or("-UROUNDS".to_owned(), |rounds| format!("-DROUNDS={rounds}"));
    let arguments = [
        "-mmcu=atmega328p",
        "-DF_CPU=16000000UL",
        "-Os",
        "-std=gnu99",
        &rounds,
        "-o",
        text(&elf),
        text(&source),
    ];
    tool("avr-gcc", &arguments)?;
    tool("avr-objcopy", &["-O", "binary", text(&elf), text(&binary)])?;
    Ok((elf, binary))
}

/// Megacycles per second of one run, loading included.
fn run_ours<G: Engine>(elf: &Path, cycles: u64, engine: &mut G) -> Outcome<f64> {
    let begin = Instant::now();
    let image = Image::read(elf, &ATMEGA328P)?;
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    let stop = machine.run_with(engine, &mut Unconnected, cycles);
    let seconds = begin.elapsed().as_secs_f64();
    if machine.cycle() < cycles {
        return Err(format!("ended early: {stop:?}").into());
    }
    Ok(machine.cycle() as f64 / 1e6 / seconds)
}

/// The same with a fresh translator, if this host has one: translating is part of the time.
fn run_translator(elf: &Path, cycles: u64) -> Outcome<Option<f64>> {
    Translator::new()
        .map(|mut engine| run_ours(elf, cycles, &mut engine))
        .transpose()
}

fn run_simavr(program: &Path, binary: &Path, cycles: u64) -> Outcome<f64> {
    let answer = tool(text(program), &[text(binary), &cycles.to_string()])?;
    let mut numbers = answer.split_whitespace();
    let seconds: f64 = numbers.next().ok_or("no time")?.parse()?;
    let done: f64 = numbers.next().ok_or("no cycles")?.parse()?;
    Ok(done / 1e6 / seconds)
}

/// Notes when the first byte is sent, and stops there.
#[derive(Default)]
struct Answer(Option<u64>);

impl Environment for Answer {
    fn uart_tx(&mut self, cycle: u64, _byte: u8) {
        self.0.get_or_insert(cycle);
    }

    fn stop_requested(&self) -> bool {
        self.0.is_some()
    }
}

fn run_qemu(elf: &Path) -> Outcome<f64> {
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&Image::read(elf, &ATMEGA328P)?);
    let mut answer = Answer::default();
    match Translator::new() {
        Some(mut engine) => machine.run_with(&mut engine, &mut answer, u64::MAX),
        None => machine.run(&mut answer, u64::MAX),
    };
    let cycles = answer.0.ok_or("the program sends nothing")?;
    let begin = Instant::now();
    let mut qemu = Command::new("qemu-system-avr")
        .args([
            "-M",
            "uno",
            "-nographic",
            "-monitor",
            "none",
            "-serial",
            "stdio",
            "-bios",
        ])
        .arg(elf)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()?;
    let mut byte = [0];
    let read = qemu
        .stdout
        .take()
        .map(|mut line| line.read_exact(&mut byte));
    let seconds = begin.elapsed().as_secs_f64();
    qemu.kill()?;
    qemu.wait()?;
    read.ok_or("no output of QEMU")??;
    Ok(cycles as f64 / 1e6 / seconds)
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
