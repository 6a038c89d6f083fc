//! The chip under a debugger: how it goes on, and why it halts.

use std::ops::Range;

use gdbstub::common::Signal;
use gdbstub::target::ext::breakpoints::WatchKind;

use super::StopReason;
use super::memory::DATA;
use crate::environment::Environment;
use crate::machine::Machine;
use crate::power::ResetCause;
use crate::stop::{Cause, Stop};
use crate::traps::{Access, Sprung};

/// How the chip is to go on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Plan {
    Continue,
    /// One instruction.
    Step,
    /// Until the program counter leaves these byte addresses.
    Leave(Range<u32>),
}

/// A chip in the hands of a debugger.
pub(super) struct Chip<E> {
    pub(super) machine: Machine,
    pub(super) environment: E,
    plan: Plan,
    /// The program is over: it does not go on by itself.
    pub(super) end: Option<Stop>,
    /// It stands behind a BREAK.
    at_break: bool,
    /// Program counter that the client knows the chip to stand at.
    known_pc: u32,
}

impl<E: Environment> Chip<E> {
    pub(super) fn new(mut machine: Machine, environment: E) -> Chip<E> {
        machine.traps.is_attached = true;
        let known_pc = machine.pc();
        Chip {
            machine,
            environment,
            plan: Plan::Continue,
            end: None,
            at_break: false,
            known_pc,
        }
    }

    /// Prepares to go on. A breakpoint at which the client knows the chip to stand is passed.
    pub(super) fn resume(&mut self, plan: Plan) {
        self.machine.traps.sprung = None;
        self.machine
            .pass_from_here(self.machine.pc() == self.known_pc);
        self.machine.set_step(plan != Plan::Continue);
        self.at_break = false;
        self.plan = plan;
    }

    /// Goes on to `until` at most; tells why the chip halted, if it did.
    pub(super) fn advance(&mut self, until: u64, limit: u64) -> Option<StopReason> {
        let reason = self.advance_once(until, limit)?;
        self.known_pc = self.machine.pc();
        Some(reason)
    }

    fn advance_once(&mut self, until: u64, limit: u64) -> Option<StopReason> {
        if let Some(end) = &self.end {
            return Some(StopReason::Signal(signal(end)));
        }
        loop {
            let stop = self.machine.run(&mut self.environment, until.min(limit));
            let sprung = self.machine.traps.sprung.take();
            match (stop, sprung) {
                (_, Some(Sprung::Breakpoint)) => return Some(StopReason::SwBreak(())),
                (_, Some(Sprung::Watch { address, access })) => {
                    return Some(watched(address, access));
                }
                (Stop::Requested, Some(Sprung::Step)) => match &self.plan {
                    Plan::Leave(range) if range.contains(&self.machine.pc()) => {
                        self.machine.set_step(true);
                    }
                    _ => return Some(StopReason::DoneStep),
                },
                (Stop::Limit, _) if self.machine.cycle() < limit => return None,
                (Stop::Break, _) => {
                    self.at_break = true;
                    return Some(StopReason::Signal(Signal::SIGTRAP));
                }
                (stop, _) => {
                    let signal = signal(&stop);
                    self.end = Some(stop);
                    return Some(StopReason::Signal(signal));
                }
            }
        }
    }

    /// Resets the chip, as its pin RESET does.
    pub(super) fn reset(&mut self) {
        self.machine
            .reset(ResetCause::External, &mut self.environment);
        self.moved();
    }

    /// The client has changed what the chip does next.
    pub(super) fn moved(&mut self) {
        self.end = None;
        self.at_break = false;
    }

    /// Takes everything of the debugger out of the chip. How the program has ended, if it has.
    pub(super) fn finish(&mut self) -> Option<Stop> {
        self.machine.clear_traps();
        if self.at_break {
            self.machine.drain_transmitter(&mut self.environment);
            return Some(Stop::Break);
        }
        self.end.take()
    }
}

fn watched(address: u16, access: Access) -> StopReason {
    let kind = match access {
        Access::Write => WatchKind::Write,
        Access::Read => WatchKind::Read,
        Access::Any => WatchKind::ReadWrite,
    };
    StopReason::Watch {
        tid: (),
        kind,
        addr: DATA.start + u32::from(address),
    }
}

/// The signal by which a debugger shows how a program has ended.
pub(super) fn signal(stop: &Stop) -> Signal {
    match stop {
        // Over, in order.
        Stop::Halt | Stop::Sleep => Signal::SIGTERM,
        Stop::Break => Signal::SIGTRAP,
        Stop::Limit => Signal::SIGXCPU,
        Stop::Requested => Signal::SIGPIPE,
        Stop::Crash(crash) => match crash.cause {
            Cause::InvalidOpcode { .. } => Signal::SIGILL,
            Cause::NotModelled { .. } => Signal::SIGSYS,
            _ => Signal::SIGSEGV,
        },
    }
}
