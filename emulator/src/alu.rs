//! Arithmetic of the AVRe+ core: results and status flags.
//!
//! The flags are kept apart, each in the form in which it falls out of the operation, and SREG is
//! put together only when somebody reads it: most results are never looked at. Formulae: AVR
//! Instruction Set Manual DS40002198, the Boolean expressions of each instruction. Bits of SREG
//! from 0: C, Z, N (negative), V (overflow), S (N xor V), H, T, I.

/// Carry.
pub(crate) const C: u8 = 1;
/// Zero.
pub(crate) const Z: u8 = 2;
/// Bit copy storage.
pub(crate) const T: u8 = 64;
/// Global interrupt enable.
pub(crate) const I: u8 = 128;
const N: u8 = 4;
const V: u8 = 8;
const H: u8 = 32;

/// The status register, taken apart. S has a place of its own, since programs may write SREG.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Flags {
    /// C: 0 or 1.
    pub(crate) c: u8,
    /// Z is set if this is 0.
    pub(crate) z: u8,
    /// N is bit 7, V bit 15. S is their exclusive or, inverted by bit 23 (which only a program
    /// that writes SREG can set).
    pub(crate) nv: u32,
    /// H is bit 4.
    pub(crate) h: u8,
    /// T and I in their places.
    pub(crate) ti: u8,
}

/// Flags are equal if SREG is: the same flag may lie here in several forms.
impl PartialEq for Flags {
    fn eq(&self, other: &Flags) -> bool {
        self.sreg() == other.sreg()
    }
}

impl Flags {
    /// SREG.
    #[inline]
    pub(crate) fn sreg(self) -> u8 {
        self.c
            | u8::from(self.z == 0) << 1
            | (self.nv >> 5) as u8 & N
            | (self.nv >> 12) as u8 & V
            | u8::from(self.is_less()) << 4
            | (self.h >> 4 & 1) << 5
            | self.ti
    }

    #[inline]
    pub(crate) fn from_sreg(sreg: u8) -> Flags {
        let flip = (sreg << 2 ^ sreg << 1 ^ sreg) << 3 & 0x80;
        let bits = [(sreg & N) << 5, (sreg & V) << 4, flip, 0];
        Flags {
            c: sreg & C,
            z: !sreg & Z,
            nv: u32::from_le_bytes(bits),
            h: (sreg & H) >> 1,
            ti: sreg & (T | I),
        }
    }

    /// Global interrupt enable.
    #[inline(always)]
    pub(crate) fn interrupts_enabled(self) -> bool {
        self.ti & I != 0
    }

    /// Sets or clears I.
    #[inline(always)]
    pub(crate) fn enable_interrupts(&mut self, enabled: bool) {
        self.ti = self.ti & T | if enabled { I } else { 0 };
    }

    /// The bit T as a bool.
    #[inline(always)]
    pub(crate) fn t(self) -> bool {
        self.ti & T != 0
    }

    #[inline(always)]
    pub(crate) fn set_t(&mut self, value: bool) {
        self.ti = self.ti & I | if value { T } else { 0 };
    }

    #[inline(always)]
    pub(crate) fn is_carry(self) -> bool {
        self.c != 0
    }

    #[inline(always)]
    pub(crate) fn is_zero(self) -> bool {
        self.z == 0
    }

    #[inline(always)]
    pub(crate) fn is_negative(self) -> bool {
        self.nv & 0x80 != 0
    }

    #[inline(always)]
    pub(crate) fn is_less(self) -> bool {
        (self.nv ^ self.nv >> 8 ^ self.nv >> 16) & 0x80 != 0
    }

    /// N, Z and V of a result, and S from them.
    #[inline(always)]
    fn nzvs(&mut self, result: u8, overflow: u8) {
        self.z = result;
        self.nv = u32::from(result) | u32::from(overflow) << 8;
    }

    /// d + r + carry (0 or 1).
    #[inline(always)]
    fn sum(&mut self, d: u8, r: u8, carry: u8) -> u8 {
        let wide = u16::from(d) + u16::from(r) + u16::from(carry);
        let result = wide as u8;
        self.c = (wide >> 8) as u8;
        self.h = d ^ r ^ result;
        self.nzvs(result, (d ^ result) & (r ^ result));
        result
    }

    #[inline(always)]
    pub(crate) fn add(&mut self, d: u8, r: u8) -> u8 {
        self.sum(d, r, 0)
    }

    #[inline(always)]
    pub(crate) fn adc(&mut self, d: u8, r: u8) -> u8 {
        self.sum(d, r, self.c)
    }

    /// d - r.
    #[inline(always)]
    pub(crate) fn sub(&mut self, d: u8, r: u8) -> u8 {
        let result = d.wrapping_sub(r);
        self.c = u8::from(d < r);
        self.h = d ^ r ^ result;
        self.nzvs(result, (d ^ r) & (d ^ result));
        result
    }

    /// d - r - C; Z stays set only if it was set (SBC, SBCI, CPC).
    #[inline(always)]
    pub(crate) fn sbc(&mut self, d: u8, r: u8) -> u8 {
        let wide = u16::from(d)
            .wrapping_sub(u16::from(r))
            .wrapping_sub(u16::from(self.c));
        let (result, zero) = (wide as u8, self.z);
        self.c = (wide >> 8) as u8 & 1;
        self.h = d ^ r ^ result;
        self.nzvs(result, (d ^ r) & (d ^ result));
        self.z |= zero;
        result
    }

    /// AND, OR, EOR: V = 0, C and H kept.
    #[inline(always)]
    pub(crate) fn logic(&mut self, result: u8) -> u8 {
        self.nzvs(result, 0);
        result
    }

    #[inline(always)]
    pub(crate) fn com(&mut self, d: u8) -> u8 {
        self.c = 1;
        self.logic(!d)
    }

    #[inline(always)]
    pub(crate) fn neg(&mut self, d: u8) -> u8 {
        self.sub(0, d)
    }

    #[inline(always)]
    pub(crate) fn inc(&mut self, d: u8) -> u8 {
        let result = d.wrapping_add(1);
        self.nzvs(result, !d & result);
        result
    }

    #[inline(always)]
    pub(crate) fn dec(&mut self, d: u8) -> u8 {
        let result = d.wrapping_sub(1);
        self.nzvs(result, d & !result);
        result
    }

    /// LSR, ROR, ASR: C is the bit shifted out, V = N xor C.
    #[inline(always)]
    fn shifted(&mut self, result: u8, out: u8) -> u8 {
        self.c = out;
        self.nzvs(result, result ^ out << 7);
        result
    }

    #[inline(always)]
    pub(crate) fn asr(&mut self, d: u8) -> u8 {
        self.shifted(d >> 1 | d & 0x80, d & 1)
    }

    #[inline(always)]
    pub(crate) fn lsr(&mut self, d: u8) -> u8 {
        self.shifted(d >> 1, d & 1)
    }

    #[inline(always)]
    pub(crate) fn ror(&mut self, d: u8) -> u8 {
        self.shifted(d >> 1 | self.c << 7, d & 1)
    }

    /// Flags of a 16-bit result; overflow and carry in bit 15.
    #[inline(always)]
    fn word(&mut self, result: u16, overflow: u16, carry: u16) -> u16 {
        self.nzvs((result >> 8) as u8, (overflow >> 8) as u8);
        self.z |= result as u8;
        self.c = (carry >> 15) as u8;
        result
    }

    #[inline(always)]
    pub(crate) fn adiw(&mut self, d: u16, k: u8) -> u16 {
        let result = d.wrapping_add(u16::from(k));
        self.word(result, !d & result, !result & d)
    }

    #[inline(always)]
    pub(crate) fn sbiw(&mut self, d: u16, k: u8) -> u16 {
        let result = d.wrapping_sub(u16::from(k));
        self.word(result, d & !result, result & !d)
    }

    /// MUL, MULS, MULSU: C = bit 15, Z.
    #[inline(always)]
    pub(crate) fn product(&mut self, result: u16) -> u16 {
        self.c = (result >> 15) as u8;
        self.z = (result >> 8) as u8 | result as u8;
        result
    }

    /// FMUL, FMULS, FMULSU: the product shifted left once; C = bit 15 before the shift.
    #[inline(always)]
    pub(crate) fn fractional(&mut self, product: u16) -> u16 {
        let result = self.product(product << 1);
        self.c = (product >> 15) as u8;
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taking_sreg_apart_and_putting_it_together_changes_nothing() {
        for sreg in 0..=255 {
            assert_eq!(Flags::from_sreg(sreg).sreg(), sreg);
        }
    }
}
