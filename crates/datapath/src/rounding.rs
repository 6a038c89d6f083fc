//! Rounding and overflow on integers, in the three widths that are worth telling apart on an 8-bit
//! machine: 32 bit, 64 bit, and 128 bit for models.
//!
//! Every function is a sequence of shifts, additions and comparisons that folds to the needed few
//! when the format is a constant.

use crate::{Format, Overflow, Rounding};

macro_rules! width {
    ($mod_name:ident, $int:ident, $uint:ident, $what:literal) => {
        #[doc = $what]
        pub mod $mod_name {
            use super::*;

            /// raw / 2^shift rounded by `mode`; exact for shift 0. Needs one bit of headroom.
            #[inline(always)]
            #[must_use]
            pub const fn shift_right(raw: $int, shift: u32, mode: Rounding) -> $int {
                if shift == 0 {
                    return raw;
                }
                if shift >= $int::BITS {
                    return beyond(raw, mode);
                }
                let floor = raw >> shift;
                let half: $int = ((1 as $uint) << (shift - 1)) as $int;
                match mode {
                    Rounding::Floor => floor,
                    Rounding::Ceil => -((-raw) >> shift),
                    Rounding::Zero => {
                        if raw < 0 {
                            -((-raw) >> shift)
                        } else {
                            floor
                        }
                    }
                    Rounding::NearestUp => ((raw >> (shift - 1)) + 1) >> 1,
                    Rounding::NearestAway => {
                        if raw < 0 {
                            -((((-raw) >> (shift - 1)) + 1) >> 1)
                        } else {
                            ((raw >> (shift - 1)) + 1) >> 1
                        }
                    }
                    Rounding::NearestEven => {
                        let rest = raw - (floor << shift);
                        // For the widest shift `half` is the most negative number; compare unsigned.
                        let (rest, half) = (rest as $uint, half as $uint);
                        if rest > half || (rest == half && floor & 1 == 1) {
                            floor + 1
                        } else {
                            floor
                        }
                    }
                }
            }

            /// A shift by the whole width or more: |raw / 2^shift| <= 1/2.
            const fn beyond(raw: $int, mode: Rounding) -> $int {
                match mode {
                    Rounding::Floor => raw >> ($int::BITS - 1),
                    Rounding::Ceil => (raw > 0) as $int,
                    _ => 0,
                }
            }

            /// Whether `mode` takes the magnitude of a quotient one up: `rest` is what the division
            /// leaves, `left` what of the divisor is left over it. (2 rest could overflow.)
            #[inline(always)]
            #[must_use]
            pub const fn quotient_up(
                rest: $uint,
                left: $uint,
                odd: bool,
                negative: bool,
                mode: Rounding,
            ) -> bool {
                match mode {
                    Rounding::Floor => negative && rest != 0,
                    Rounding::Ceil => !negative && rest != 0,
                    Rounding::Zero => false,
                    Rounding::NearestUp => rest > left || (rest == left && !negative),
                    Rounding::NearestAway => rest >= left,
                    Rounding::NearestEven => rest > left || (rest == left && odd),
                }
            }

            /// numerator / denominator rounded by `mode`; the denominator is not 0.
            #[inline(always)]
            #[must_use]
            pub const fn divide(numerator: $int, denominator: $int, mode: Rounding) -> $int {
                let negative = (numerator < 0) != (denominator < 0);
                let (n, d) = (numerator.unsigned_abs(), denominator.unsigned_abs());
                let (quotient, rest) = (n / d, n % d);
                let up = quotient_up(rest, d - rest, quotient & 1 == 1, negative, mode);
                let magnitude = quotient + up as $uint;
                if negative {
                    (magnitude as $int).wrapping_neg()
                } else {
                    magnitude as $int
                }
            }

            /// Square root of `radicand` rounded by `mode` (no ties exist). One step per result bit.
            #[inline(always)]
            #[must_use]
            pub const fn square_root(radicand: $uint, mode: Rounding) -> $uint {
                let mut rest = radicand;
                let mut root: $uint = 0;
                let mut bit: $uint = 1 << ($uint::BITS - 2);
                while bit != 0 {
                    if rest >= root + bit {
                        rest -= root + bit;
                        root = (root >> 1) + bit;
                    } else {
                        root >>= 1;
                    }
                    bit >>= 2;
                }
                let up = match mode {
                    Rounding::Floor | Rounding::Zero => false,
                    Rounding::Ceil => rest != 0,
                    _ => rest > root,
                };
                root + up as $uint
            }

            /// The least or the greatest word of `word` bits. Cold, so that compilers do not prepare
            /// both ends in case they are needed (on the AVR 20 cycles a time).
            #[cold]
            #[inline(never)]
            const fn end_of_range(negative: bool, word: u8) -> $int {
                let magnitude = (1 as $int) << (word - 1);
                if negative { -magnitude } else { magnitude - 1 }
            }

            /// `raw` limited to `format`'s word; the flag tells whether it did not fit.
            #[inline(always)]
            #[must_use]
            pub const fn limit(raw: $int, format: Format) -> ($int, bool) {
                if format.word >= $int::BITS {
                    return (raw, false);
                }
                let spare = $int::BITS - format.word;
                let fits = if spare < 8 {
                    // One byte tells, which is all that an 8-bit machine should look at.
                    let top = (raw as $uint >> ($int::BITS - 8)) as u8;
                    let end = 1u8 << (7 - spare);
                    top.wrapping_add(end) & !(end | (end - 1)) == 0
                } else {
                    (raw << spare) >> spare == raw
                };
                if fits {
                    return (raw, false);
                }
                let limited = match format.overflow {
                    Overflow::Wrap => (raw << spare) >> spare,
                    Overflow::Saturate | Overflow::Trap => end_of_range(raw < 0, format.word as u8),
                };
                (limited, true)
            }
        }
    };
}

width!(narrow, i32, u32, "32-bit intermediates.");
width!(wide, i64, u64, "64-bit intermediates.");
width!(
    exact,
    i128,
    u128,
    "128-bit intermediates: exact for every operation on words up to 64 bits."
);
