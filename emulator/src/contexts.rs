//! Interrupted contexts: whether a handler gives back the registers and SREG that it found.
//!
//! Each interrupt entry is remembered with the general registers and SREG. A RETI that finds a
//! remembered return address at the place on the stack where the entry has put it ends that
//! interrupt, and only then the two states are compared. So an operating system may return to
//! another context than the one interrupted last, and a RETI without an entry (to start a task, or
//! to enable interrupts) compares with nothing. Not compared either: a handler that changes its
//! return address, or leaves by RET or `longjmp`. I is no damage: the entry clears and RETI sets it.
//!
//! A program may change registers on purpose, where it keeps a variable in one: what is damage, and
//! whether it matters, is the caller's to judge.

use std::fmt;

use crate::alu::{self, Flags};
use crate::machine::Machine;
use crate::stop::{Report, ReportKind};

/// Contexts remembered: as many tasks may be interrupted at once. The oldest is forgotten.
const REMEMBERED: usize = 32;
/// General registers.
const REGISTERS: usize = 32;
/// Names of the bits of SREG, from bit 0.
const SREG_BITS: [char; 8] = ['C', 'Z', 'N', 'V', 'S', 'H', 'T', 'I'];

/// The state at an interrupt entry.
#[derive(Clone, Debug, PartialEq)]
struct Context {
    vector: usize,
    /// Word address of the interrupted instruction.
    pc: u16,
    /// Stack pointer below the return address.
    sp: u16,
    flags: Flags,
    registers: [u8; REGISTERS],
    cycle: u64,
}

/// General registers and status register at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegisterState {
    /// r0 to r31.
    pub registers: [u8; REGISTERS],
    /// Status register, its bit I left out (0).
    pub sreg: u8,
}

/// An interrupt handler that returned to what it had interrupted with other registers or another
/// SREG than it found. One per vector; the details are those of the first time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InterruptDamage {
    /// Number of the vector, an index of [`crate::Device::vectors`].
    pub vector: usize,
    /// Name of the vector.
    pub name: &'static str,
    /// Byte address of the RETI.
    pub pc: u32,
    /// Byte address of the interrupted instruction.
    pub interrupted_pc: u32,
    /// Cycle at which the entry began.
    pub entry_cycle: u64,
    /// Cycle at which the RETI began.
    pub cycle: u64,
    /// What the handler found.
    pub before: RegisterState,
    /// What it left.
    pub after: RegisterState,
    /// Registers changed at any time: bit n is rn.
    pub registers_ever: u32,
    /// Bits of SREG changed at any time.
    pub sreg_ever: u8,
    /// Times that anything was changed.
    pub count: u64,
}

impl InterruptDamage {
    /// Registers that were changed the first time: number, value found, value left.
    pub fn registers(&self) -> impl Iterator<Item = (u8, u8, u8)> {
        let pairs = self.before.registers.into_iter().zip(self.after.registers);
        (0u8..)
            .zip(pairs)
            .filter(|(_, (before, after))| before != after)
            .map(|(number, (before, after))| (number, before, after))
    }

    /// Bits of SREG that were changed the first time.
    pub fn sreg(&self) -> u8 {
        self.before.sreg ^ self.after.sreg
    }
}

impl fmt::Display for InterruptDamage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "at {:#06x}: interrupt {} does not return what it found:",
            self.pc, self.name
        )?;
        for (number, before, after) in self.registers() {
            write!(f, " r{number} {before:#04x} -> {after:#04x},")?;
        }
        if self.sreg() != 0 {
            let (before, after) = (self.before.sreg, self.after.sreg);
            let bits = sreg_names(self.sreg());
            write!(f, " SREG {before:#04x} -> {after:#04x} ({bits}),")?;
        }
        write!(
            f,
            " first in cycle {} (entered in cycle {} from {:#06x}), {} times in all",
            self.cycle, self.entry_cycle, self.interrupted_pc, self.count
        )
    }
}

/// Names of the bits of SREG that are set, from bit 7.
pub(crate) fn sreg_names(bits: u8) -> String {
    let named = SREG_BITS.into_iter().enumerate().rev();
    named
        .filter(|(bit, _)| bits >> bit & 1 != 0)
        .map(|(_, name)| name)
        .collect()
}

/// Interrupted contexts that have not been returned to, and what handlers have damaged.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Contexts {
    open: Vec<Context>,
    damage: Vec<InterruptDamage>,
}

impl Contexts {
    /// Forgets what was interrupted (reset).
    pub(crate) fn clear(&mut self) {
        self.open.clear();
    }

    fn remember(&mut self, context: Context) {
        // The return address just pushed has overwritten those that it overlaps.
        let sp = context.sp;
        self.open.retain(|open| open.sp.abs_diff(sp) > 1);
        if self.open.len() == REMEMBERED {
            self.open.remove(0);
        }
        self.open.push(context);
    }

    fn take(&mut self, sp: u16, pc: u16) -> Option<Context> {
        let is_it = |open: &Context| open.sp == sp && open.pc == pc;
        let at = self.open.iter().rposition(is_it)?;
        Some(self.open.remove(at))
    }
}

impl Machine {
    /// Interrupt handlers that returned with other registers or another SREG than they found, in
    /// the order of their first time. [`crate::VectorStatistics`] counts how many returns were
    /// compared.
    pub fn interrupt_damage(&self) -> &[InterruptDamage] {
        &self.contexts.damage
    }

    /// Remembers what the entry to `vector`, which begins now, interrupts at word address `pc`. The
    /// return address has been pushed.
    pub(crate) fn remember_context(&mut self, vector: usize, pc: u16) {
        let mut registers = [0; REGISTERS];
        registers.copy_from_slice(&self.core.data[..REGISTERS]);
        self.contexts.remember(Context {
            vector,
            pc,
            sp: self.core.sp,
            flags: self.core.flags,
            registers,
            cycle: self.core.cycle,
        });
    }

    /// Compares with what was interrupted: a RETI at the program counter, with the stack pointer
    /// `sp` before it, is about to return to word address `target`.
    pub(crate) fn compare_context(&mut self, sp: u16, target: u16) {
        let Some(context) = self.contexts.take(sp, target) else {
            return;
        };
        self.interrupts.statistics[context.vector].returns += 1;
        let flags = self.core.flags.sreg() ^ context.flags.sreg();
        if self.core.data[..REGISTERS] != context.registers || flags & !alu::I != 0 {
            self.note_damage(&context);
        }
    }

    #[cold]
    fn note_damage(&mut self, context: &Context) {
        let vector = context.vector;
        self.interrupts.statistics[vector].damaged += 1;
        let mut now = [0; REGISTERS];
        now.copy_from_slice(&self.core.data[..REGISTERS]);
        let damage = InterruptDamage {
            vector,
            name: self.device.vectors[vector],
            pc: self.pc(),
            interrupted_pc: u32::from(context.pc) * 2,
            entry_cycle: context.cycle,
            cycle: self.core.cycle,
            before: RegisterState {
                registers: context.registers,
                sreg: context.flags.sreg() & !alu::I,
            },
            after: RegisterState {
                registers: now,
                sreg: self.core.flags.sreg() & !alu::I,
            },
            registers_ever: 0,
            sreg_ever: 0,
            count: 0,
        };
        let registers = damage.registers().fold(0, |mask, (n, ..)| mask | 1 << n);
        let sreg = damage.sreg();
        let known = self.contexts.damage.iter().position(|d| d.vector == vector);
        let at = known.unwrap_or(self.contexts.damage.len());
        if known.is_none() {
            let kind = ReportKind::InterruptDamage {
                vector: damage.name,
                registers,
                sreg,
            };
            self.reports.push(Report {
                pc: damage.pc,
                address: 0,
                kind,
            });
            self.contexts.damage.push(damage);
        }
        let first = &mut self.contexts.damage[at];
        first.registers_ever |= registers;
        first.sreg_ever |= sreg;
        first.count += 1;
    }
}
