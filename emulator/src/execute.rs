//! Instructions that need the machine: I/O and unusual addresses, sleep, interrupt enable, SPM.
//!
//! The access to an I/O register happens in the last cycle of the instruction (of SBIC and SBIS
//! in the first): a write takes effect at the clock edge that ends that cycle.

use crate::alu::{self, Flags};
use crate::engine::Exit;
use crate::environment::Environment;
use crate::isa::{Code, Op};
use crate::machine::Machine;
use crate::registers as io;
use crate::stop::{Cause, Stop};
use crate::traps::Sprung;

impl Machine {
    /// Executes the instruction at the program counter; `until` bounds the skipping of idle loops.
    pub(crate) fn execute_here<E: Environment>(
        &mut self,
        env: &mut E,
        until: u64,
    ) -> Result<(), Stop> {
        if self.core.is_at_breakpoint() {
            if !self.may_pass_breakpoint() {
                return Err(self.spring(Sprung::Breakpoint));
            }
            if self.core.run_past_breakpoint() != Exit::Machine {
                return Ok(());
            }
        }
        let op = self.core.op();
        // Whatever comes of it: what was quiet up to here has happened.
        self.fire_events(self.core.cycle, env);
        if let Some(stop) = self.stopping(op, env) {
            return Err(stop);
        }
        let result = self.execute_op(op, env, until);
        if result.is_ok() && self.fault.is_none() {
            return Ok(());
        }
        let result = result.and(self.faulted());
        result.map_err(|cause| self.crash(cause))
    }

    /// What a write to a register has found that is not modelled.
    #[cold]
    fn faulted(&mut self) -> Result<(), Cause> {
        self.fault.take().map_or(Ok(()), Err)
    }

    /// Instructions that end the run.
    fn stopping<E: Environment>(&mut self, op: Op, env: &mut E) -> Option<Stop> {
        let deaf = !self.core.flags.interrupts_enabled();
        // Without a watchdog nothing reaches a program that waits with interrupts disabled.
        let is_final = deaf && !self.watchdog.resets();
        match op.code {
            Code::JumpSelf if is_final && self.ends_at_halt => {
                self.drain_transmitter(env);
                Some(Stop::Halt)
            }
            Code::Break => {
                self.advance(1, 1);
                if !self.traps.is_attached {
                    self.drain_transmitter(env);
                }
                Some(Stop::Break)
            }
            Code::Sleep if is_final && self.system.sleep_enabled() => {
                self.statistics.sleeps += 1;
                self.advance(1, 1);
                self.drain_transmitter(env);
                Some(Stop::Sleep)
            }
            _ => None,
        }
    }

    fn execute_op<E: Environment>(&mut self, op: Op, env: &mut E, until: u64) -> Result<(), Cause> {
        match op.code {
            Code::In
            | Code::Out
            | Code::Lds
            | Code::Sts
            | Code::Ldd
            | Code::LdInc
            | Code::LdDec
            | Code::Std
            | Code::StInc
            | Code::StDec => self.transfer(op, env),
            Code::Sbi | Code::Cbi => {
                let at = self.core.cycle + 1;
                self.write_bit(op.k, op.r, op.code == Code::Sbi, at, env)?;
                self.advance(1, 2);
                Ok(())
            }
            Code::Sbic | Code::Sbis => {
                let value = self.read_data(op.k, self.core.cycle, env)?;
                let skip = (value & op.r != 0) == (op.code == Code::Sbis);
                let words = if skip { op.n } else { 0 };
                self.advance(1 + u16::from(words), 1 + u64::from(words));
                Ok(())
            }
            Code::Sei => {
                self.set_sreg_delayed(self.core.flags.sreg() | alu::I);
                self.advance(1, 1);
                Ok(())
            }
            Code::OutSreg => {
                self.set_sreg_delayed(self.core.data[usize::from(op.d)]);
                self.advance(1, 1);
                Ok(())
            }
            Code::Sleep => {
                self.advance(1, 1);
                if self.system.sleep_enabled() {
                    self.fall_asleep(env)
                } else {
                    Ok(())
                }
            }
            Code::Wdr => {
                self.advance(1, 1);
                self.watchdog.restart(self.core.cycle);
                self.after_watchdog(self.core.cycle);
                Ok(())
            }
            Code::JumpSelf => {
                self.idle_loop(u64::from(op.n), until);
                Ok(())
            }
            Code::Spm => {
                self.self_program();
                self.advance(1, 1);
                Ok(())
            }
            Code::Lpm | Code::LpmInc => {
                let z = self.core.pair(30);
                let value = self.load_program_memory(z);
                if op.code == Code::LpmInc {
                    self.core.set_pair(30, z.wrapping_add(1));
                }
                self.core.data[usize::from(op.d)] = value;
                self.advance(1, 3);
                Ok(())
            }
            Code::Push | Code::Pop | Code::Call | Code::Icall | Code::Ret | Code::Reti => {
                self.stack_op(op)
            }
            Code::Ijmp => Err(self.pc_out_of_memory(self.core.pair(30))),
            _ => Err(self.invalid_opcode(op)),
        }
    }

    /// Ends an instruction: `words` on, `cycles` later, plus the halt that it caused.
    fn advance(&mut self, words: u16, cycles: u64) {
        self.core.pc = self.core.pc.wrapping_add(words) & self.core.pc_mask();
        self.core.cycle += cycles + std::mem::take(&mut self.stall);
        self.core.instructions += 1;
    }

    /// Writes SREG; if that sets I, one more instruction executes before an interrupt. The data
    /// sheet says so of SEI and RETI; for writes to SREG it is an inference.
    pub(crate) fn set_sreg_delayed(&mut self, value: u8) {
        self.one_more |= value & alu::I != 0 && !self.core.flags.interrupts_enabled();
        self.core.flags = Flags::from_sreg(value);
    }

    /// Loads and stores, by whatever addressing, that the core left to the machine.
    fn transfer<E: Environment>(&mut self, op: Op, env: &mut E) -> Result<(), Cause> {
        let pointer = || self.core.pair(op.r);
        let (address, pointer_after) = match op.code {
            Code::Ldd | Code::Std => (pointer().wrapping_add(u16::from(op.n)), None),
            Code::LdInc | Code::StInc => (pointer(), Some(pointer().wrapping_add(1))),
            Code::LdDec | Code::StDec => {
                let below = pointer().wrapping_sub(1);
                (below, Some(below))
            }
            _ => (op.k, None),
        };
        let cycles = if matches!(op.code, Code::In | Code::Out) {
            1
        } else {
            2
        };
        let at = self.core.cycle + cycles - 1;
        let is_store = matches!(
            op.code,
            Code::Out | Code::Sts | Code::Std | Code::StInc | Code::StDec
        );
        let mut loaded = None;
        if is_store {
            let value = self.core.data[usize::from(op.d)];
            self.write_data(address, value, at, env)?;
        } else {
            loaded = Some(self.read_data(address, at, env)?);
        }
        if let Some(after) = pointer_after {
            self.core.set_pair(op.r, after);
        }
        if let Some(value) = loaded {
            self.core.data[usize::from(op.d)] = value;
        }
        let words = if matches!(op.code, Code::Lds | Code::Sts) {
            2
        } else {
            1
        };
        self.advance(words, cycles);
        Ok(())
    }

    /// Loads from any data address in cycle `at`.
    fn read_data<E: Environment>(
        &mut self,
        address: u16,
        at: u64,
        env: &mut E,
    ) -> Result<u8, Cause> {
        if address > self.device.ram_end() {
            return Err(Cause::BadAddress {
                address,
                is_store: false,
            });
        }
        self.touch(address, false);
        if !(0x20..self.device.sram_start).contains(&address) {
            return Ok(self.core.data[usize::from(address)]);
        }
        self.fire_events(at, env);
        Ok(self.read_io(address, at, env))
    }

    /// Stores to any data address in cycle `at`.
    fn write_data<E: Environment>(
        &mut self,
        address: u16,
        value: u8,
        at: u64,
        env: &mut E,
    ) -> Result<(), Cause> {
        if address > self.device.ram_end() {
            return Err(Cause::BadAddress {
                address,
                is_store: true,
            });
        }
        self.touch(address, true);
        if !(0x20..self.device.sram_start).contains(&address) {
            self.core.data[usize::from(address)] = value;
            return Ok(());
        }
        self.fire_events(at, env);
        self.write_io(address, value, at + 1, env);
        if self.fault.is_some() {
            return self.faulted();
        }
        Ok(())
    }

    /// SBI and CBI touch one bit only: in flag registers and PINx the others are not written.
    fn write_bit<E: Environment>(
        &mut self,
        address: u16,
        mask: u8,
        set: bool,
        at: u64,
        env: &mut E,
    ) -> Result<(), Cause> {
        let is_strobe = matches!(
            address,
            0x23 | 0x26 | 0x29 | io::TIFR0 | io::TIFR1 | io::TIFR2 | io::PCIFR | io::EIFR
        );
        if is_strobe {
            return if set {
                self.write_data(address, mask, at, env)
            } else {
                Ok(())
            };
        }
        let old = self.read_data(address, at, env)?;
        let new = if set { old | mask } else { old & !mask };
        self.write_data(address, new, at, env)
    }

    /// A jump to itself with interrupts enabled: repeats it up to the next event.
    fn idle_loop(&mut self, cycles: u64, until: u64) {
        let gap = self
            .core
            .next_event
            .min(until)
            .saturating_sub(self.core.cycle);
        let rounds = gap.div_ceil(cycles).max(1);
        self.core.cycle += rounds * cycles;
        self.core.instructions += rounds;
    }

    /// Lets the transmitter finish: its bytes appear at their own cycles, after the stop.
    pub(crate) fn drain_transmitter<E: Environment>(&mut self, env: &mut E) {
        while self.usart.is_sending() {
            let Some(at) = self.usart.next_event() else {
                return;
            };
            while let Some(bit_at) = self.usart.line_event().filter(|&bit_at| bit_at <= at) {
                self.step_line(bit_at, env);
            }
            self.step_transmitter(at, env);
        }
    }

    fn invalid_opcode(&self, op: Op) -> Cause {
        let word = self.core.flash()[usize::from(self.core.pc)];
        if op.r == 1 {
            let high = u32::from(word >> 3 & 0x3E | word & 1);
            return Cause::PcOutOfMemory {
                target: (high << 16 | u32::from(op.k)) * 2,
            };
        }
        Cause::InvalidOpcode { word }
    }

    fn pc_out_of_memory(&self, word_address: u16) -> Cause {
        Cause::PcOutOfMemory {
            target: u32::from(word_address) * 2,
        }
    }

    /// RETI, and the stack instructions that the core left to the machine: outside SRAM, or where
    /// a debugger watches.
    fn stack_op(&mut self, op: Op) -> Result<(), Cause> {
        let sp = self.core.sp;
        let fits = match op.code {
            Code::Ret | Code::Reti => self.core.may_pop(2),
            Code::Pop => self.core.may_pop(1),
            Code::Push => self.core.may_push(1),
            _ => self.core.may_push(2),
        };
        if !fits {
            return Err(Cause::StackOutOfMemory { sp });
        }
        match op.code {
            Code::Push => self.push(op.d),
            Code::Pop => self.pop(op.d),
            Code::Call => self.call(op.k, u16::from(op.r), u64::from(op.n)),
            Code::Icall => {
                let target = self.core.pair(30);
                if target > self.core.pc_mask() {
                    return Err(self.pc_out_of_memory(target));
                }
                self.call(target, 1, 3);
            }
            _ => return self.return_from(op.code == Code::Reti),
        }
        Ok(())
    }

    fn push(&mut self, register: u8) {
        self.touch_stack(0, 1, true);
        let sp = self.core.sp;
        self.core.data[usize::from(sp)] = self.core.data[usize::from(register)];
        self.core.sp = sp.wrapping_sub(1);
        self.core.lowest_sp = self.core.lowest_sp.min(self.core.sp);
        self.advance(1, 2);
    }

    fn pop(&mut self, register: u8) {
        self.touch_stack(1, 1, false);
        self.core.sp = self.core.sp.wrapping_add(1);
        self.core.data[usize::from(register)] = self.core.data[usize::from(self.core.sp)];
        self.advance(1, 2);
    }

    fn call(&mut self, target: u16, words: u16, cycles: u64) {
        self.touch_stack(0, 2, true);
        let behind = self.core.pc.wrapping_add(words) & self.core.pc_mask();
        self.core.push_pc(behind);
        self.advance(0, cycles);
        self.core.pc = target;
    }

    fn return_from(&mut self, is_interrupt: bool) -> Result<(), Cause> {
        let sp = self.core.sp;
        let target = self.core.pop_pc();
        if target > self.core.pc_mask() {
            self.core.sp = sp;
            return Err(self.pc_out_of_memory(target));
        }
        if is_interrupt {
            self.compare_context(sp, target);
            self.core.flags.enable_interrupts(true);
            // RETI always lets one instruction of the interrupted program execute.
            self.one_more = true;
        }
        let after = std::mem::replace(&mut self.core.sp, sp);
        self.touch_stack(1, 2, false);
        self.core.sp = after;
        self.advance(0, 4);
        self.core.pc = target;
        Ok(())
    }
}
