//! Arithmetic of the AVRe+ core: results and status flags, as pure functions.
//!
//! Each function takes operands and the old SREG and returns the result and the new SREG
//! (AVR Instruction Set Manual DS40002198, the Boolean formulae of each instruction). Bits of
//! SREG from 0: C, Z, N (negative), V (overflow), S (N xor V), H, T, I.

/// Carry.
pub(crate) const C: u8 = 1;
/// Zero.
pub(crate) const Z: u8 = 2;
/// Half carry.
pub(crate) const H: u8 = 32;
/// Bit copy storage.
pub(crate) const T: u8 = 64;
/// Global interrupt enable.
pub(crate) const I: u8 = 128;

/// N, Z, S from a result and its overflow bit (0 or 1); V included.
#[inline(always)]
fn nzvs(result: u8, overflow: u8) -> u8 {
    let negative = result >> 7;
    u8::from(result == 0) << 1 | negative << 2 | overflow << 3 | (negative ^ overflow) << 4
}

/// d + r + carry (0 or 1).
#[inline(always)]
pub(crate) fn add(d: u8, r: u8, carry: u8, sreg: u8) -> (u8, u8) {
    let result = d.wrapping_add(r).wrapping_add(carry);
    let carries = (d & r) | ((d | r) & !result);
    let overflow = ((d ^ result) & (r ^ result)) >> 7;
    let flags = nzvs(result, overflow) | carries >> 7 | (carries & 8) << 2;
    (result, sreg & (I | T) | flags)
}

/// d - r - borrow (0 or 1).
#[inline(always)]
pub(crate) fn sub(d: u8, r: u8, borrow: u8, sreg: u8) -> (u8, u8) {
    let result = d.wrapping_sub(r).wrapping_sub(borrow);
    let borrows = (!d & r) | ((!d | r) & result);
    let overflow = ((d ^ r) & (d ^ result)) >> 7;
    let flags = nzvs(result, overflow) | borrows >> 7 | (borrows & 8) << 2;
    (result, sreg & (I | T) | flags)
}

/// d - r - C, where Z stays set only if it was set (SBC, SBCI, CPC).
#[inline(always)]
pub(crate) fn sub_with_borrow(d: u8, r: u8, sreg: u8) -> (u8, u8) {
    let (result, flags) = sub(d, r, sreg & C, sreg);
    (result, flags & (!Z | sreg))
}

/// Flags of AND, OR, EOR: V = 0, C and H kept.
#[inline(always)]
pub(crate) fn logic(result: u8, sreg: u8) -> u8 {
    sreg & (I | T | H | C) | nzvs(result, 0)
}

#[inline(always)]
pub(crate) fn com(d: u8, sreg: u8) -> (u8, u8) {
    (!d, logic(!d, sreg) | C)
}

#[inline(always)]
pub(crate) fn neg(d: u8, sreg: u8) -> (u8, u8) {
    sub(0, d, 0, sreg)
}

#[inline(always)]
pub(crate) fn inc(d: u8, sreg: u8) -> (u8, u8) {
    let result = d.wrapping_add(1);
    (
        result,
        sreg & (I | T | H | C) | nzvs(result, u8::from(result == 0x80)),
    )
}

#[inline(always)]
pub(crate) fn dec(d: u8, sreg: u8) -> (u8, u8) {
    let result = d.wrapping_sub(1);
    (
        result,
        sreg & (I | T | H | C) | nzvs(result, u8::from(result == 0x7F)),
    )
}

/// Flags of LSR, ROR and ASR: C is the bit shifted out, V = N xor C.
#[inline(always)]
fn shifted(result: u8, out: u8, sreg: u8) -> (u8, u8) {
    let overflow = result >> 7 ^ out;
    (result, sreg & (I | T | H) | nzvs(result, overflow) | out)
}

#[inline(always)]
pub(crate) fn asr(d: u8, sreg: u8) -> (u8, u8) {
    shifted(d >> 1 | d & 0x80, d & 1, sreg)
}

#[inline(always)]
pub(crate) fn lsr(d: u8, sreg: u8) -> (u8, u8) {
    shifted(d >> 1, d & 1, sreg)
}

#[inline(always)]
pub(crate) fn ror(d: u8, sreg: u8) -> (u8, u8) {
    shifted(d >> 1 | (sreg & C) << 7, d & 1, sreg)
}

/// N, Z, S of a 16-bit result with overflow and carry bits (0 or 1).
#[inline(always)]
fn word_flags(result: u16, overflow: u8, carry: u8, sreg: u8) -> u8 {
    let negative = (result >> 15) as u8;
    let flags = u8::from(result == 0) << 1
        | negative << 2
        | overflow << 3
        | (negative ^ overflow) << 4
        | carry;
    sreg & (I | T | H) | flags
}

#[inline(always)]
pub(crate) fn adiw(d: u16, k: u8, sreg: u8) -> (u16, u8) {
    let result = d.wrapping_add(u16::from(k));
    let overflow = ((!d & result) >> 15) as u8;
    let carry = ((!result & d) >> 15) as u8;
    (result, word_flags(result, overflow, carry, sreg))
}

#[inline(always)]
pub(crate) fn sbiw(d: u16, k: u8, sreg: u8) -> (u16, u8) {
    let result = d.wrapping_sub(u16::from(k));
    let overflow = ((d & !result) >> 15) as u8;
    let carry = ((result & !d) >> 15) as u8;
    (result, word_flags(result, overflow, carry, sreg))
}

/// Flags of MUL, MULS, MULSU: C = bit 15, Z.
#[inline(always)]
pub(crate) fn product(result: u16, sreg: u8) -> u8 {
    sreg & !(C | Z) | (result >> 15) as u8 | u8::from(result == 0) << 1
}

/// FMUL, FMULS, FMULSU: the product shifted left once; C = bit 15 before the shift.
#[inline(always)]
pub(crate) fn fractional(product: u16, sreg: u8) -> (u16, u8) {
    let result = product << 1;
    let flags = sreg & !(C | Z) | (product >> 15) as u8 | u8::from(result == 0) << 1;
    (result, flags)
}
