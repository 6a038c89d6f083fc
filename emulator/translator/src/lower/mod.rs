//! Lowering: a region becomes one function of host code.
//!
//! The function takes the core, its data space and its program memory, executes until control
//! leaves the region, and says why it left. Wherever it leaves, the core stands exactly between
//! two instructions. A checkpoint is passed only if the cycles left reach to the beginning of the
//! last instruction before the next checkpoint; so no instruction begins at or after the event.

mod instructions;
mod leaving;

use cardan_emulator::engine::{Code, Core, Op};
use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::types::{I8, I32, I64};
use cranelift_codegen::ir::{self, InstBuilder, MemFlagsData, Value};
use cranelift_frontend::FunctionBuilder;

use crate::facts;
use crate::region::{Flow, Instruction, Region};
use crate::state::{Carry, Emit, State, Variables, Zero};

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
}
