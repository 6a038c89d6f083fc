//! `run`: executes any AVR program in the emulator, as a peer's simulator would.

mod desk;
mod engine;
mod gdb;
mod interrupt;
mod profile;
mod profile_files;
mod profile_text;
mod program;
mod pty;
mod serial;
mod signals;
mod standard_input;
mod summary;
mod waveform;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use cardan_emulator::{Device, Machine, Observers, Profile, Stimulus, Stop, Supply, Watch};
use clap::Args;

use self::desk::Desk;
use self::engine::{Chosen, EngineName};
use self::profile_files::Folder;
use self::program::Program;
use self::serial::{Choice, Line};
use self::summary::Summary;
use self::waveform::Waveform;
use crate::failure::{Done, Failure, code};
use crate::files::{self, Plan};
use crate::output::Output;

/// Slowest clock accepted, in hertz.
const SLOWEST_HZ: u64 = 1;
/// Fastest clock of the family, in hertz (data sheet DS40002061, section 29.3, speed grades).
const FASTEST_HZ: u64 = 20_000_000;
/// Supply range of the family, in volts (data sheet, section 29.2).
const SUPPLY_VOLTS: std::ops::RangeInclusive<f64> = 1.8..=5.5;
/// Lowest reference voltage, in volts (data sheet, section 29.8, ADC characteristics).
const LEAST_REFERENCE_VOLTS: f64 = 1.0;
/// Parts of a second that the emulator runs between two looks at the host's side of the line.
const SLICES_PER_SECOND: u64 = 100;

/// Runs an AVR program (ELF or Intel HEX) in the emulator, cycle by cycle.
///
/// The run ends when the program does: at SLEEP with interrupts disabled, at BREAK, at a jump to
/// itself with interrupts disabled (where `main` of a C program ends), at a crash, or after
/// `--cycles`. With `--cycles` a jump to itself does not end the run: peripherals go on there, a PWM
/// output for example. Without it a program that never ends runs until it is interrupted (Ctrl-C).
#[derive(Args)]
pub(crate) struct Arguments {
    /// Program: ELF file or Intel HEX text.
    file: PathBuf,
    /// Microcontroller.
    #[arg(long, value_name = "NAME", default_value = "atmega328p", value_parser = device)]
    mcu: &'static Device,
    /// Clock of the oscillator in hertz, at most 20000000.
    #[arg(long, value_name = "HZ", default_value_t = 16_000_000, value_parser = frequency,
        allow_negative_numbers = true)]
    freq: u64,
    /// Stops after this number of cycles, and not before at a jump to itself with interrupts
    /// disabled, unless `--program-exit` is given [default: no limit].
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    cycles: Option<u64>,
    /// Where the serial line leads: `stdio` (sends to standard output, receives from standard
    /// input), `pty` (a terminal device for any serial program; the run then keeps real time),
    /// `none`, or a file for what is sent [default: to standard output, nothing received].
    #[arg(long, value_name = "stdio|pty|none|FILE")]
    uart: Option<Choice>,
    /// Supply: AVCC, and AREF unless `--aref` is given, in volts.
    #[arg(long, value_name = "V", default_value_t = 5.0, value_parser = supply,
        allow_negative_numbers = true)]
    vcc: f64,
    /// Voltage that the board applies to pin AREF, in volts: the converter's reference where a
    /// program selects it (REFS = 0). From 1 V to the supply [default: that of `--vcc`].
    #[arg(long, value_name = "V", value_parser = reference, allow_negative_numbers = true)]
    aref: Option<f64>,
    /// Voltage of an analog input, CH 0 to 7; may be repeated. Others read 0 V.
    #[arg(long, value_name = "CH=VOLTS", value_parser = analog)]
    adc: Vec<(u8, f64)>,
    /// Voltages and pin levels over time: CSV with `cycle` or `t_s` first, then `adc0_V`..`adc7_V`
    /// (volts) or `PB0`..`PD7` (0 or 1); or a value change dump with those signals. Each value
    /// holds until the next.
    #[arg(long, value_name = "FILE")]
    stimulus: Option<PathBuf>,
    /// Writes the levels of all pins, or what `--vcd-signal` names, as a value change dump for
    /// waveform viewers such as GTKWave. Its unit is 1 ps: each change is rounded once, from its
    /// cycle to that. The dump can be the `--stimulus` of another run.
    #[arg(long, value_name = "FILE")]
    vcd: Option<PathBuf>,
    /// What the dump shows instead of all pins; may be repeated. Pins (PB0), voltages when they are
    /// held (adc0_V), r0 to r31, sreg, sp, pc, I/O registers that keep what is written (OCR1A),
    /// variables by their name, with a type where it is needed (`count`, `count:i16`, `table:u8`),
    /// and addresses (@0x0123:u16). Each store is shown at its own cycle; that takes time.
    #[arg(long, value_name = "NAME", requires = "vcd", conflicts_with = "gdb")]
    vcd_signal: Vec<String>,
    /// Waits for a debugger such as `avr-gdb` at HOST:PORT, or at a port of this machine (0 picks
    /// one and says which), and lets it steer the run. The run ends with the debugger, unless that
    /// detaches.
    #[arg(long, value_name = "ADDR")]
    gdb: Option<gdb::Address>,
    /// Counts where the cycles go and shows it at the end, on standard error: functions, source
    /// lines (programs compiled with -gdwarf-4), interrupts, load, deepest stack, memory. Counting
    /// changes nothing in the program's time. With `--json` it is all in the document, as `profile`.
    #[arg(long, conflicts_with = "gdb")]
    profile: bool,
    /// Profiles, and writes into this folder: `profile.json`, `lcov.info` (line coverage for
    /// `genhtml`; only with source lines), `folded.txt` (call paths for flame graphs) and
    /// `listing.txt` (every instruction with its count and cycles).
    #[arg(long, value_name = "DIR", conflicts_with = "gdb")]
    profile_out: Option<PathBuf>,
    /// What executes the instructions: the interpreter (`interp`) or the translator to host code
    /// (`jit`). Results are the same, bit for bit and cycle for cycle. Without the option the
    /// translator is taken where there is one for this host; it translates only what is hot. Where
    /// a debugger has set traps, or each instruction is looked at (`--profile`, `--vcd-signal`), the
    /// interpreter executes either way.
    #[arg(long, value_name = "NAME")]
    engine: Option<EngineName>,
    /// Exits with the program's own code, register r24 (the low byte of what `main` returned),
    /// when it ends by itself; with 3 when the cycle limit comes first.
    #[arg(long)]
    program_exit: bool,
}

/// Runs the command.
pub(crate) fn execute(arguments: &Arguments, output: Output) -> Done {
    files(arguments).check()?;
    let program = Program::read(&arguments.file, arguments.mcu)?;
    let mut machine = machine(arguments, &program)?;
    let mut desk = Desk::new(connections(arguments)?);
    let port = arguments.gdb.as_ref().map(gdb::Port::open).transpose()?;
    let mut line = Line::open(arguments.uart.as_ref(), arguments.freq, output)?;
    desk.waveform = waveform(arguments, &program)?;
    let mut watch = desk.waveform.as_mut().and_then(|waveform| {
        let watched = waveform.watched();
        let watch = (!watched.is_empty()).then(|| Watch::new(watched, &machine));
        waveform.begin(watch.as_ref());
        watch
    });
    let folder = arguments.profile_out.as_deref().map(Folder::create);
    let folder = folder.transpose()?;
    let is_profiling = arguments.profile || folder.is_some();
    let mut profile = is_profiling.then(|| Profile::new(program.symbols(), &machine));
    if port.is_none() {
        interrupt::listen();
    }
    let begin = Instant::now();
    let observers = Observers {
        profile: profile.as_mut(),
        watch: watch.as_mut(),
    };
    let mut engine = Chosen::new(arguments.engine, !observers.are_none())?;
    let limit = arguments.cycles.unwrap_or(u64::MAX);
    let mut early_stop = None;
    let mut is_lost = false;
    if let Some(port) = port {
        let left = port.serve(machine, desk, &mut line, limit)?;
        (machine, desk) = (left.machine, left.desk);
        (early_stop, is_lost) = (left.stop, left.is_lost);
    }
    let stop = match early_stop {
        Some(stop) => stop,
        None => run(
            &mut machine,
            &mut engine,
            &mut desk,
            &mut line,
            limit,
            observers,
        )?,
    };
    let host_seconds = begin.elapsed().as_secs_f64();
    line.close(&mut desk)?;
    if let Some(waveform) = desk.waveform.take() {
        waveform.finish(machine.cycle(), watch.as_mut())?;
    }
    let profile = profile.map(|profile| profile.report(&machine, program.symbols()));
    let document = profile
        .as_ref()
        .map(|report| program.profile(report, &machine));
    if let (Some(folder), Some(report), Some(document)) = (&folder, &profile, &document) {
        folder.write(document, report, &machine, program.symbols())?;
    }
    let summary = Summary::new(
        &machine,
        engine.name(),
        &stop,
        host_seconds,
        &program,
        document,
    );
    if output.is_json() {
        output.document(&summary)?;
    }
    for report in summary.reports() {
        output.note(&format!("note: {report}"));
    }
    if let Stop::Crash(crash) = &stop {
        let place = program.place(crash.pc);
        output.error(&format!(
            "{}: crash {crash}{place}",
            arguments.file.display()
        ));
    }
    if let Some(profile) = summary.profile() {
        output.note(&profile.to_string());
    }
    output.note(&summary.to_string());
    interrupt::end_as_asked();
    if is_lost {
        output.error(&"--gdb: the debugger is gone; the run ended where it stood");
        return Ok(ExitCode::from(code::PARTICIPANT));
    }
    Ok(exit_code(&stop, &machine, arguments.program_exit))
}

/// What is read and written.
fn files(arguments: &Arguments) -> Plan {
    let serial = match &arguments.uart {
        Some(Choice::File(file)) => Some(file.as_path()),
        _ => None,
    };
    Plan::default()
        .input("FILE", Some(&arguments.file))
        .input("--stimulus", arguments.stimulus.as_deref())
        .output("--vcd", arguments.vcd.as_deref())
        .output("--uart", serial)
        .folder(
            "--profile-out",
            arguments.profile_out.as_deref(),
            &Folder::FILES,
        )
}

/// The chip with the program in it.
fn machine(arguments: &Arguments, program: &Program) -> Result<Machine, Failure> {
    let (avcc_volts, aref_volts) = (arguments.vcc, arguments.aref.unwrap_or(arguments.vcc));
    if aref_volts > avcc_volts {
        return Err(Failure::input(format!(
            "--aref {aref_volts}: above the supply of {avcc_volts} V; lower it, or raise --vcc"
        )));
    }
    let mut machine = Machine::new(arguments.mcu, arguments.freq);
    machine.set_supply(Supply {
        avcc_volts,
        aref_volts,
        ..Supply::default()
    });
    machine.set_end_at_halt(arguments.cycles.is_none() || arguments.program_exit);
    machine.load(program.image());
    Ok(machine)
}

/// The dump that `--vcd` asks for.
fn waveform(arguments: &Arguments, program: &Program) -> Result<Option<Waveform>, Failure> {
    let Some(file) = &arguments.vcd else {
        return Ok(None);
    };
    let signals = match &arguments.vcd_signal[..] {
        [] => signals::pins(),
        names => signals::named(names, program.image(), arguments.mcu).map_err(Failure::input)?,
    };
    Waveform::create(file, arguments.freq, signals).map(Some)
}

/// Reads a stimulus file.
fn stimulus(file: &Path, hz: u64) -> Result<Stimulus, Failure> {
    let name = file.display().to_string();
    let text = files::read(file)?;
    Stimulus::parse(&name, &text, hz).map_err(Failure::input)
}

/// What is connected to the pins: constant voltages, and what the stimulus file brings.
fn connections(arguments: &Arguments) -> Result<Stimulus, Failure> {
    let mut stimulus = match &arguments.stimulus {
        Some(file) => stimulus(file, arguments.freq)?,
        None => Stimulus::default(),
    };
    let mut seen = [false; 8];
    for &(channel, volts) in &arguments.adc {
        let is_repeated = std::mem::replace(&mut seen[usize::from(channel)], true);
        if is_repeated {
            let what = format!("--adc {channel}=... is given twice; expected one per channel");
            return Err(Failure::input(what));
        }
        if !stimulus.start_analog(channel, volts) {
            let file = arguments.stimulus.as_deref().unwrap_or(Path::new(""));
            return Err(Failure::input(format!(
                "--adc {channel}={volts}: {} drives adc{channel}_V as well; remove one of the two",
                file.display()
            )));
        }
    }
    Ok(stimulus)
}

/// Runs in slices, between which bytes go to and come from the host.
fn run(
    machine: &mut Machine,
    engine: &mut Chosen,
    desk: &mut Desk,
    line: &mut Line,
    limit: u64,
    mut observers: Observers<'_>,
) -> Result<Stop, Failure> {
    loop {
        let until = slice_end(machine, limit);
        let stop = if observers.are_none() {
            engine.run(machine, desk, until)
        } else {
            machine.run_observed(desk, until, &mut observers)
        };
        line.exchange(desk, machine.cycle())?;
        if let Some(waveform) = &mut desk.waveform {
            waveform.take(observers.watch.as_deref_mut());
            waveform.check()?;
        }
        let is_over = stop != Stop::Limit || machine.cycle() >= limit;
        if is_over || desk.is_closed || interrupt::came() {
            return Ok(stop);
        }
    }
}

/// The cycle at which the slice that begins now ends.
fn slice_end(machine: &Machine, limit: u64) -> u64 {
    let slice = (machine.frequency_hz() / SLICES_PER_SECOND).max(1);
    machine.cycle().saturating_add(slice).min(limit)
}

/// The exit code: 0, or 4 after a crash, or with `--program-exit` the program's own.
fn exit_code(stop: &Stop, machine: &Machine, is_programs: bool) -> ExitCode {
    match stop {
        Stop::Crash(_) => ExitCode::from(code::CRASH),
        Stop::Sleep | Stop::Break | Stop::Halt if is_programs => {
            ExitCode::from(machine.registers()[24])
        }
        Stop::Limit if is_programs => ExitCode::from(code::PARTICIPANT),
        _ => ExitCode::SUCCESS,
    }
}

fn device(name: &str) -> Result<&'static Device, String> {
    Device::by_name(name).ok_or_else(|| {
        let known: Vec<&str> = Device::ALL
            .iter()
            .flat_map(|device| std::iter::once(&device.name).chain(device.aliases))
            .copied()
            .collect();
        format!(
            "unknown microcontroller; expected one of {}",
            known.join(", ")
        )
    })
}

fn frequency(text: &str) -> Result<u64, String> {
    let hz = text.parse::<u64>().ok();
    hz.filter(|hz| (SLOWEST_HZ..=FASTEST_HZ).contains(hz))
        .ok_or_else(|| format!("expected whole hertz from {SLOWEST_HZ} to {FASTEST_HZ}"))
}

fn supply(text: &str) -> Result<f64, String> {
    let volts = text.parse::<f64>().ok();
    volts
        .filter(|volts| SUPPLY_VOLTS.contains(volts))
        .ok_or_else(|| {
            let (least, most) = (SUPPLY_VOLTS.start(), SUPPLY_VOLTS.end());
            format!("expected volts from {least} to {most}, the supply range of the chip")
        })
}

fn reference(text: &str) -> Result<f64, String> {
    let volts = text.parse::<f64>().ok();
    volts
        .filter(|volts| (LEAST_REFERENCE_VOLTS..=*SUPPLY_VOLTS.end()).contains(volts))
        .ok_or_else(|| {
            format!("expected volts from {LEAST_REFERENCE_VOLTS} to the supply, see --vcc")
        })
}

fn analog(text: &str) -> Result<(u8, f64), String> {
    let expected = || "expected CH=VOLTS, for example 0=2.5, with CH from 0 to 7".to_owned();
    let (channel, volts) = text.split_once('=').ok_or_else(expected)?;
    let channel = channel.parse().ok().filter(|&channel: &u8| channel < 8);
    let volts = volts.parse().ok().filter(|volts: &f64| volts.is_finite());
    channel.zip(volts).ok_or_else(expected)
}
