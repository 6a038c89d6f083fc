//! The 32-bit kernels of the deployed arithmetic that are worth a call: on an 8-bit machine a
//! division or a root inlined at every use would not fit the flash (measured: 36 KiB against 12).

use crate::Rounding;
use crate::rounding::narrow;

/// Exact product of two 16-bit words.
#[inline(always)]
pub(crate) fn multiply16(a: i16, b: i16) -> i32 {
    i32::from(a) * i32::from(b)
}

/// numerator / denominator rounded by `mode`; the denominator is not 0.
#[inline(never)]
pub(crate) fn divide32(numerator: i32, denominator: i32, mode: Rounding) -> i32 {
    narrow::divide(numerator, denominator, mode)
}

/// Square root rounded by `mode`.
#[inline(never)]
pub(crate) fn square_root32(radicand: u32, mode: Rounding) -> u32 {
    narrow::square_root(radicand, mode)
}
