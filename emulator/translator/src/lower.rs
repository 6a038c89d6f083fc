//! Lowering: a region becomes one function of host code.
//!
//! The function takes the core, its data space and its program memory, executes until control
//! leaves the region, and says why it left. Wherever it leaves, the core stands exactly between
//! two instructions. A checkpoint is passed only if the cycles left reach to the beginning of the
//! last instruction before the next checkpoint; so no instruction begins at or after the event.

use cardan_emulator::engine::{Code, Core, Op};
use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::types::{I8, I32, I64};
use cranelift_codegen::ir::{self, InstBuilder, MemFlagsData, Value};
use cranelift_frontend::FunctionBuilder;

use crate::facts::{self, bit};
use crate::region::{Flow, Instruction, Region, Target};
use crate::state::{Byte, Carry, Emit, Half, Signs, Stack, State, Variables, Zero};

/// Why translated code returned.
pub(crate) mod left {
    /// The program counter stands anywhere: look for the code of that place.
    pub(crate) const REGION: u32 = 0;
    /// The interpreter has to go on from here.
    pub(crate) const INTERPRETER: u32 = 1;
    /// The instruction is the machine's.
    pub(crate) const MACHINE: u32 = 2;
    /// The cycles left do not reach to the next checkpoint.
    pub(crate) const BUDGET: u32 = 3;
}

/// Program counter on leaving.
#[derive(Clone, Copy)]
enum Place {
    At(u16),
    Computed(Value),
}

const PLAIN: MemFlagsData = MemFlagsData::trusted();
/// SRAM bytes and words at any address.
const BYTES: MemFlagsData = MemFlagsData::new().with_notrap();

struct Lower<'a, 'b> {
    emit: Emit<'a, 'b>,
    region: &'a Region,
    blocks: Vec<ir::Block>,
    core: Value,
    data: Value,
    flash: Value,
    /// Number of the entry.
    entry: Value,
    ram_start: i64,
    ram_bytes: i64,
    pc_mask: i64,
    /// The block under way and the place in it, for looking ahead.
    block: usize,
    index: usize,
}

/// Emits the function of a region. Its parameters are pointers to the core, its data and flash,
/// and the number of the entry.
pub(crate) fn lower(region: &Region, core: &Core, builder: &mut FunctionBuilder<'_>) {
    let vars = Variables::new(builder);
    let entry = builder.create_block();
    builder.func.layout.append_block(entry);
    builder.append_block_params_for_function_params(entry);
    let parameters = builder.block_params(entry).to_vec();
    let blocks: Vec<ir::Block> = region
        .blocks
        .iter()
        .map(|_| builder.create_block())
        .collect();
    let (ram_start, ram_bytes) = core.ram();
    let mut lower = Lower {
        emit: Emit {
            builder,
            vars: &vars,
            used: [false; Variables::COUNT],
        },
        region,
        blocks,
        core: parameters[0],
        data: parameters[1],
        flash: parameters[2],
        entry: parameters[3],
        ram_start: i64::from(ram_start),
        ram_bytes: i64::from(ram_bytes),
        pc_mask: i64::from(core.pc_mask()),
        block: 0,
        index: 0,
    };
    for i in 0..region.blocks.len() {
        lower.lower_block(i);
    }
    // Only now it is known which parts of the state the region looks at.
    lower.lower_entry(entry);
    lower.emit.builder.seal_all_blocks();
}

impl Lower<'_, '_> {
    fn load(&mut self, ty: ir::Type, offset: usize) -> Value {
        let value = self
            .emit
            .builder
            .ins()
            .load(ty, PLAIN, self.core, offset as i32);
        if ty == I64 {
            return value;
        }
        self.emit.builder.ins().uextend(I64, value)
    }

    fn lower_entry(&mut self, entry: ir::Block) {
        self.emit.builder.switch_to_block(entry);
        let layout = Core::LAYOUT;
        let vars = self.emit.vars;
        for i in 0..32 {
            if self.emit.is_used(vars.registers[i]) {
                let ins = self.emit.builder.ins();
                let value = ins.uload8(I64, PLAIN, self.data, i as i32);
                self.emit.builder.def_var(vars.registers[i], value);
            }
        }
        let next_event = self.load(I64, layout.next_event);
        let cycle = self.load(I64, layout.cycle);
        let left = self.emit.sub(next_event, cycle);
        self.emit.builder.def_var(vars.left, left);
        let loads = [
            (vars.carry, I8, layout.carry),
            (vars.zero, I8, layout.zero),
            (vars.half, I8, layout.half),
            (vars.enables, I8, layout.enables),
            (vars.sp, ir::types::I16, layout.sp),
            (vars.lowest_sp, ir::types::I16, layout.lowest_sp),
            (vars.instructions, I64, layout.instructions),
        ];
        for (variable, ty, offset) in loads {
            if self.emit.is_used(variable) {
                let value = self.load(ty, offset);
                self.emit.builder.def_var(variable, value);
            }
        }
        if self.emit.is_used(vars.negative) || self.emit.is_used(vars.overflow) {
            let signs = self.load(I32, layout.signs);
            let negative = self.emit.byte(signs);
            let overflow = self.emit.right(signs, 8);
            self.emit.builder.def_var(vars.negative, negative);
            self.emit.builder.def_var(vars.overflow, overflow);
        }
        let refuse = self.emit.builder.create_block();
        self.emit.builder.set_cold_block(refuse);
        let heads: Vec<ir::Block> = self
            .region
            .entries
            .iter()
            .map(|_| self.emit.builder.create_block())
            .collect();
        if heads.len() == 1 {
            self.emit.builder.ins().jump(heads[0], &[]);
        } else {
            self.choose_entry(&heads, refuse);
        }
        for (&i, &head) in self.region.entries.iter().zip(&heads) {
            self.emit.builder.switch_to_block(head);
            let reach = self.region.blocks[i].reach;
            let enough = self.emit.is(IntCC::SignedGreaterThan, left, reach);
            let ins = self.emit.builder.ins();
            ins.brif(enough, self.blocks[i], &[], refuse, &[]);
        }
        self.emit.builder.switch_to_block(refuse);
        let why = i64::from(left::BUDGET);
        let why = self.emit.builder.ins().iconst(I32, why);
        self.emit.builder.ins().return_(&[why]);
    }

    fn choose_entry(&mut self, heads: &[ir::Block], none: ir::Block) {
        let builder = &mut *self.emit.builder;
        let pool = &mut builder.func.dfg.value_lists;
        let calls: Vec<ir::BlockCall> = heads
            .iter()
            .map(|&head| ir::BlockCall::new(head, [], pool))
            .collect();
        let default = ir::BlockCall::new(none, [], pool);
        let table = builder.create_jump_table(ir::JumpTableData::new(default, &calls));
        builder.ins().br_table(self.entry, table);
    }

    /// Leaves the region, with everything written back.
    fn leave(&mut self, state: &mut State, why: u32, place: Place) {
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

    fn write_registers(&mut self, state: &mut State) {
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
    fn write_registers_early(&mut self, state: &mut State, flow: Flow) {
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

    fn store8(&mut self, value: Value, offset: usize) {
        let ins = self.emit.builder.ins();
        ins.istore8(PLAIN, value, self.core, offset as i32);
    }

    fn store16(&mut self, value: Value, offset: usize) {
        let ins = self.emit.builder.ins();
        ins.istore16(PLAIN, value, self.core, offset as i32);
    }

    /// Goes on if `condition` is not zero, else leaves before the instruction at `pc`.
    fn stay_if(&mut self, condition: Value, state: &State, pc: u16) {
        self.stay_or_leave(condition, state, left::INTERPRETER, pc);
    }

    fn stay_or_leave(&mut self, condition: Value, state: &State, why: u32, pc: u16) {
        let (stay, cold) = self.branch(condition);
        self.emit.builder.set_cold_block(cold);
        self.emit.builder.switch_to_block(cold);
        let mut copy = state.clone();
        self.leave(&mut copy, why, Place::At(pc));
        self.emit.builder.switch_to_block(stay);
    }

    /// Branches to two new blocks.
    fn branch(&mut self, condition: Value) -> (ir::Block, ir::Block) {
        let builder = &mut *self.emit.builder;
        let (yes, no) = (builder.create_block(), builder.create_block());
        builder.ins().brif(condition, yes, &[], no, &[]);
        builder.seal_block(yes);
        builder.seal_block(no);
        (yes, no)
    }

    /// The end of a block, towards `target`.
    fn edge(&mut self, state: &mut State, target: Target) {
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
    fn hand_over(&mut self, state: &mut State, live: u64) {
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

    fn lower_block(&mut self, number: usize) {
        self.emit.builder.switch_to_block(self.blocks[number]);
        let region = self.region;
        let block = &region.blocks[number];
        self.block = number;
        let mut state = State::new(block.dirty_in);
        let last = block.instructions.len() - 1;
        for (i, &instruction) in block.instructions.iter().enumerate() {
            self.index = i;
            if i == last && !matches!(block.flow, Flow::Next(_)) {
                self.lower_last(&mut state, instruction, block.flow);
                return;
            }
            self.lower_instruction(&mut state, instruction);
            self.retire(&mut state, instruction.op);
        }
        if let Flow::Next(target) = block.flow {
            self.write_registers_early(&mut state, block.flow);
            self.edge(&mut state, target);
        }
    }

    fn retire(&mut self, state: &mut State, op: Op) {
        state.cycles += facts::cycles(op);
        state.instructions += 1;
        state.dirty |= facts::writes(op);
    }

    /// The last instruction of a block that does not simply go on.
    fn lower_last(&mut self, state: &mut State, instruction: Instruction, flow: Flow) {
        let op = instruction.op;
        match flow {
            Flow::Branch {
                taken,
                extra_cycles,
                other,
            } => {
                let (condition, is_taken) = self.condition(state, op);
                self.retire(state, op);
                self.write_registers_early(state, flow);
                let (yes, no) = self.branch(condition);
                let targets = if is_taken {
                    [(yes, taken, extra_cycles), (no, other, 0)]
                } else {
                    [(yes, other, 0), (no, taken, extra_cycles)]
                };
                for (block, target, extra) in targets {
                    self.emit.builder.switch_to_block(block);
                    let mut copy = state.clone();
                    copy.cycles += extra;
                    self.edge(&mut copy, target);
                }
            }
            Flow::Return { expected, to } => {
                let address = self.stack_address(state, instruction.pc);
                let ins = self.emit.builder.ins();
                let found = ins.load(
                    ir::types::I16,
                    BYTES,
                    address,
                    (state.stack.delta + 1) as i32,
                );
                let found = self.emit.builder.ins().uextend(I64, found);
                let is_expected =
                    self.emit
                        .is(IntCC::Equal, found, i64::from(expected.swap_bytes()));
                self.stay_if(is_expected, state, instruction.pc);
                state.stack.delta += 2;
                self.retire(state, op);
                self.write_registers_early(state, flow);
                self.edge(state, to);
            }
            Flow::Anywhere | Flow::Next(_) => self.lower_anywhere(state, instruction),
        }
    }

    /// RET, IJMP, ICALL to an address known at run time only.
    fn lower_anywhere(&mut self, state: &mut State, Instruction { pc, op }: Instruction) {
        let target = if op.code == Code::Ret {
            let address = self.stack_address(state, pc);
            let delta = state.stack.delta as i32;
            let ins = self.emit.builder.ins();
            let high = ins.uload8(I64, BYTES, address, delta + 1);
            let ins = self.emit.builder.ins();
            let low = ins.uload8(I64, BYTES, address, delta + 2);
            let high = self.emit.left(high, 8);
            self.emit.or(low, high)
        } else {
            self.emit.pair(state, 30)
        };
        let exists = self
            .emit
            .is(IntCC::UnsignedLessThanOrEqual, target, self.pc_mask);
        self.stay_if(exists, state, pc);
        match op.code {
            Code::Ret => state.stack.delta += 2,
            Code::Icall => self.push_return(state, pc, pc.wrapping_add(1)),
            _ => {}
        }
        self.retire(state, op);
        self.leave(state, left::REGION, Place::Computed(target));
    }

    /// A value and whether the branch is taken, or the skip made, if it is not zero.
    fn condition(&mut self, state: &mut State, op: Op) -> (Value, bool) {
        let emit = &mut self.emit;
        match op.code {
            Code::Brcs | Code::Brcc => {
                let value = match state.carry {
                    Carry::Top(value, 63) => emit.is(IntCC::SignedLessThan, value, 0),
                    Carry::Top(value, bit) if bit > 0 => emit.mask(value, 1 << bit),
                    _ => emit.carry(state),
                };
                (value, op.code == Code::Brcs)
            }
            Code::Breq | Code::Brne => (
                match state.zero {
                    Zero::Word(value) => value,
                    _ => emit.zero(state),
                },
                op.code == Code::Brne,
            ),
            Code::Brmi | Code::Brpl => {
                let negative = emit.negative(state);
                (emit.mask(negative, 0x80), op.code == Code::Brmi)
            }
            Code::Brlt | Code::Brge => {
                let less = emit.less(state);
                (emit.mask(less, 0x80), op.code == Code::Brlt)
            }
            Code::Brbs | Code::Brbc => {
                let value = match op.r {
                    0x08 => {
                        let overflow = emit.overflow(state);
                        emit.mask(overflow, 0x80)
                    }
                    0x20 => {
                        let half = emit.half(state);
                        emit.mask(half, 0x10)
                    }
                    mask => {
                        let enables = emit.enables(state);
                        emit.mask(enables, i64::from(mask))
                    }
                };
                (value, op.code == Code::Brbs)
            }
            Code::Cpse => {
                let d = emit.register(state, op.d);
                let r = emit.register(state, op.r);
                (emit.xor(d, r), false)
            }
            // SBRC and SBRS.
            _ => {
                let d = emit.register(state, op.d);
                (emit.mask(d, i64::from(op.r)), op.code == Code::Sbrs)
            }
        }
    }

    /// Makes sure that base + `from` to base + `to` lie in SRAM.
    fn check_ram(&mut self, state: &State, base: Value, (from, to): (i64, i64), pc: u16) {
        let above = self.emit.add_imm(base, from - self.ram_start);
        let limit = self.ram_bytes - 1 - (to - from);
        let fits = self.emit.is(IntCC::UnsignedLessThanOrEqual, above, limit);
        self.stay_if(fits, state, pc);
    }

    /// The address base + `offset` of a load or store through pointer `r`, known to lie in SRAM:
    /// the host address of the base, with the offset to be added.
    fn data_address(&mut self, state: &mut State, r: u8, offset: i64, pc: u16) -> (Value, i32) {
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
    fn reach(&self, r: u8, mut at: i64, here: i64) -> (i64, i64) {
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
    fn stack_address(&mut self, state: &mut State, pc: u16) -> Value {
        let base = self.emit.sp_base(state);
        if state.stack.known.is_none() {
            let range = self.stack_reach(state.stack.delta);
            self.check_ram(state, base, range, pc);
            state.stack.known = Some(range);
        }
        self.emit.add(self.data, base)
    }

    fn stack_reach(&self, mut delta: i64) -> (i64, i64) {
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

    fn push_return(&mut self, state: &mut State, pc: u16, return_pc: u16) {
        let address = self.stack_address(state, pc);
        let word = (return_pc & self.pc_mask as u16).swap_bytes();
        let value = self.emit.constant(i64::from(word));
        let ins = self.emit.builder.ins();
        ins.istore16(BYTES, value, address, (state.stack.delta - 1) as i32);
        state.stack.push(2);
    }

    /// Any instruction that goes on to the next one.
    fn lower_instruction(&mut self, state: &mut State, instruction: Instruction) {
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

    fn move_pointer(&mut self, state: &mut State, r: u8, by: i64) {
        let (base, offset) = self.emit.pair_parts(state, r);
        self.emit.set_pair(state, r, base, offset + by);
    }

    fn lower_load(&mut self, state: &mut State, Instruction { pc, op }: Instruction) {
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

    fn lower_store(&mut self, state: &mut State, Instruction { pc, op }: Instruction) {
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

    fn lower_out_sp(&mut self, state: &mut State, op: Op) {
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
