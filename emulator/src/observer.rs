//! Who watches a run: shown every instruction and everything else that takes time. An observer
//! changes nothing; a run without one pays nothing.

use crate::alu::Flags;
use crate::core::DATA;
use crate::isa::Code;
use crate::machine::Machine;
use crate::profile::Profile;
use crate::watch::Watch;

/// The state before an instruction, which is the state after the one before it.
#[derive(Clone, Copy)]
pub(crate) struct Moment<'a> {
    /// Word address of the instruction.
    pub(crate) pc: u16,
    /// The instruction, or a pair that begins with it.
    pub(crate) code: Code,
    pub(crate) cycle: u64,
    pub(crate) sp: u16,
    /// Lowest stack pointer so far.
    pub(crate) lowest_sp: u16,
    pub(crate) flags: Flags,
    pub(crate) data: &'a [u8; DATA],
}

/// What the processor does instead of executing instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pause {
    /// Pushes the program counter and goes to a vector; the cycles that the request had waited.
    Entry { vector: usize, latency: u64 },
    /// Sleeps.
    Asleep,
    /// Stands still after sleep or reset until its clock runs.
    Halted,
    /// Is reset.
    Reset,
}

/// Watches a run. [`Observer::instruction`] comes before each instruction. One that the core left
/// to the machine is shown once, and [`Observer::completed`] follows.
pub(crate) trait Observer {
    /// False for [`Nobody`]: nothing is even prepared to be shown.
    const IS_WATCHING: bool = true;

    /// The next instruction.
    fn instruction(&mut self, moment: &Moment<'_>);

    /// The instruction last shown was executed by the machine, `times` times: never, if the
    /// program crashed, and more than once in a loop in which nothing else happens.
    fn completed(&mut self, code: Code, times: u64);

    /// From now on, and until something else is shown, the processor is paused.
    fn pause(&mut self, pause: Pause, machine: &Machine);

    /// The machine has done something outside of the core; this is the state behind it.
    fn settled(&mut self, machine: &Machine);
}

/// No observer.
pub(crate) struct Nobody;

impl Observer for Nobody {
    const IS_WATCHING: bool = false;

    fn instruction(&mut self, _: &Moment<'_>) {}

    fn completed(&mut self, _: Code, _: u64) {}

    fn pause(&mut self, _: Pause, _: &Machine) {}

    fn settled(&mut self, _: &Machine) {}
}

/// The observers of [`Machine::run_observed`].
#[derive(Debug, Default)]
pub struct Observers<'a> {
    /// Counts where the time goes.
    pub profile: Option<&'a mut Profile>,
    /// Notes how values change.
    pub watch: Option<&'a mut Watch>,
}

impl Observer for Observers<'_> {
    #[inline(always)]
    fn instruction(&mut self, moment: &Moment<'_>) {
        if let Some(profile) = &mut self.profile {
            profile.instruction(moment);
        }
        if let Some(watch) = &mut self.watch {
            watch.instruction(moment);
        }
    }

    fn completed(&mut self, code: Code, times: u64) {
        if let Some(profile) = &mut self.profile {
            profile.completed(code, times);
        }
    }

    fn pause(&mut self, pause: Pause, machine: &Machine) {
        if let Some(profile) = &mut self.profile {
            profile.pause(pause, machine);
        }
    }

    fn settled(&mut self, machine: &Machine) {
        if let Some(profile) = &mut self.profile {
            profile.settled(machine);
        }
        if let Some(watch) = &mut self.watch {
            watch.settled(machine);
        }
    }
}

impl Observers<'_> {
    /// Whether nobody watches: then [`Machine::run`] does the same, faster.
    pub fn are_none(&self) -> bool {
        self.profile.is_none() && self.watch.is_none()
    }

    /// The run ends, for now.
    pub(crate) fn finish(&mut self, machine: &Machine) {
        self.settled(machine);
        if let Some(profile) = &mut self.profile {
            profile.finish(machine);
        }
    }
}
