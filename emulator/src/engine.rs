//! The seam between the machine and what executes instructions.
//!
//! The machine's run loop owns events, interrupts, sleep and everything behind the I/O bus. In
//! between an [`Engine`] executes plain instructions on the [`Core`]. [`Interpreter`] is the
//! reference; another engine must leave the core, cycle by cycle, as the interpreter would.

pub use crate::core::{Core, Layout};
pub use crate::isa::{Code, Op};

/// Why an engine returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// The next event is due: the core stands at the first instruction boundary at or after it.
    Event,
    /// The instruction at the program counter needs the machine.
    Machine,
    /// [`Arrivals`] said so.
    Arrival,
}

/// Executes instructions.
pub trait Engine {
    /// Executes until the core's next event or before an instruction that needs the machine, not
    /// less and not more.
    fn run(&mut self, core: &mut Core) -> Exit;
}

/// The reference engine.
#[derive(Clone, Copy, Debug, Default)]
pub struct Interpreter;

impl Engine for Interpreter {
    #[inline]
    fn run(&mut self, core: &mut Core) -> Exit {
        core.run()
    }
}

/// Watches where the interpreter jumps to, to find what is executed often.
pub trait Arrivals {
    /// Whether there is anything to watch; if not, watching costs nothing.
    const IS_WATCHING: bool;

    /// Whether the interpreter is to return, having jumped to this word address.
    fn stops_at(&mut self, pc: u16) -> bool;

    /// Whether it is to return before the instruction at this word address, however it came there,
    /// unless that is the first.
    fn is_known(&self, pc: u16) -> bool;
}

/// Nobody watches.
pub(crate) struct Unwatched;

impl Arrivals for Unwatched {
    const IS_WATCHING: bool = false;

    #[inline(always)]
    fn stops_at(&mut self, _: u16) -> bool {
        false
    }

    #[inline(always)]
    fn is_known(&self, _: u16) -> bool {
        false
    }
}
