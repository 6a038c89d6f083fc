//! Arithmetic instructions: results, and flags in the form in which they are cheap to keep.

use cardan_emulator::engine::{Code, Op};
use cranelift_codegen::ir::{InstBuilder, Value, types::I8, types::I64};

use crate::state::{Carry, Emit, Half, Overflow, Signs, State, Zero};

/// T and I in SREG.
const T: u8 = 0x40;
const I: u8 = 0x80;

impl Emit<'_, '_> {
    pub(crate) fn lower_arithmetic(&mut self, state: &mut State, op: Op) {
        match op.code {
            Code::Add | Code::Adc => {
                let (d, r) = self.operands(state, op);
                let carry = (op.code == Code::Adc).then(|| self.carry(state));
                let result = self.sum(state, d, r, carry);
                self.set_register(state, op.d, result);
            }
            Code::Sub | Code::Sbc | Code::Cp | Code::Cpc => {
                let (d, r) = self.operands(state, op);
                let carries = matches!(op.code, Code::Sbc | Code::Cpc);
                let result = self.difference(state, d, r, carries);
                if matches!(op.code, Code::Sub | Code::Sbc) {
                    self.set_register(state, op.d, result);
                }
            }
            Code::Subi | Code::Sbci | Code::Cpi => {
                let d = self.register(state, op.d);
                let k = self.constant(i64::from(op.r));
                let result = self.difference(state, d, k, op.code == Code::Sbci);
                if op.code != Code::Cpi {
                    self.set_register(state, op.d, result);
                }
            }
            Code::Neg => {
                let zero = self.constant(0);
                let d = self.register(state, op.d);
                let result = self.difference(state, zero, d, false);
                self.set_register(state, op.d, result);
            }
            Code::And | Code::Or | Code::Eor => self.logic(state, op),
            Code::Andi | Code::Ori => {
                let d = self.register(state, op.d);
                let k = i64::from(op.r);
                let result = if op.code == Code::Andi {
                    self.mask(d, k)
                } else {
                    self.or_imm(d, k)
                };
                self.set_logic(state, op.d, result);
            }
            Code::Com => {
                let d = self.register(state, op.d);
                let result = self.xor_imm(d, 0xFF);
                self.set_logic(state, op.d, result);
                state.carry = Carry::One;
            }
            Code::Inc | Code::Dec => self.count(state, op),
            Code::Asr | Code::Lsr | Code::Ror => self.shift(state, op),
            Code::Swap => {
                let d = self.register(state, op.d);
                let up = self.left(d, 4);
                let down = self.right(d, 4);
                let both = self.or(up, down);
                let result = self.byte(both);
                self.set_register(state, op.d, result);
            }
            Code::Adiw | Code::Sbiw => self.word_immediate(state, op),
            Code::Mul | Code::Muls | Code::Mulsu | Code::Fmul | Code::Fmuls | Code::Fmulsu => {
                self.multiply(state, op);
            }
            Code::Mov => {
                let value = self.register(state, op.r);
                self.set_register(state, op.d, value);
            }
            Code::Ldi => {
                let value = self.constant(i64::from(op.r));
                self.set_register(state, op.d, value);
            }
            Code::Movw => {
                let (d, r) = (usize::from(op.d), usize::from(op.r));
                let low = self.form(state, op.r);
                let high = self.form(state, op.r + 1);
                state.registers[d] = low;
                state.registers[d + 1] = high;
                state.pairs[d / 2] = state.pairs[r / 2];
            }
            Code::Bset | Code::Bclr => self.status_bit(state, op),
            Code::Bld => {
                let enables = self.enables(state);
                let t = self.mask(enables, i64::from(T));
                let bit = i64::from(op.r.trailing_zeros());
                let t = if bit > 6 {
                    self.left(t, bit - 6)
                } else {
                    self.right(t, 6 - bit)
                };
                let d = self.register(state, op.d);
                let rest = self.mask(d, i64::from(!op.r));
                let result = self.or(rest, t);
                self.set_register(state, op.d, result);
            }
            // BST; every other operation is lowered elsewhere.
            _ => {
                let d = self.register(state, op.d);
                let value = self.mask(d, i64::from(op.r));
                let bit = i64::from(op.r.trailing_zeros());
                let t = if bit > 6 {
                    self.right(value, bit - 6)
                } else {
                    self.left(value, 6 - bit)
                };
                let enables = self.enables(state);
                let rest = self.mask(enables, i64::from(I));
                state.enables = Some(self.or(rest, t));
            }
        }
    }

    fn operands(&mut self, state: &mut State, op: Op) -> (Value, Value) {
        (self.register(state, op.d), self.register(state, op.r))
    }

    /// The form of a register's value, never that of another register's variable.
    fn form(&mut self, state: &mut State, i: u8) -> crate::state::Byte {
        if matches!(state.registers[usize::from(i)], crate::state::Byte::Old) {
            self.register(state, i);
        }
        state.registers[usize::from(i)]
    }

    fn sum(&mut self, state: &mut State, d: Value, r: Value, carry: Option<Value>) -> Value {
        let mut wide = self.add(d, r);
        if let Some(carry) = carry {
            wide = self.add(wide, carry);
        }
        let result = self.byte(wide);
        state.carry = Carry::Top(wide, 8);
        state.zero = Zero::Is(result);
        state.signs = Signs::New(result, Overflow::Add(d, r, result));
        state.half = Half::Xor(d, r, result);
        result
    }

    /// d - r, or with the carry d - r - C where Z stays set only if it was.
    fn difference(&mut self, state: &mut State, d: Value, r: Value, carries: bool) -> Value {
        let mut wide = self.sub(d, r);
        if carries {
            let carry = self.carry(state);
            wide = self.sub(wide, carry);
        }
        let result = self.byte(wide);
        state.carry = Carry::Top(wide, 63);
        state.zero = Zero::Is(if carries {
            let zero = self.zero(state);
            self.or(result, zero)
        } else {
            result
        });
        state.signs = Signs::New(result, Overflow::Sub(d, r, result));
        state.half = Half::Xor(d, r, result);
        result
    }

    fn logic(&mut self, state: &mut State, op: Op) {
        let (d, r) = self.operands(state, op);
        let result = match op.code {
            Code::And => self.and(d, r),
            Code::Or => self.or(d, r),
            _ if op.d == op.r => self.constant(0),
            _ => self.xor(d, r),
        };
        self.set_logic(state, op.d, result);
    }

    fn set_logic(&mut self, state: &mut State, d: u8, result: Value) {
        state.zero = Zero::Is(result);
        state.signs = Signs::New(result, Overflow::No);
        self.set_register(state, d, result);
    }

    fn count(&mut self, state: &mut State, op: Op) {
        let d = self.register(state, op.d);
        let step = if op.code == Code::Inc { 1 } else { -1 };
        let wide = self.add_imm(d, step);
        let result = self.byte(wide);
        let overflow = if op.code == Code::Inc {
            Overflow::AndNot(result, d)
        } else {
            Overflow::AndNot(d, result)
        };
        state.zero = Zero::Is(result);
        state.signs = Signs::New(result, overflow);
        self.set_register(state, op.d, result);
    }

    fn shift(&mut self, state: &mut State, op: Op) {
        let d = self.register(state, op.d);
        let half = self.right(d, 1);
        let result = match op.code {
            Code::Lsr => half,
            Code::Asr => {
                let sign = self.mask(d, 0x80);
                self.or(half, sign)
            }
            _ => {
                let carry = self.carry(state);
                let carry = self.left(carry, 7);
                self.or(half, carry)
            }
        };
        state.carry = Carry::Lowest(d);
        state.zero = Zero::Is(result);
        state.signs = Signs::New(result, Overflow::Shift(result, d));
        self.set_register(state, op.d, result);
    }

    fn word_immediate(&mut self, state: &mut State, op: Op) {
        let d = self.pair(state, op.d);
        let step = i64::from(op.r);
        if op.code == Code::Adiw {
            let wide = self.add_imm(d, step);
            let result = self.word(wide);
            state.carry = Carry::Top(wide, 16);
            state.signs = Signs::Word(result, result, d);
            state.zero = Zero::Word(result);
            self.set_pair(state, op.d, result, 0);
        } else {
            let wide = self.add_imm(d, -step);
            let result = self.word(wide);
            state.carry = Carry::Top(wide, 63);
            state.signs = Signs::Word(result, d, result);
            state.zero = Zero::Word(result);
            self.set_pair(state, op.d, result, 0);
        }
    }

    fn multiply(&mut self, state: &mut State, op: Op) {
        let (mut d, mut r) = self.operands(state, op);
        if !matches!(op.code, Code::Mul | Code::Fmul) {
            d = self.signed(d);
        }
        if matches!(op.code, Code::Muls | Code::Fmuls) {
            r = self.signed(r);
        }
        let mut product = self.builder.ins().imul(d, r);
        if op.code != Code::Mul {
            product = self.word(product);
        }
        state.carry = Carry::Top(product, 15);
        if matches!(op.code, Code::Fmul | Code::Fmuls | Code::Fmulsu) {
            let twice = self.left(product, 1);
            product = self.word(twice);
        }
        state.zero = Zero::Word(product);
        self.set_pair(state, 0, product, 0);
    }

    fn signed(&mut self, value: Value) -> Value {
        let byte = self.builder.ins().ireduce(I8, value);
        self.builder.ins().sextend(I64, byte)
    }

    fn status_bit(&mut self, state: &mut State, op: Op) {
        let sets = op.code == Code::Bset;
        match op.r {
            1 => state.carry = if sets { Carry::One } else { Carry::Zero },
            2 => state.zero = Zero::Is(self.constant(i64::from(!sets))),
            T | I => {
                let enables = self.enables(state);
                state.enables = Some(if sets {
                    self.or_imm(enables, i64::from(op.r))
                } else {
                    self.mask(enables, i64::from(!op.r))
                });
            }
            mask => {
                let sreg = self.sreg(state);
                let sreg = if sets {
                    self.or_imm(sreg, i64::from(mask))
                } else {
                    self.mask(sreg, i64::from(!mask))
                };
                self.set_sreg(state, sreg);
            }
        }
    }
}
