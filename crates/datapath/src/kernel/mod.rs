//! The kernels of the deployed arithmetic that are worth a call: on an 8-bit machine a division or a
//! root inlined at every use would not fit the flash (measured: 36 KiB against 12).
//!
//! 16-bit words, rounded to nearest (ties up) and limited, have kernels of their own: they are what
//! fast firmware is made of. `avr.rs` computes the same as `portable.rs`
//! (tested on the target: `firmware/boards/atmega328p/tests`).

#[cfg(target_arch = "avr")]
pub mod avr;
pub mod portable;

#[cfg(target_arch = "avr")]
pub(crate) use avr::*;
#[cfg(not(target_arch = "avr"))]
pub(crate) use portable::*;

use crate::Rounding;
use crate::rounding::narrow;

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
