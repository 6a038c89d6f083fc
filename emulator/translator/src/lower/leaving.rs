//! Ways out of a block: to another one, with the state handed over in variables, or out of the
//! region, with the state written back.

use cardan_emulator::engine::Core;
use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::types::{I32, I64};
use cranelift_codegen::ir::{self, InstBuilder, Value};

use super::{Lower, PLAIN, Place, left};
use crate::facts::bit;
use crate::region::{Flow, Target};
use crate::state::{Byte, Carry, Half, Signs, State, Zero};

impl Lower<'_, '_> {
    /// Leaves the region, with everything written back.
    pub(super) fn leave(&mut self, state: &mut State, why: u32, place: Place) {
        let layout = Core::LAYOUT;
        self.write_registers(state);
        if state.dirty & bit::CARRY != 0 {
            let value = self.emit.carry(state);
            self.store8(value, layout.carry);
        }
        if state.dirty & bit::ZERO != 0 {
            let value = self.emit.zero(state);
            self.store8(value, layout.zero);
        }
        if state.dirty & bit::SIGNS != 0 {
            let negative = self.emit.negative(state);
            let overflow = self.emit.overflow(state);
            let overflow = self.emit.left(overflow, 8);
            let signs = self.emit.or(negative, overflow);
            let ins = self.emit.builder.ins();
            ins.istore32(PLAIN, signs, self.core, layout.signs as i32);
        }
        if state.dirty & bit::HALF != 0 {
            let value = self.emit.half(state);
            self.store8(value, layout.half);
        }
        if state.dirty & bit::ENABLES != 0 {
            let value = self.emit.enables(state);
            self.store8(value, layout.enables);
        }
        if state.dirty & bit::STACK != 0 {
            let sp = self.emit.sp(state);
            self.store16(sp, layout.sp);
            let lowest = self.emit.lowest_sp(state);
            self.store16(lowest, layout.lowest_sp);
        }
        let left = self.emit.old(self.emit.vars.left);
        let left = self.emit.add_imm(left, -state.cycles);
        let next_event = self.load(I64, layout.next_event);
        let cycle = self.emit.sub(next_event, left);
        let ins = self.emit.builder.ins();
        ins.store(PLAIN, cycle, self.core, layout.cycle as i32);
        let instructions = self.emit.old(self.emit.vars.instructions);
        let instructions = self.emit.add_imm(instructions, state.instructions);
        let ins = self.emit.builder.ins();
        ins.store(PLAIN, instructions, self.core, layout.instructions as i32);
        let pc = match place {
            Place::At(pc) => self.emit.constant(i64::from(pc)),
            Place::Computed(value) => value,
        };
        self.store16(pc, layout.pc);
        let why = self.emit.builder.ins().iconst(I32, i64::from(why));
        self.emit.builder.ins().return_(&[why]);
    }

    pub(super) fn write_registers(&mut self, state: &mut State) {
        for i in 0..16u8 {
            let (low, high) = (i * 2, i * 2 + 1);
            let both = 3 << low;
            if state.dirty & both == both && state.pairs[usize::from(i)].is_some() {
                let value = self.emit.pair(state, low);
                let ins = self.emit.builder.ins();
                ins.istore16(PLAIN, value, self.data, i32::from(low));
                continue;
            }
            for register in [low, high] {
                if state.dirty & 1 << register != 0 {
                    let value = self.emit.register(state, register);
                    let ins = self.emit.builder.ins();
                    ins.istore8(PLAIN, value, self.data, i32::from(register));
                }
            }
        }
        state.dirty &= !bit::REGISTERS;
    }

    /// Writes registers back before the end of a block behind which they would be anyway.
    pub(super) fn write_registers_early(&mut self, state: &mut State, flow: Flow) {
        let keeps = |target| matches!(target, Target::Inside(to) if self.region.keeps_registers(self.block, to));
        let is_early = match flow {
            Flow::Next(to) | Flow::Return { to, .. } => !keeps(to),
            Flow::Branch { taken, other, .. } => !keeps(taken) && !keeps(other),
            Flow::Anywhere => false,
        };
        if is_early {
            self.write_registers(state);
        }
    }

    pub(super) fn store8(&mut self, value: Value, offset: usize) {
        let ins = self.emit.builder.ins();
        ins.istore8(PLAIN, value, self.core, offset as i32);
    }

    pub(super) fn store16(&mut self, value: Value, offset: usize) {
        let ins = self.emit.builder.ins();
        ins.istore16(PLAIN, value, self.core, offset as i32);
    }

    /// Goes on if `condition` is not zero, else leaves before the instruction at `pc`.
    pub(super) fn stay_if(&mut self, condition: Value, state: &State, pc: u16) {
        self.stay_or_leave(condition, state, left::INTERPRETER, pc);
    }

    pub(super) fn stay_or_leave(&mut self, condition: Value, state: &State, why: u32, pc: u16) {
        let (stay, cold) = self.branch(condition);
        self.emit.builder.set_cold_block(cold);
        self.emit.builder.switch_to_block(cold);
        let mut copy = state.clone();
        self.leave(&mut copy, why, Place::At(pc));
        self.emit.builder.switch_to_block(stay);
    }

    /// Branches to two new blocks.
    pub(super) fn branch(&mut self, condition: Value) -> (ir::Block, ir::Block) {
        let builder = &mut *self.emit.builder;
        let (yes, no) = (builder.create_block(), builder.create_block());
        builder.ins().brif(condition, yes, &[], no, &[]);
        builder.seal_block(yes);
        builder.seal_block(no);
        (yes, no)
    }

    /// The end of a block, towards `target`.
    pub(super) fn edge(&mut self, state: &mut State, target: Target) {
        let next = match target {
            Target::Outside(pc) => return self.leave(state, left::REGION, Place::At(pc)),
            Target::Machine(pc) => return self.leave(state, left::MACHINE, Place::At(pc)),
            Target::Interpreter(pc) => return self.leave(state, left::INTERPRETER, Place::At(pc)),
            Target::Inside(next) => next,
        };
        let block = &self.region.blocks[next];
        let vars = self.emit.vars;
        let left = self.emit.old(vars.left);
        let left = self.emit.add_imm(left, -state.cycles);
        if block.is_checkpoint {
            let enough = self.emit.is(IntCC::SignedGreaterThan, left, block.reach);
            self.stay_or_leave(enough, state, left::BUDGET, block.instructions[0].pc);
        }
        let instructions = self.emit.old(vars.instructions);
        let instructions = self.emit.add_imm(instructions, state.instructions);
        if !self.region.keeps_registers(self.block, next) {
            self.write_registers(state);
        }
        self.hand_over(state, block.live_in);
        self.emit.builder.def_var(vars.left, left);
        self.emit.builder.def_var(vars.instructions, instructions);
        self.emit.builder.ins().jump(self.blocks[next], &[]);
    }

    /// Brings what the block has written into the variables, of the lazy flags those in `live`.
    pub(super) fn hand_over(&mut self, state: &mut State, live: u64) {
        let vars = self.emit.vars;
        for i in 0..32u8 {
            if !matches!(state.registers[usize::from(i)], Byte::Old) {
                let value = self.emit.register(state, i);
                self.emit
                    .builder
                    .def_var(vars.registers[usize::from(i)], value);
            }
        }
        if live & bit::CARRY != 0 && !matches!(state.carry, Carry::Old) {
            let value = self.emit.carry(state);
            self.emit.builder.def_var(vars.carry, value);
        }
        if live & bit::ZERO != 0 && !matches!(state.zero, Zero::Old) {
            let value = self.emit.zero(state);
            self.emit.builder.def_var(vars.zero, value);
        }
        if live & bit::SIGNS != 0 && !matches!(state.signs, Signs::Old) {
            let negative = self.emit.negative(state);
            let overflow = self.emit.overflow(state);
            self.emit.builder.def_var(vars.negative, negative);
            self.emit.builder.def_var(vars.overflow, overflow);
        }
        if live & bit::HALF != 0 && !matches!(state.half, Half::Old) {
            let value = self.emit.half(state);
            self.emit.builder.def_var(vars.half, value);
        }
        if let Some(value) = state.enables {
            self.emit.builder.def_var(vars.enables, value);
        }
        if state.stack.base.is_some() {
            let lowest = self.emit.lowest_sp(state);
            let sp = self.emit.sp(state);
            self.emit.builder.def_var(vars.lowest_sp, lowest);
            self.emit.builder.def_var(vars.sp, sp);
        }
    }
}
