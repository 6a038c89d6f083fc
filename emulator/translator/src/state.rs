//! The state of the chip while a block is translated: for each register, flag and the stack
//! pointer in which form its value is at hand. A form becomes an explicit value only where
//! somebody needs it.

use cranelift_codegen::entity::EntityRef;
use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::{InstBuilder, Value, types::I64};
use cranelift_frontend::{FunctionBuilder, Variable};

/// Variables of the function, one for each part of the state.
#[derive(Clone)]
pub(crate) struct Variables {
    pub(crate) registers: [Variable; 32],
    /// 0 or 1.
    pub(crate) carry: Variable,
    /// Zero if the flag is set, also in its lowest byte.
    pub(crate) zero: Variable,
    /// N in bit 7.
    pub(crate) negative: Variable,
    /// V in bit 7; S is its exclusive or with N and bit 15.
    pub(crate) overflow: Variable,
    /// Bit 4.
    pub(crate) half: Variable,
    pub(crate) enables: Variable,
    pub(crate) sp: Variable,
    pub(crate) lowest_sp: Variable,
    /// Cycles left until the next event.
    pub(crate) left: Variable,
    pub(crate) instructions: Variable,
}

impl Variables {
    pub(crate) const COUNT: usize = 42;

    pub(crate) fn new(builder: &mut FunctionBuilder<'_>) -> Variables {
        let mut new = || builder.declare_var(I64);
        Variables {
            registers: std::array::from_fn(|_| new()),
            carry: new(),
            zero: new(),
            negative: new(),
            overflow: new(),
            half: new(),
            enables: new(),
            sp: new(),
            lowest_sp: new(),
            left: new(),
            instructions: new(),
        }
    }
}

/// A byte of a register; all values are zero-extended to 64 bits.
#[derive(Clone, Copy)]
pub(crate) enum Byte {
    /// As it was when the block was entered.
    Old,
    Is(Value),
    /// Lower and upper byte of base + offset.
    Low(Value, i64),
    High(Value, i64),
}

#[derive(Clone, Copy)]
pub(crate) enum Carry {
    Old,
    One,
    Zero,
    /// A bit of a value that has no bits above it.
    Top(Value, i64),
    Lowest(Value),
}

#[derive(Clone, Copy)]
pub(crate) enum Zero {
    Old,
    Is(Value),
    /// Of a 16-bit result.
    Word(Value),
}

/// How an operation overflows: bit 7 of what the variant says.
#[derive(Clone, Copy)]
pub(crate) enum Overflow {
    No,
    /// (d ^ result) & (r ^ result)
    Add(Value, Value, Value),
    /// (d ^ r) & (d ^ result)
    Sub(Value, Value, Value),
    /// a & !b
    AndNot(Value, Value),
    /// result ^ out << 7
    Shift(Value, Value),
}

#[derive(Clone, Copy)]
pub(crate) enum Signs {
    Old,
    /// The byte whose bit 7 is N.
    New(Value, Overflow),
    /// The lower byte's bit 15 is N: that of a 16-bit result.
    Word(Value, Value, Value),
}

#[derive(Clone, Copy)]
pub(crate) enum Half {
    Old,
    /// Bit 4 of the exclusive or.
    Xor(Value, Value, Value),
    Is(Value),
}

/// The stack pointer as base + delta; SRAM has been checked for all it points to.
#[derive(Clone, Copy, Default)]
pub(crate) struct Stack {
    pub(crate) base: Option<Value>,
    pub(crate) delta: i64,
    /// Lowest delta after a push, since `lowest_sp` was brought up to date.
    pub(crate) lowest: Option<i64>,
    /// Deltas of addresses that are known to lie in SRAM: from, to.
    pub(crate) known: Option<(i64, i64)>,
}

impl Stack {
    /// Moves the stack pointer for a push.
    pub(crate) fn push(&mut self, bytes: i64) {
        self.delta -= bytes;
        let lowest = self.lowest.unwrap_or(self.delta);
        self.lowest = Some(lowest.min(self.delta));
    }
}

/// State within a block.
#[derive(Clone)]
pub(crate) struct State {
    pub(crate) registers: [Byte; 32],
    /// Values of even pairs, as base + offset.
    pub(crate) pairs: [Option<(Value, i64)>; 16],
    /// Addresses known to lie in SRAM: base, from, to.
    pub(crate) in_ram: Vec<(Value, i64, i64)>,
    pub(crate) carry: Carry,
    pub(crate) zero: Zero,
    pub(crate) signs: Signs,
    pub(crate) half: Half,
    pub(crate) enables: Option<Value>,
    pub(crate) stack: Stack,
    pub(crate) lowest_sp: Option<Value>,
    /// Cycles and instructions since the block was entered.
    pub(crate) cycles: i64,
    pub(crate) instructions: i64,
    /// What may differ from the core's memory, see [`crate::facts::bit`].
    pub(crate) dirty: u64,
}

impl State {
    /// State on entering a block.
    pub(crate) fn new(dirty: u64) -> State {
        State {
            registers: [Byte::Old; 32],
            pairs: [None; 16],
            in_ram: Vec::new(),
            carry: Carry::Old,
            zero: Zero::Old,
            signs: Signs::Old,
            half: Half::Old,
            enables: None,
            stack: Stack::default(),
            lowest_sp: None,
            cycles: 0,
            instructions: 0,
            dirty,
        }
    }
}

/// Emits arithmetic on 64-bit values.
pub(crate) struct Emit<'a, 'b> {
    pub(crate) builder: &'a mut FunctionBuilder<'b>,
    pub(crate) vars: &'a Variables,
    /// Which variables were read as somebody else left them.
    pub(crate) used: [bool; Variables::COUNT],
}

impl Emit<'_, '_> {
    pub(crate) fn constant(&mut self, value: i64) -> Value {
        self.builder.ins().iconst(I64, value)
    }
    pub(crate) fn add(&mut self, a: Value, b: Value) -> Value {
        self.builder.ins().iadd(a, b)
    }
    pub(crate) fn add_imm(&mut self, a: Value, k: i64) -> Value {
        if k == 0 {
            return a;
        }
        self.builder.ins().iadd_imm_s(a, k)
    }
    pub(crate) fn sub(&mut self, a: Value, b: Value) -> Value {
        self.builder.ins().isub(a, b)
    }
    pub(crate) fn and(&mut self, a: Value, b: Value) -> Value {
        self.builder.ins().band(a, b)
    }
    pub(crate) fn and_not(&mut self, a: Value, b: Value) -> Value {
        self.builder.ins().band_not(a, b)
    }
    pub(crate) fn mask(&mut self, a: Value, k: i64) -> Value {
        self.builder.ins().band_imm_s(a, k)
    }
    pub(crate) fn byte(&mut self, a: Value) -> Value {
        self.mask(a, 0xFF)
    }
    pub(crate) fn word(&mut self, a: Value) -> Value {
        self.mask(a, 0xFFFF)
    }
    pub(crate) fn or(&mut self, a: Value, b: Value) -> Value {
        self.builder.ins().bor(a, b)
    }
    pub(crate) fn or_imm(&mut self, a: Value, k: i64) -> Value {
        self.builder.ins().bor_imm_s(a, k)
    }
    pub(crate) fn xor(&mut self, a: Value, b: Value) -> Value {
        self.builder.ins().bxor(a, b)
    }
    pub(crate) fn xor_imm(&mut self, a: Value, k: i64) -> Value {
        self.builder.ins().bxor_imm_s(a, k)
    }
    pub(crate) fn left(&mut self, a: Value, bits: i64) -> Value {
        if bits == 0 {
            return a;
        }
        self.builder.ins().ishl_imm_s(a, bits)
    }
    pub(crate) fn right(&mut self, a: Value, bits: i64) -> Value {
        if bits == 0 {
            return a;
        }
        self.builder.ins().ushr_imm_s(a, bits)
    }
    pub(crate) fn is(&mut self, condition: IntCC, a: Value, k: i64) -> Value {
        self.builder.ins().icmp_imm_s(condition, a, k)
    }
    pub(crate) fn old(&mut self, variable: Variable) -> Value {
        self.used[variable.index()] = true;
        self.builder.use_var(variable)
    }

    pub(crate) fn is_used(&self, variable: Variable) -> bool {
        self.used[variable.index()]
    }

    /// The byte of a register.
    pub(crate) fn register(&mut self, state: &mut State, i: u8) -> Value {
        let i = usize::from(i);
        let value = match state.registers[i] {
            Byte::Old => self.old(self.vars.registers[i]),
            Byte::Is(value) => return value,
            Byte::Low(base, offset) => {
                let sum = self.add_imm(base, offset);
                self.byte(sum)
            }
            Byte::High(base, offset) => {
                let mut sum = self.add_imm(base, offset);
                if offset != 0 {
                    sum = self.word(sum);
                }
                self.right(sum, 8)
            }
        };
        state.registers[i] = Byte::Is(value);
        value
    }

    pub(crate) fn set_register(&mut self, state: &mut State, i: u8, value: Value) {
        let i = usize::from(i);
        state.registers[i] = Byte::Is(value);
        state.pairs[i / 2] = None;
    }

    /// Base and offset of a pair, whose value is their sum in 16 bits.
    pub(crate) fn pair_parts(&mut self, state: &mut State, i: u8) -> (Value, i64) {
        if let Some(parts) = state.pairs[usize::from(i / 2)] {
            return parts;
        }
        let low = self.register(state, i);
        let high = self.register(state, i + 1);
        let high = self.left(high, 8);
        let value = self.or(low, high);
        state.pairs[usize::from(i / 2)] = Some((value, 0));
        (value, 0)
    }

    pub(crate) fn pair(&mut self, state: &mut State, i: u8) -> Value {
        let (base, offset) = self.pair_parts(state, i);
        if offset == 0 {
            return base;
        }
        let sum = self.add_imm(base, offset);
        self.word(sum)
    }

    /// Sets a pair to the lower 16 bits of base + offset, where base has no more.
    pub(crate) fn set_pair(&mut self, state: &mut State, i: u8, base: Value, offset: i64) {
        let i = usize::from(i);
        state.registers[i] = Byte::Low(base, offset);
        state.registers[i + 1] = Byte::High(base, offset);
        state.pairs[i / 2] = Some((base, offset));
    }

    /// C as 0 or 1.
    pub(crate) fn carry(&mut self, state: &mut State) -> Value {
        match state.carry {
            Carry::Old => self.old(self.vars.carry),
            Carry::One => self.constant(1),
            Carry::Zero => self.constant(0),
            Carry::Top(value, bit) => self.right(value, bit),
            Carry::Lowest(value) => self.mask(value, 1),
        }
    }

    /// A value that is zero if and only if Z is set, and its lowest byte too.
    pub(crate) fn zero(&mut self, state: &mut State) -> Value {
        match state.zero {
            Zero::Old => self.old(self.vars.zero),
            Zero::Is(value) => value,
            Zero::Word(value) => {
                let high = self.right(value, 8);
                self.or(value, high)
            }
        }
    }

    /// N in bit 7, nothing above it.
    pub(crate) fn negative(&mut self, state: &mut State) -> Value {
        match state.signs {
            Signs::Old => self.old(self.vars.negative),
            Signs::New(value, _) => value,
            Signs::Word(value, ..) => self.right(value, 8),
        }
    }

    /// V in bit 7, and bit 15 as in [`Variables::overflow`].
    pub(crate) fn overflow(&mut self, state: &mut State) -> Value {
        match state.signs {
            Signs::Old => self.old(self.vars.overflow),
            Signs::Word(_, a, b) => {
                let wide = self.and_not(a, b);
                self.right(wide, 8)
            }
            Signs::New(_, overflow) => match overflow {
                Overflow::No => self.constant(0),
                Overflow::Add(d, r, result) => {
                    let a = self.xor(d, result);
                    let b = self.xor(r, result);
                    self.and(a, b)
                }
                Overflow::Sub(d, r, result) => {
                    let a = self.xor(d, r);
                    let b = self.xor(d, result);
                    self.and(a, b)
                }
                Overflow::AndNot(a, b) => self.and_not(a, b),
                Overflow::Shift(result, out) => {
                    let out = self.mask(out, 1);
                    let out = self.left(out, 7);
                    self.xor(result, out)
                }
            },
        }
    }

    /// S in bit 7.
    pub(crate) fn less(&mut self, state: &mut State) -> Value {
        let negative = self.negative(state);
        let overflow = self.overflow(state);
        let mut less = self.xor(negative, overflow);
        if matches!(state.signs, Signs::Old) {
            let flip = self.right(overflow, 8);
            less = self.xor(less, flip);
        }
        less
    }

    /// H in bit 4.
    pub(crate) fn half(&mut self, state: &mut State) -> Value {
        match state.half {
            Half::Old => self.old(self.vars.half),
            Half::Is(value) => value,
            Half::Xor(a, b, c) => {
                let both = self.xor(a, b);
                self.xor(both, c)
            }
        }
    }

    /// T and I in their places.
    pub(crate) fn enables(&mut self, state: &mut State) -> Value {
        match state.enables {
            Some(value) => value,
            None => self.old(self.vars.enables),
        }
    }

    /// The byte SREG.
    pub(crate) fn sreg(&mut self, state: &mut State) -> Value {
        let carry = self.carry(state);
        let zero = self.zero(state);
        let zero = self.is(IntCC::Equal, zero, 0);
        let zero = self.builder.ins().uextend(I64, zero);
        let zero = self.left(zero, 1);
        let negative = self.negative(state);
        let negative = self.mask(negative, 0x80);
        let negative = self.right(negative, 5);
        let overflow = self.overflow(state);
        let overflow = self.mask(overflow, 0x80);
        let overflow = self.right(overflow, 4);
        let less = self.less(state);
        let less = self.mask(less, 0x80);
        let less = self.right(less, 3);
        let half = self.half(state);
        let half = self.mask(half, 0x10);
        let half = self.left(half, 1);
        let enables = self.enables(state);
        [zero, negative, overflow, less, half, enables]
            .into_iter()
            .fold(carry, |all, one| self.or(all, one))
    }

    /// Takes SREG apart.
    pub(crate) fn set_sreg(&mut self, state: &mut State, sreg: Value) {
        let carry = self.mask(sreg, 1);
        state.carry = Carry::Top(carry, 0);
        let zero = self.mask(sreg, 2);
        state.zero = Zero::Is(self.xor_imm(zero, 2));
        let negative = self.mask(sreg, 4);
        let negative = self.left(negative, 5);
        let overflow = self.mask(sreg, 8);
        let overflow = self.left(overflow, 4);
        // Bit 15: whether S is not the exclusive or of N and V.
        let less = self.mask(sreg, 0x10);
        let less = self.left(less, 3);
        let flip = self.xor(negative, overflow);
        let flip = self.xor(flip, less);
        let flip = self.left(flip, 8);
        let overflow = self.or(overflow, flip);
        // `Signs::New` has no bit 15, so the parts go through the variables' form.
        self.builder.def_var(self.vars.negative, negative);
        self.builder.def_var(self.vars.overflow, overflow);
        state.signs = Signs::Old;
        let half = self.mask(sreg, 0x20);
        state.half = Half::Is(self.right(half, 1));
        state.enables = Some(self.mask(sreg, 0xC0));
    }

    /// The stack pointer.
    pub(crate) fn sp(&mut self, state: &mut State) -> Value {
        let base = self.sp_base(state);
        self.add_imm(base, state.stack.delta)
    }

    pub(crate) fn sp_base(&mut self, state: &mut State) -> Value {
        if let Some(base) = state.stack.base {
            return base;
        }
        let base = self.old(self.vars.sp);
        state.stack.base = Some(base);
        base
    }

    /// The lowest stack pointer seen.
    pub(crate) fn lowest_sp(&mut self, state: &mut State) -> Value {
        let seen = match state.lowest_sp {
            Some(value) => value,
            None => self.old(self.vars.lowest_sp),
        };
        let Some(delta) = state.stack.lowest else {
            return seen;
        };
        let base = self.sp_base(state);
        let low = self.add_imm(base, delta);
        let lowest = self.builder.ins().umin(seen, low);
        state.lowest_sp = Some(lowest);
        lowest
    }
}
