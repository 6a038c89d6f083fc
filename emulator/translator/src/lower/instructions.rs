//! Instructions that go on to the next one: memory, stack, I/O registers of the core. (Arithmetic:
//! `arithmetic.rs`.)

use cardan_emulator::engine::{Code, Core, Op};
use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::types::{I8, I64};
use cranelift_codegen::ir::{InstBuilder, Value};

use super::{BYTES, Lower};
use crate::facts;
use crate::region::Instruction;
use crate::state::{Stack, State};

impl Lower<'_, '_> {
    /// Makes sure that base + `from` to base + `to` lie in SRAM.
    pub(super) fn check_ram(
        &mut self,
        state: &State,
        base: Value,
        (from, to): (i64, i64),
        pc: u16,
    ) {
        let above = self.emit.add_imm(base, from - self.ram_start);
        let limit = self.ram_bytes - 1 - (to - from);
        let fits = self.emit.is(IntCC::UnsignedLessThanOrEqual, above, limit);
        self.stay_if(fits, state, pc);
    }

    /// The address base + `offset` of a load or store through pointer `r`, known to lie in SRAM:
    /// the host address of the base, with the offset to be added.
    pub(super) fn data_address(
        &mut self,
        state: &mut State,
        r: u8,
        offset: i64,
        pc: u16,
    ) -> (Value, i32) {
        let (base, at) = self.emit.pair_parts(state, r);
        let here = at + offset;
        let is_known = state
            .in_ram
            .iter()
            .any(|&(known, from, to)| known == base && from <= here && here <= to);
        if !is_known {
            let range = self.reach(r, at, here);
            self.check_ram(state, base, range, pc);
            state.in_ram.push((base, range.0, range.1));
        }
        (self.emit.add(self.data, base), here as i32)
    }

    /// Which offsets the rest of the block accesses through a pointer that has moved by `at`.
    pub(super) fn reach(&self, r: u8, mut at: i64, here: i64) -> (i64, i64) {
        let (mut from, mut to) = (here, here);
        let pointer = 3u64 << r;
        for &Instruction { op, .. } in &self.region.blocks[self.block].instructions[self.index..] {
            let is_access = matches!(
                op.code,
                Code::Ldd | Code::Std | Code::LdInc | Code::StInc | Code::LdDec | Code::StDec
            ) && op.r == r;
            if is_access {
                let offset = match op.code {
                    Code::Ldd | Code::Std => at + i64::from(op.n),
                    Code::LdInc | Code::StInc => {
                        at += 1;
                        at - 1
                    }
                    _ => {
                        at -= 1;
                        at
                    }
                };
                from = from.min(offset);
                to = to.max(offset);
            }
            let is_load = matches!(op.code, Code::Ldd | Code::LdInc | Code::LdDec);
            let overwrites = is_load && pointer & 1 << op.d != 0;
            if overwrites || !is_access && facts::writes(op) & pointer != 0 {
                break;
            }
        }
        (from, to)
    }

    /// Host address of the stack's base, after making sure that what the rest of the block pushes
    /// and pops lies in SRAM; to be used with the delta.
    pub(super) fn stack_address(&mut self, state: &mut State, pc: u16) -> Value {
        let base = self.emit.sp_base(state);
        if state.stack.known.is_none() {
            let range = self.stack_reach(state.stack.delta);
            self.check_ram(state, base, range, pc);
            state.stack.known = Some(range);
        }
        self.emit.add(self.data, base)
    }

    pub(super) fn stack_reach(&self, mut delta: i64) -> (i64, i64) {
        let (mut from, mut to) = (i64::MAX, i64::MIN);
        for &Instruction { op, .. } in &self.region.blocks[self.block].instructions[self.index..] {
            let (low, high, change) = match op.code {
                Code::Push => (delta, delta, -1),
                Code::Call | Code::Icall => (delta - 1, delta, -2),
                Code::Pop => (delta + 1, delta + 1, 1),
                Code::Ret => (delta + 1, delta + 2, 2),
                Code::OutSpl | Code::OutSph => break,
                _ => continue,
            };
            from = from.min(low);
            to = to.max(high);
            delta += change;
        }
        (from, to)
    }

    pub(super) fn push_return(&mut self, state: &mut State, pc: u16, return_pc: u16) {
        let address = self.stack_address(state, pc);
        let word = (return_pc & self.pc_mask as u16).swap_bytes();
        let value = self.emit.constant(i64::from(word));
        let ins = self.emit.builder.ins();
        ins.istore16(BYTES, value, address, (state.stack.delta - 1) as i32);
        state.stack.push(2);
    }

    /// Any instruction that goes on to the next one.
    pub(super) fn lower_instruction(&mut self, state: &mut State, instruction: Instruction) {
        let Instruction { pc, op } = instruction;
        match op.code {
            Code::Nop | Code::Jump => {}
            Code::Call => self.push_return(state, pc, pc.wrapping_add(u16::from(op.r))),
            Code::Push => {
                let address = self.stack_address(state, pc);
                let value = self.emit.register(state, op.d);
                let ins = self.emit.builder.ins();
                ins.istore8(BYTES, value, address, state.stack.delta as i32);
                state.stack.push(1);
            }
            Code::Pop => {
                let address = self.stack_address(state, pc);
                state.stack.delta += 1;
                let ins = self.emit.builder.ins();
                let value = ins.uload8(I64, BYTES, address, state.stack.delta as i32);
                self.emit.set_register(state, op.d, value);
            }
            Code::Lds => {
                let ins = self.emit.builder.ins();
                let value = ins.uload8(I64, BYTES, self.data, i32::from(op.k));
                self.emit.set_register(state, op.d, value);
            }
            Code::Sts => {
                let value = self.emit.register(state, op.d);
                let ins = self.emit.builder.ins();
                ins.istore8(BYTES, value, self.data, i32::from(op.k));
            }
            Code::Ldd | Code::LdInc | Code::LdDec => self.lower_load(state, instruction),
            Code::Std | Code::StInc | Code::StDec => self.lower_store(state, instruction),
            Code::Lpm | Code::LpmInc => {
                let is_special = self.load(I8, Core::LAYOUT.lpm_in_machine);
                let is_plain = self.emit.is(IntCC::Equal, is_special, 0);
                self.stay_if(is_plain, state, pc);
                let z = self.emit.pair(state, 30);
                let index = self.emit.mask(z, self.pc_mask * 2 + 1);
                let address = self.emit.add(self.flash, index);
                let ins = self.emit.builder.ins();
                let value = ins.uload8(I64, BYTES, address, 0);
                if op.code == Code::LpmInc {
                    self.move_pointer(state, 30, 1);
                }
                self.emit.set_register(state, op.d, value);
            }
            Code::OutSreg => {
                let value = self.emit.register(state, op.d);
                let enables = self.emit.enables(state);
                let rises = self.emit.and_not(value, enables);
                let rises = self.emit.mask(rises, 0x80);
                let stays = self.emit.is(IntCC::Equal, rises, 0);
                self.stay_if(stays, state, pc);
                self.emit.set_sreg(state, value);
            }
            Code::InSreg => {
                let value = self.emit.sreg(state);
                self.emit.set_register(state, op.d, value);
            }
            Code::InSpl => {
                let sp = self.emit.sp(state);
                let value = self.emit.byte(sp);
                self.emit.set_register(state, op.d, value);
            }
            Code::InSph => {
                let sp = self.emit.sp(state);
                let value = self.emit.right(sp, 8);
                self.emit.set_register(state, op.d, value);
            }
            Code::OutSpl | Code::OutSph => self.lower_out_sp(state, op),
            _ => self.emit.lower_arithmetic(state, op),
        }
    }

    pub(super) fn move_pointer(&mut self, state: &mut State, r: u8, by: i64) {
        let (base, offset) = self.emit.pair_parts(state, r);
        self.emit.set_pair(state, r, base, offset + by);
    }

    pub(super) fn lower_load(&mut self, state: &mut State, Instruction { pc, op }: Instruction) {
        let offset = match op.code {
            Code::Ldd => i64::from(op.n),
            Code::LdDec => -1,
            _ => 0,
        };
        let (address, at) = self.data_address(state, op.r, offset, pc);
        let value = self.emit.builder.ins().uload8(I64, BYTES, address, at);
        match op.code {
            Code::LdInc => self.move_pointer(state, op.r, 1),
            Code::LdDec => self.move_pointer(state, op.r, -1),
            _ => {}
        }
        self.emit.set_register(state, op.d, value);
    }

    pub(super) fn lower_store(&mut self, state: &mut State, Instruction { pc, op }: Instruction) {
        let offset = match op.code {
            Code::Std => i64::from(op.n),
            Code::StDec => -1,
            _ => 0,
        };
        let (address, at) = self.data_address(state, op.r, offset, pc);
        let value = self.emit.register(state, op.d);
        self.emit.builder.ins().istore8(BYTES, value, address, at);
        match op.code {
            Code::StInc => self.move_pointer(state, op.r, 1),
            Code::StDec => self.move_pointer(state, op.r, -1),
            _ => {}
        }
    }

    pub(super) fn lower_out_sp(&mut self, state: &mut State, op: Op) {
        let lowest = self.emit.lowest_sp(state);
        state.lowest_sp = Some(lowest);
        let sp = self.emit.sp(state);
        let value = self.emit.register(state, op.d);
        let sp = if op.code == Code::OutSpl {
            let high = self.emit.mask(sp, 0xFF00);
            self.emit.or(high, value)
        } else {
            let low = self.emit.byte(sp);
            let high = self.emit.left(value, 8);
            self.emit.or(low, high)
        };
        if op.code == Code::OutSpl {
            state.lowest_sp = Some(self.emit.builder.ins().umin(lowest, sp));
        }
        state.stack = Stack {
            base: Some(sp),
            ..Stack::default()
        };
    }
}
