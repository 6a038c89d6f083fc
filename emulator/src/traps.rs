//! Traps: where a debugger wants the program to halt. Breakpoints, watchpoints, single steps; and
//! looks at the chip that leave no trace.
//!
//! A breakpoint is a code in the table of predecoded instructions; a watched part of SRAM lies
//! outside the window that the interpreter accesses by itself, so that the machine sees each access
//! to it. Both cost nothing elsewhere, and nothing of what a debugger does changes a cycle: the
//! chip halts only between an interrupt's turn and the next instruction, where a run would have
//! gone on just so.

use std::ops::Range;

use crate::environment::{AnalogInput, Environment, Pin};
use crate::machine::Machine;
use crate::registers as io;
use crate::stop::{Cause, Stop};

/// Which accesses a watchpoint halts at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    Write,
    Read,
    Any,
}

/// A watched part of the data space.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Watch {
    pub(crate) addresses: Range<u16>,
    pub(crate) access: Access,
}

/// What made the program halt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sprung {
    /// The instruction at the program counter has a breakpoint.
    Breakpoint,
    /// The instruction before (or the interrupt entry) accessed a watched address.
    Watch { address: u16, access: Access },
    /// One instruction has been executed.
    Step,
}

/// The traps that are set, and the one that sprang.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Traps {
    watches: Vec<Watch>,
    /// Number of instructions at which a single step ends; [`u64::MAX`]: no step.
    pub(crate) step_end: u64,
    /// Number of instructions and program counter at which a breakpoint is passed: it has been
    /// reported before.
    passing: Option<(u64, u16)>,
    pub(crate) sprung: Option<Sprung>,
    /// A debugger listens: the program may go on after BREAK.
    pub(crate) is_attached: bool,
}

impl Default for Traps {
    fn default() -> Traps {
        Traps {
            watches: Vec::new(),
            step_end: u64::MAX,
            passing: None,
            sprung: None,
            is_attached: false,
        }
    }
}

impl Traps {
    pub(crate) fn is_stepping(&self) -> bool {
        self.step_end != u64::MAX
    }
}

impl Machine {
    /// Notes which trap sprang.
    pub(crate) fn spring(&mut self, sprung: Sprung) -> Stop {
        self.traps.sprung = Some(sprung);
        Stop::Requested
    }

    /// From here on the program goes on: a breakpoint at the program counter is passed, if
    /// `is_reported`.
    pub(crate) fn pass_from_here(&mut self, is_reported: bool) {
        self.traps.passing = is_reported.then_some((self.core.instructions, self.core.pc));
    }

    pub(crate) fn may_pass_breakpoint(&self) -> bool {
        self.traps.passing == Some((self.core.instructions, self.core.pc))
    }

    /// Lets the next runs end after one instruction, or not.
    pub(crate) fn set_step(&mut self, is_step: bool) {
        self.traps.step_end = if is_step {
            self.core.instructions + 1
        } else {
            u64::MAX
        };
    }

    /// Adds a watchpoint. Returns false where accesses cannot be seen: general registers, SP and
    /// SREG, and what is no data address.
    pub(crate) fn add_watch(&mut self, watch: Watch) -> bool {
        let Range { start, end } = watch.addresses;
        let is_seen = start >= 0x20 && (end <= io::SPL || start > io::SREG);
        if !is_seen || start >= end || end - 1 > self.device.ram_end() {
            return false;
        }
        self.traps.watches.push(watch);
        self.set_window();
        true
    }

    /// Removes a watchpoint. Returns whether it was there.
    pub(crate) fn remove_watch(&mut self, watch: &Watch) -> bool {
        let found = self.traps.watches.iter().position(|known| known == watch);
        if let Some(index) = found {
            self.traps.watches.remove(index);
            self.set_window();
        }
        found.is_some()
    }

    /// Removes all traps.
    pub(crate) fn clear_traps(&mut self) {
        self.core.clear_breakpoints();
        self.traps = Traps::default();
        self.set_window();
    }

    /// The interpreter's window: the largest part of SRAM without a watched address.
    fn set_window(&mut self) {
        let ram = self.core.ram_start..self.core.ram_start + self.core.ram_bytes;
        let mut watched: Vec<_> = self.traps.watches.iter().map(|w| &w.addresses).collect();
        watched.sort_by_key(|addresses| addresses.start);
        let (mut window, mut from) = (ram.start..ram.start, ram.start);
        let end = ram.end..ram.end;
        for next in watched.into_iter().chain([&end]) {
            if next.start.saturating_sub(from) > window.end - window.start {
                window = from..next.start;
            }
            from = from.max(next.end);
        }
        self.core.window_start = window.start;
        self.core.window_bytes = window.end - window.start;
    }

    /// Notes an access of the program to a data address.
    pub(crate) fn touch(&mut self, address: u16, is_store: bool) {
        let hit = self.traps.watches.iter().find(|watch| {
            watch.addresses.contains(&address)
                && match watch.access {
                    Access::Write => is_store,
                    Access::Read => !is_store,
                    Access::Any => true,
                }
        });
        if let Some(watch) = hit {
            self.traps.sprung = Some(Sprung::Watch {
                address: watch.addresses.start,
                access: watch.access,
            });
        }
    }

    /// Notes an access to `count` bytes of the stack: pushed from SP down, or popped from above it.
    pub(crate) fn touch_stack(&mut self, above: u16, count: u16, is_store: bool) {
        if self.traps.watches.is_empty() {
            return;
        }
        for i in 0..count {
            let sp = self.core.sp;
            let address = if is_store {
                sp.wrapping_sub(i)
            } else {
                sp.wrapping_add(above + i)
            };
            self.touch(address, is_store);
        }
    }

    /// Reads the data space as the program would now, without its effects: a flag stays set, a
    /// received byte stays in its buffer. The addresses end with SRAM at the latest.
    pub(crate) fn peek<E: Environment>(&self, addresses: Range<u16>, env: &mut E) -> Vec<u8> {
        let io = 0x20..self.device.sram_start;
        // What a read changes, it changes in a copy.
        let touches_io = addresses.start < io.end && addresses.end > io.start;
        let mut copy = touches_io.then(|| self.clone());
        let at = self.core.cycle;
        let mut glance = Glance(env);
        addresses
            .map(|address| match &mut copy {
                Some(copy) if io.contains(&address) => copy.read_io(address, at, &mut glance),
                _ => self.core.data[usize::from(address)],
            })
            .collect()
    }

    /// Writes to the data space as the program would; an I/O register shows its effects.
    pub(crate) fn poke<E: Environment>(
        &mut self,
        address: u16,
        value: u8,
        env: &mut E,
    ) -> Result<(), Cause> {
        if !(0x20..self.device.sram_start).contains(&address) {
            self.core.data[usize::from(address)] = value;
            return Ok(());
        }
        self.write_io(address, value, self.core.cycle, env);
        // The halt that an access causes belongs to the instruction; here there is none.
        self.stall = 0;
        self.fault.take().map_or(Ok(()), Err)
    }
}

/// The environment of a look: levels and voltages are seen, nothing goes out.
struct Glance<'a, E>(&'a mut E);

impl<E: Environment> Environment for Glance<'_, E> {
    fn pin_level(&mut self, cycle: u64, pin: Pin) -> Option<bool> {
        self.0.pin_level(cycle, pin)
    }

    fn analog(&mut self, cycle: u64, input: AnalogInput) -> f64 {
        self.0.analog(cycle, input)
    }
}
