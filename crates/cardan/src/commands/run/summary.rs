//! What a run came to, for programs and for people.

use std::fmt;

use cardan_emulator::{Machine, Stop};
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
    /// Bytes of the stack at its deepest.
    stack_peak: u16,
    crash: Option<Crash>,
    /// Odd accesses, each place once.
    reports: Vec<String>,
    /// With `--profile`.
    #[serde(skip_serializing_if = "Option::is_none")]
    profile: Option<Document>,
}

/// Where and why the program crashed.
#[derive(Serialize)]
struct Crash {
    pc: u32,
    instruction: String,
    cause: String,
    /// Function and source line, as far as the program's file names them.
    function: Option<String>,
    file: Option<String>,
    line: Option<u32>,
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
            stack_peak: machine
                .device()
                .ram_end()
                .saturating_sub(statistics.lowest_sp),
            crash: match stop {
                Stop::Crash(crash) => Some(Crash::new(crash, program)),
                _ => None,
            },
            reports: machine
                .reports()
                .iter()
                .map(|report| format!("{report}{}", program.place(report.pc)))
                .collect(),
            profile,
        }
    }

    /// Odd accesses with their places.
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
        let frame = program.symbols().frames_at(crash.pc).into_iter().next();
        let (function, file, line) = match frame {
            Some(frame) => (frame.function, frame.file, frame.line),
            None => (None, None, None),
        };
        Self {
            pc: crash.pc,
            instruction: crash.instruction.clone(),
            cause: crash.cause.to_string(),
            function,
            file,
            line,
        }
    }
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
