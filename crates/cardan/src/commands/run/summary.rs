//! What a run came to, for programs and for people.

use std::collections::BTreeMap;
use std::fmt;

use cardan_emulator::{InterruptDamage, Machine, Pin, Report, ReportKind, Statistics, Stop};
use serde::Serialize;

use super::profile::Document;
use super::program::Program;

/// The JSON document of `run` (contract).
#[derive(Serialize)]
pub(super) struct Summary {
    mcu: &'static str,
    cycles: u64,
    instructions: u64,
    stop: &'static str,
    /// Byte address.
    pc: u32,
    sp: u16,
    sreg: u8,
    registers: Vec<u8>,
    uart0_bytes: u64,
    host_seconds: f64,
    mcycles_per_second: Option<f64>,
    /// What executed the instructions: `interp` or `jit`.
    engine: &'static str,
    /// Cycles spent asleep.
    sleeping_cycles: u64,
    /// Times that SLEEP put the processor to sleep.
    sleeps: u64,
    /// Interrupts that were taken.
    interrupts: Vec<Interrupt>,
    /// Changes of level that the chip has driven, for each pin that had one.
    pin_edges: BTreeMap<String, u64>,
    /// Bytes of the stack at its deepest.
    stack_peak: u16,
    crash: Option<Crash>,
    /// Odd accesses, each place once, and interrupts that do damage, each vector once.
    reports: Vec<String>,
    /// Interrupts that returned with other registers or another SREG than they found.
    interrupt_damage: Vec<Damage>,
    /// With `--profile`.
    #[serde(skip_serializing_if = "Option::is_none")]
    profile: Option<Document>,
}

/// One vector's interrupts.
#[derive(Serialize)]
struct Interrupt {
    vector: &'static str,
    count: u64,
    /// Cycles from the request to the entry, at worst.
    latency_max: u64,
    /// Returns to what was interrupted, whose registers were compared.
    returns: u64,
    /// Returns among them that left other registers or another SREG.
    damaged: u64,
}

/// The first time that an interrupt did damage.
#[derive(Serialize)]
struct Damage {
    vector: &'static str,
    count: u64,
    /// The RETI.
    #[serde(flatten)]
    place: Place,
    /// Byte address of the interrupted instruction.
    interrupted_pc: u32,
    entry_cycle: u64,
    cycle: u64,
    registers: Vec<Changed>,
    sreg_before: u8,
    sreg_after: u8,
}

/// A register's value before and after an interrupt.
#[derive(Serialize)]
struct Changed {
    register: u8,
    before: u8,
    after: u8,
}

/// A place of the program, as far as its file names it.
#[derive(Serialize)]
struct Place {
    pc: u32,
    function: Option<String>,
    file: Option<String>,
    line: Option<u32>,
}

/// Where and why the program crashed.
#[derive(Serialize)]
struct Crash {
    #[serde(flatten)]
    place: Place,
    instruction: String,
    cause: String,
}

impl Summary {
    /// The state of `machine` after `stop`.
    pub(super) fn new(
        machine: &Machine,
        engine: &'static str,
        stop: &Stop,
        host_seconds: f64,
        program: &Program,
        profile: Option<Document>,
    ) -> Self {
        let statistics = machine.statistics();
        let rate = statistics.cycles as f64 / 1e6 / host_seconds;
        Self {
            mcu: machine.device().name,
            cycles: statistics.cycles,
            instructions: statistics.instructions,
            stop: name(stop),
            pc: machine.pc(),
            sp: machine.sp(),
            sreg: machine.sreg(),
            registers: machine.registers().to_vec(),
            uart0_bytes: statistics.uart_bytes,
            host_seconds,
            mcycles_per_second: rate.is_finite().then_some(rate),
            engine,
            sleeping_cycles: statistics.sleeping_cycles,
            sleeps: statistics.sleeps,
            interrupts: interrupts(machine, &statistics),
            pin_edges: pin_edges(&statistics),
            stack_peak: machine
                .device()
                .ram_end()
                .saturating_sub(statistics.lowest_sp),
            crash: match stop {
                Stop::Crash(crash) => Some(Crash::new(crash, program)),
                _ => None,
            },
            reports: reports(machine, program),
            interrupt_damage: machine
                .interrupt_damage()
                .iter()
                .map(|damage| Damage::new(damage, program))
                .collect(),
            profile,
        }
    }

    /// Odd accesses and damage done by interrupts, with their places.
    pub(super) fn reports(&self) -> &[String] {
        &self.reports
    }

    /// The profile, if there is one.
    pub(super) fn profile(&self) -> Option<&Document> {
        self.profile.as_ref()
    }
}

impl Crash {
    fn new(crash: &cardan_emulator::Crash, program: &Program) -> Self {
        Self {
            place: Place::new(crash.pc, program),
            instruction: crash.instruction.clone(),
            cause: crash.cause.to_string(),
        }
    }
}

impl Place {
    fn new(pc: u32, program: &Program) -> Self {
        let frame = program.symbols().frames_at(pc).into_iter().next();
        let (function, file, line) = match frame {
            Some(frame) => (frame.function, frame.file, frame.line),
            None => (None, None, None),
        };
        Self {
            pc,
            function,
            file,
            line,
        }
    }
}

impl Damage {
    fn new(damage: &InterruptDamage, program: &Program) -> Self {
        let changed = |(register, before, after)| Changed {
            register,
            before,
            after,
        };
        Self {
            vector: damage.name,
            count: damage.count,
            place: Place::new(damage.pc, program),
            interrupted_pc: damage.interrupted_pc,
            entry_cycle: damage.entry_cycle,
            cycle: damage.cycle,
            registers: damage.registers().map(changed).collect(),
            sreg_before: damage.before.sreg,
            sreg_after: damage.after.sreg,
        }
    }
}

/// Odd accesses with their places, then interrupts that did damage.
fn reports(machine: &Machine, program: &Program) -> Vec<String> {
    let is_access = |report: &&Report| !matches!(report.kind, ReportKind::InterruptDamage { .. });
    let accesses = machine.reports().iter().filter(is_access);
    let accesses = accesses.map(|report| format!("{report}{}", program.place(report.pc)));
    let damage = machine.interrupt_damage().iter();
    let damage = damage.map(|damage| format!("{damage}{}", program.place(damage.pc)));
    accesses.chain(damage).collect()
}

fn interrupts(machine: &Machine, statistics: &Statistics) -> Vec<Interrupt> {
    let vectors = machine.device().vectors.iter().zip(&statistics.vectors);
    vectors
        .filter(|(_, vector)| vector.count > 0)
        .map(|(name, vector)| Interrupt {
            vector: name,
            count: vector.count,
            latency_max: vector.latency_max,
            returns: vector.returns,
            damaged: vector.damaged,
        })
        .collect()
}

fn pin_edges(statistics: &Statistics) -> BTreeMap<String, u64> {
    let pins = (0..3).flat_map(|port| (0..8).filter_map(move |bit| Pin::new(port, bit)));
    pins.map(|pin| (pin.to_string(), statistics.edges(pin)))
        .filter(|&(_, edges)| edges > 0)
        .collect()
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: stopped by {} at {:#06x} after {} cycles, {} instructions; {} bytes sent, \
             stack {} bytes",
            self.mcu,
            self.stop,
            self.pc,
            self.cycles,
            self.instructions,
            self.uart0_bytes,
            self.stack_peak
        )?;
        match self.mcycles_per_second {
            Some(rate) => write!(f, "; {:.3} s, {rate:.1} Mcycles/s", self.host_seconds),
            None => Ok(()),
        }
    }
}

/// Names of the contract. A run that ended because nobody reads its output met no end of its own:
/// it is a limit set from outside.
fn name(stop: &Stop) -> &'static str {
    match stop {
        Stop::Limit | Stop::Requested => "limit",
        Stop::Sleep => "sleep",
        Stop::Break => "break",
        Stop::Halt => "halt",
        Stop::Crash(_) => "crash",
    }
}
