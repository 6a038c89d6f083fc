//! The schedule: when each peripheral needs attention next, and the run loop around the core.
//!
//! The core runs until the earliest event that may concern the program; all events due are carried
//! out in the order of their cycles, and only then is an interrupt considered. Register accesses
//! first carry out the events up to their own cycle, so nothing is ever seen out of order.

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
/// Cycles by which quiet events are carried out late at most, so that an environment that asks for
/// a stop because of one is heard.
const PATIENCE: u64 = 4096;
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

/// Leaves of a [`Tree`]: a power of two, at least the number of sources.
const LEAVES: usize = 16;
/// Bits of a key that hold its source.
const SOURCE_BITS: u32 = LEAVES.trailing_zeros();

/// When each source's next event is due, as a tree in which node n is the earlier of nodes 2n and
/// 2n + 1, so that a change costs four comparisons. A key is the cycle with the source's number
/// below it: of several events in one cycle the first in the order of [`Source`] comes first.
#[derive(Clone, Debug, PartialEq)]
struct Tree([u64; 2 * LEAVES]);

impl Tree {
    #[inline]
    fn set(&mut self, source: Source, at: Option<u64>) {
        let key = match at {
            Some(at) if at < NEVER >> SOURCE_BITS => at << SOURCE_BITS | source as u64,
            _ => NEVER,
        };
        let mut node = LEAVES + source as usize;
        if self.0[node] == key {
            return;
        }
        self.0[node] = key;
        let mut earliest = key;
        while node > 1 {
            earliest = earliest.min(self.0[node ^ 1]);
            node /= 2;
            self.0[node] = earliest;
        }
    }

    #[inline]
    fn first(&self) -> u64 {
        self.0[1]
    }
}

/// The cycle of a key.
#[inline]
fn cycle_of(key: u64) -> u64 {
    if key == NEVER {
        NEVER
    } else {
        key >> SOURCE_BITS
    }
}

/// What is due.
#[derive(Clone, Copy, Debug)]
struct Event {
    at: u64,
    source: Source,
    /// See [`Schedule`].
    is_quiet: bool,
}

/// Next event of each source, and the earliest of them.
///
/// Most events may raise an interrupt, or decide when something else will: the core has to come
/// back for them. *Quiet* ones can be known only by looking: an edge on a pin that nobody inside the
/// chip watches, the converter taking its sample. The core need not come back for those; whoever
/// looks carries them out first, in their order and with their own cycles.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Schedule {
    loud: Tree,
    quiet: Tree,
}

impl Schedule {
    pub(crate) fn new() -> Schedule {
        let empty = Tree([NEVER; 2 * LEAVES]);
        Schedule {
            loud: empty.clone(),
            quiet: empty,
        }
    }

    #[inline]
    pub(crate) fn set(&mut self, source: Source, at: Option<u64>) {
        self.loud.set(source, at);
    }

    #[inline]
    pub(crate) fn set_quiet(&mut self, source: Source, at: Option<u64>) {
        self.quiet.set(source, at);
    }

    /// Whether nothing is planned at all.
    pub(crate) fn is_empty(&self) -> bool {
        self.next_key() == NEVER
    }

    /// Cycle at which the core has to come back.
    #[inline]
    pub(crate) fn attention(&self) -> u64 {
        let late = cycle_of(self.quiet.first()).saturating_add(PATIENCE);
        cycle_of(self.loud.first()).min(late)
    }

    /// Whether an event of any kind is due by cycle `to`.
    #[inline]
    pub(crate) fn is_due(&self, to: u64) -> bool {
        self.next_key() >> SOURCE_BITS <= to
    }

    #[inline]
    fn next_key(&self) -> u64 {
        self.loud.first().min(self.quiet.first())
    }

    /// The last cycle at which a quiet event of `source` would still be the earliest of all. Takes
    /// the one that is planned out.
    #[inline]
    pub(crate) fn last_before_others(&mut self, source: Source) -> u64 {
        self.quiet.set(source, None);
        self.next_key().saturating_sub(1 + source as u64) >> SOURCE_BITS
    }

    /// The earliest event, if it is due by cycle `to`.
    #[inline]
    fn next_due(&self, to: u64) -> Option<Event> {
        let key = self.next_key();
        let event = Event {
            at: key >> SOURCE_BITS,
            // No source has the number that an empty leaf ends with.
            source: *Source::ALL.get(key as usize % LEAVES)?,
            is_quiet: key != self.loud.first(),
        };
        (event.at <= to).then_some(event)
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
        self.usart.shows_line = env.shows_serial_edges();
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
                if self.schedule.is_empty() && until == ENDLESS && !self.interrupts.any() {
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
        self.schedule.attention().min(until).min(limit)
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
        let interrupted = self.core.pc & self.core.pc_mask();
        self.core.push_pc(interrupted);
        self.remember_context(vector, interrupted);
        self.core.flags.enable_interrupts(false);
        self.acknowledge(vector, self.core.cycle, env);
        self.core.pc = self.vector_base() + vector as u16 * 2;
        self.core.cycle += ENTRY;
        observer.settled(self);
        Ok(())
    }

    /// Carries out all events up to and including cycle `to`, in order.
    #[inline]
    pub(crate) fn fire_events<E: Environment>(&mut self, to: u64, env: &mut E) {
        if self.schedule.is_due(to) {
            self.fire_due(to, env);
        }
    }

    fn fire_due<E: Environment>(&mut self, to: u64, env: &mut E) {
        while let Some(event) = self.schedule.next_due(to) {
            let Event { at, source, .. } = event;
            match source {
                Source::Timer0 if event.is_quiet => self.step_outputs(0, to, env),
                Source::Timer1 if event.is_quiet => self.step_outputs(1, to, env),
                Source::Timer2 if event.is_quiet => self.step_outputs(2, to, env),
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn events_come_by_cycle_and_then_in_the_order_of_their_sources(
            plans in prop::collection::vec(
                (0usize..15, any::<bool>(), prop::option::of(0u64..50)), 1..60,
            ),
            to in 0u64..60,
        ) {
            let mut schedule = Schedule::new();
            let mut planned = [[None; 15]; 2];
            for (index, is_quiet, at) in plans {
                let source = Source::ALL[index];
                match is_quiet {
                    true => schedule.set_quiet(source, at),
                    false => schedule.set(source, at),
                }
                planned[usize::from(is_quiet)][index] = at;
            }
            let all = planned.iter().flat_map(|kind| {
                kind.iter().enumerate().filter_map(|(index, at)| Some(((*at)?, index)))
            });
            let first = all.min().filter(|first| first.0 <= to);
            let due = schedule.next_due(to).map(|event| (event.at, event.source as usize));
            prop_assert_eq!(due, first);
            prop_assert_eq!(schedule.is_due(to), first.is_some());
            let loud = planned[0].iter().flatten().min().copied().unwrap_or(NEVER);
            prop_assert!(schedule.attention() <= loud);
        }
    }
}
