//! What the 16-bit kernels compute, on every target that has no assembly for them.

use crate::rounding::narrow;
use crate::{Format, Overflow, Rounding};

/// The format whose rounding and limits the kernels share.
const WORD16: Format = Format::new(16, 0, Rounding::NearestUp, Overflow::Saturate);

/// a + b limited to 16 bits.
#[inline(always)]
pub fn add16(a: i16, b: i16) -> i16 {
    a.saturating_add(b)
}

/// a - b limited to 16 bits.
#[inline(always)]
pub fn sub16(a: i16, b: i16) -> i16 {
    a.saturating_sub(b)
}

/// -a limited to 16 bits.
#[inline(always)]
pub fn neg16(a: i16) -> i16 {
    a.saturating_neg()
}

/// |a| limited to 16 bits.
#[inline(always)]
pub fn abs16(a: i16) -> i16 {
    a.saturating_abs()
}

/// Exact product.
#[inline(always)]
pub fn multiply16(a: i16, b: i16) -> i32 {
    i32::from(a) * i32::from(b)
}

/// Product limited to 31 bits: only that of the two least words needs it.
#[inline(always)]
pub fn multiply31(a: i16, b: i16) -> i32 {
    let product = multiply16(a, b);
    if product == 1 << 30 {
        product - 1
    } else {
        product
    }
}

#[inline(always)]
fn round(raw: i32, shift: u32) -> i16 {
    let rounded = narrow::shift_right(raw, shift, Rounding::NearestUp);
    narrow::limit(rounded, WORD16).0 as i16
}

/// raw / 2^14, to nearest with ties up, limited to 16 bits.
#[inline(always)]
pub fn round14(raw: i32) -> i16 {
    round(raw, 14)
}

/// raw / 2^15, likewise.
#[inline(always)]
pub fn round15(raw: i32) -> i16 {
    round(raw, 15)
}

/// a b / 2^12, to nearest with ties up, limited to 16 bits.
#[inline(always)]
pub fn multiply_round12(a: i16, b: i16) -> i16 {
    round(multiply16(a, b), 12)
}

/// a b / 2^13, likewise.
#[inline(always)]
pub fn multiply_round13(a: i16, b: i16) -> i16 {
    round(multiply16(a, b), 13)
}

/// a b / 2^14, likewise.
#[inline(always)]
pub fn multiply_round14(a: i16, b: i16) -> i16 {
    round(multiply16(a, b), 14)
}

/// a b / 2^15, likewise.
#[inline(always)]
pub fn multiply_round15(a: i16, b: i16) -> i16 {
    round(multiply16(a, b), 15)
}

/// a b / 2^16, likewise.
#[inline(always)]
pub fn multiply_round16(a: i16, b: i16) -> i16 {
    round(multiply16(a, b), 16)
}

#[inline(always)]
fn divide(a: i16, b: i16, up: u32) -> i16 {
    let quotient = narrow::divide(i32::from(a) << up, i32::from(b), Rounding::NearestUp);
    narrow::limit(quotient, WORD16).0 as i16
}

/// a 2^14 / b, to nearest with ties up, limited to 16 bits; b is not 0.
#[inline(always)]
pub fn divide14(a: i16, b: i16) -> i16 {
    divide(a, b, 14)
}

/// a 2^15 / b, likewise.
#[inline(always)]
pub fn divide15(a: i16, b: i16) -> i16 {
    divide(a, b, 15)
}

/// Square root to nearest (no ties exist), limited to 16 bits.
#[inline(always)]
pub fn square_root16(radicand: u32) -> i16 {
    let root = narrow::square_root(radicand, Rounding::NearestUp);
    if root > i16::MAX as u32 {
        i16::MAX
    } else {
        root as i16
    }
}
