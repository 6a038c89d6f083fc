//! The schedule: when each peripheral needs attention next, and the run loop around the core.
//!
//! The core runs until the earliest event; all events due are carried out in the order of their
//! cycles, and only then is an interrupt considered. Register accesses first carry out the events
//! up to their own cycle, so nothing is ever seen out of order.

use crate::engine::{Engine, Exit, Interpreter, Unwatched};
use crate::environment::Environment;
use crate::machine::Machine;
use crate::observer::{Nobody, Observer, Observers, Pause};
use crate::stop::{Cause, Stop};
use crate::traps::Sprung;

/// No event planned.
pub(crate) const NEVER: u64 = u64::MAX;
/// A run without a limit: half the range, so that no sum overflows.
const ENDLESS: u64 = u64::MAX / 2;
/// Cycles of an interrupt entry.
const ENTRY: u64 = 4;

/// Who planned an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    Timer0,
    Timer1,
    Timer2,
    Adc,
    UsartTransmit,
    SerialLine,
    UsartReceive,
    Eeprom,
    Pins,
    Capture,
    Spi,
    Twi,
    Watchdog,
    Spm,
    Input,
}

impl Source {
    const ALL: [Source; 15] = [
        Source::Timer0,
        Source::Timer1,
        Source::Timer2,
        Source::Adc,
        Source::UsartTransmit,
        Source::SerialLine,
        Source::UsartReceive,
        Source::Eeprom,
        Source::Pins,
        Source::Capture,
        Source::Spi,
        Source::Twi,
        Source::Watchdog,
        Source::Spm,
        Source::Input,
    ];

    pub(crate) const TIMERS: [Source; 3] = [Source::Timer0, Source::Timer1, Source::Timer2];
}

/// Next event of each source, and the earliest of them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Schedule {
    at: [u64; Source::ALL.len()],
    next: u64,
}

impl Schedule {
    pub(crate) fn new() -> Schedule {
        Schedule {
            at: [NEVER; Source::ALL.len()],
            next: NEVER,
        }
    }

    #[inline]
    pub(crate) fn set(&mut self, source: Source, at: Option<u64>) {
        let new = at.unwrap_or(NEVER);
        let old = std::mem::replace(&mut self.at[source as usize], new);
        if new <= self.next {
            self.next = new;
        } else if old == self.next {
            self.next = self.at.iter().copied().fold(NEVER, u64::min);
        }
    }

    /// Cycle of the earliest event.
    #[inline]
    pub(crate) fn next(&self) -> u64 {
        self.next
    }

    /// Who planned the earliest event; of several the first in the order of [`Source`].
    fn next_source(&self) -> Source {
        let first = self.at.iter().position(|&at| at == self.next);
        Source::ALL[first.unwrap_or_default()]
    }
}

impl Machine {
    /// Runs until `until_cycle` is reached (at the first instruction boundary at or after it) or
    /// something stops the program. A later call goes on where this one ended.
    pub fn run<E: Environment>(&mut self, env: &mut E, until_cycle: u64) -> Stop {
        self.run_with(&mut Interpreter, env, until_cycle)
    }

    /// [`Machine::run`] with another engine, whose code may be kept from one call to the next.
    pub fn run_with<G: Engine, E: Environment>(
        &mut self,
        engine: &mut G,
        env: &mut E,
        until_cycle: u64,
    ) -> Stop {
        self.run_shown(engine, env, until_cycle, &mut Nobody)
    }

    /// [`Machine::run`] with the interpreter, which shows `observers` what happens: slower.
    pub fn run_observed<E: Environment>(
        &mut self,
        env: &mut E,
        until_cycle: u64,
        observers: &mut Observers<'_>,
    ) -> Stop {
        let engine = &mut Interpreter;
        let stop = match (&mut observers.profile, &mut observers.watch) {
            (Some(profile), None) => self.run_shown(engine, env, until_cycle, *profile),
            _ => self.run_shown(engine, env, until_cycle, observers),
        };
        observers.finish(self);
        stop
    }

    fn run_shown<G: Engine, E: Environment, O: Observer>(
        &mut self,
        engine: &mut G,
        env: &mut E,
        until_cycle: u64,
        observer: &mut O,
    ) -> Stop {
        let until = until_cycle.min(ENDLESS);
        self.usart.shows_line = E::SERIAL_EDGES;
        self.poll_input(self.core.cycle, env);
        loop {
            self.fire_events(self.core.cycle, env);
            if let Some(cause) = self.pending_reset.take() {
                observer.pause(Pause::Reset, self);
                self.reset(cause, env);
                observer.settled(self);
            }
            if env.stop_requested() {
                return Stop::Requested;
            }
            if self.core.cycle >= until {
                return Stop::Limit;
            }
            if self.is_sleeping {
                if self.schedule.next() == NEVER && until == ENDLESS && !self.interrupts.any() {
                    // Nothing can ever wake it, and nobody wants to know when.
                    return Stop::Sleep;
                }
                self.sleep_on(until, env, observer);
                continue;
            }
            if self.may_interrupt() {
                if let Err(cause) = self.enter_interrupt(env, observer) {
                    return self.crash(cause);
                }
                continue;
            }
            if self.core.instructions >= self.traps.step_end {
                return self.spring(Sprung::Step);
            }
            let (held, before) = (self.one_more, self.core.instructions);
            self.core.next_event = self.next_attention(until);
            // An engine of translated code has nothing to show.
            let exit = match O::IS_WATCHING {
                true => self.core.run_observed(&mut Unwatched, observer),
                false => engine.run(&mut self.core),
            };
            if exit == Exit::Machine
                && let Err(stop) = self.execute_shown(env, until, observer)
            {
                // A stop before the first instruction leaves everything for the next run.
                self.one_more |= held && self.core.instructions == before;
                return stop;
            }
            observer.settled(self);
            if self.traps.sprung.is_some() {
                return Stop::Requested;
            }
        }
    }

    /// Executes the instruction that the core has shown and left to the machine.
    fn execute_shown<E: Environment, O: Observer>(
        &mut self,
        env: &mut E,
        until: u64,
        observer: &mut O,
    ) -> Result<(), Stop> {
        if !O::IS_WATCHING {
            return self.execute_here(env, until);
        }
        let (code, before) = (self.core.op().code, self.core.instructions);
        let result = self.execute_here(env, until);
        observer.completed(code, self.core.instructions - before);
        result
    }

    /// Executes one instruction (or one interrupt entry, or sleeps to the next event).
    pub fn step<E: Environment>(&mut self, env: &mut E) -> Option<Stop> {
        let until = self.core.cycle + 1;
        match self.run(env, until) {
            Stop::Limit => None,
            stop => Some(stop),
        }
    }

    /// Cycle at which the core has to return: one instruction later while an interrupt is held
    /// back by SEI or RETI, else at the next event.
    fn next_attention(&mut self, until: u64) -> u64 {
        let is_held = std::mem::take(&mut self.one_more) && self.interrupts.any();
        if is_held || self.traps.is_stepping() {
            return self.core.cycle + 1;
        }
        let held = self.system.interrupts_held_until();
        let limit = if held > self.core.cycle { held } else { until };
        self.schedule.next().min(until).min(limit)
    }

    fn may_interrupt(&self) -> bool {
        self.interrupts.any()
            && self.core.flags.interrupts_enabled()
            && !self.one_more
            && self.core.cycle >= self.system.interrupts_held_until()
    }

    fn enter_interrupt<E: Environment, O: Observer>(
        &mut self,
        env: &mut E,
        observer: &mut O,
    ) -> Result<(), Cause> {
        let Some(vector) = self.interrupts.highest() else {
            return Ok(());
        };
        if !self.core.may_push(2) {
            return Err(Cause::StackOutOfMemory { sp: self.core.sp });
        }
        let latency = self.interrupts.enter(vector, self.core.cycle);
        observer.pause(Pause::Entry { vector, latency }, self);
        self.touch_stack(0, 2, true);
        self.core.push_pc(self.core.pc & self.core.pc_mask());
        self.core.flags.enable_interrupts(false);
        self.acknowledge(vector, self.core.cycle, env);
        self.core.pc = self.vector_base() + vector as u16 * 2;
        self.core.cycle += ENTRY;
        observer.settled(self);
        Ok(())
    }

    /// Carries out all events up to and including cycle `to`, in order.
    pub(crate) fn fire_events<E: Environment>(&mut self, to: u64, env: &mut E) {
        while self.schedule.next() <= to {
            let at = self.schedule.next();
            match self.schedule.next_source() {
                Source::Timer0 => self.sync_timer(0, at, env),
                Source::Timer1 => self.sync_timer(1, at, env),
                Source::Timer2 => self.sync_timer(2, at, env),
                Source::Adc => self.step_adc(at, env),
                Source::UsartTransmit => self.step_transmitter(at, env),
                Source::SerialLine => self.step_line(at, env),
                Source::UsartReceive => self.step_receiver(at, env),
                Source::Eeprom => self.finish_eeprom(at),
                Source::Pins => self.step_pins(at, env),
                Source::Capture => self.step_capture(at, env),
                Source::Spi => self.step_spi(at, env),
                Source::Twi => self.step_twi(at, env),
                Source::Watchdog => self.time_out(at),
                Source::Spm => self.finish_spm(at),
                Source::Input => self.poll_input(at, env),
            }
        }
    }
}
