//! The inner loops: exact in a 32- or 64-bit intermediate, rounded and limited once.
//!
//! Rounding is branch-free: (x + bias(x)) >> drop, where the bias is a constant, or depends on the
//! sign of x (ties away, toward zero) or on the last kept bit (ties to even). Which of these, and
//! how values outside the word are limited, is chosen once per loop, so that the loops vectorise.

use cardan_datapath::{Format, Overflow, Rounding};
use fearless_simd::{Level, dispatch};

/// A loop to come.
pub(super) trait Loop {
    /// What it tells.
    type Output;

    /// Runs it, with the processor features of the caller: it is inlined.
    fn run(self) -> Self::Output;
}

/// Runs a loop as compiled for the processor features of `level`.
#[inline(always)]
pub(super) fn run<L: Loop>(level: Level, job: L) -> L::Output {
    dispatch!(level, _ => job.run())
}

macro_rules! width {
    ($name:ident, $int:ident, $what:literal) => {
        #[doc = $what]
        pub(super) mod $name {
            use super::*;

            /// Rounding and limiting of one format.
            #[derive(Clone, Copy)]
            pub(in super::super) struct Fit {
                left: u32,
                right: u32,
                bias: $int,
                /// Added to the bias of negative values.
                negative: $int,
                /// 1 where the last kept bit is added to the bias.
                odd: $int,
                min: $int,
                max: $int,
                unused: u32,
                wraps: bool,
            }

            impl Fit {
                pub(in super::super) fn new(format: Format, drop: i32) -> Self {
                    let right = drop.max(0).unsigned_abs();
                    let (one, zero): ($int, $int) = (1, 0);
                    let (half, rest) = if right == 0 {
                        (zero, zero)
                    } else {
                        (one << (right - 1), (one << right) - 1)
                    };
                    let (bias, negative, odd) = match format.rounding {
                        _ if right == 0 => (zero, zero, zero),
                        Rounding::Floor => (zero, zero, zero),
                        Rounding::Ceil => (rest, zero, zero),
                        Rounding::Zero => (zero, rest, zero),
                        Rounding::NearestUp => (half, zero, zero),
                        Rounding::NearestAway => (half, -1, zero),
                        Rounding::NearestEven => (half - 1, zero, one),
                    };
                    let fits = format.word >= $int::BITS;
                    Self {
                        left: drop.min(0).unsigned_abs(),
                        right,
                        bias,
                        negative,
                        odd,
                        min: if fits {
                            $int::MIN
                        } else {
                            format.min_raw() as $int
                        },
                        max: if fits {
                            $int::MAX
                        } else {
                            format.max_raw() as $int
                        },
                        unused: $int::BITS.saturating_sub(format.word),
                        wraps: matches!(format.overflow, Overflow::Wrap),
                    }
                }

                #[inline(always)]
                fn round<const MODE: u8>(self, x: $int) -> $int {
                    match MODE {
                        0 => x.wrapping_add(self.bias) >> self.right,
                        1 => {
                            let sign = x >> ($int::BITS - 1);
                            x.wrapping_add(self.bias).wrapping_add(self.negative & sign)
                                >> self.right
                        }
                        2 => {
                            let last = (x >> self.right) & self.odd;
                            x.wrapping_add(self.bias).wrapping_add(last) >> self.right
                        }
                        _ => x << self.left,
                    }
                }

                #[inline(always)]
                fn limit<const WRAPS: bool>(self, x: $int) -> $int {
                    if WRAPS {
                        (x << self.unused) >> self.unused
                    } else {
                        x.max(self.min).min(self.max)
                    }
                }
            }

            #[inline(always)]
            fn each<const MODE: u8, const WRAPS: bool>(
                out: &mut [$int],
                fit: Fit,
                exact: impl Fn(usize) -> $int,
            ) -> u64 {
                let mut overflows: $int = 0;
                for (at, out) in out.iter_mut().enumerate() {
                    let rounded = fit.round::<MODE>(exact(at));
                    let limited = fit.limit::<WRAPS>(rounded);
                    overflows += $int::from(limited != rounded);
                    *out = limited;
                }
                overflows as u64
            }

            /// A loop to come.
            pub(in super::super) struct Job<'a, F> {
                out: &'a mut [$int],
                fit: Fit,
                exact: F,
            }

            /// Writes the rounded and limited results; tells how many did not fit.
            #[inline(always)]
            pub(in super::super) fn fit<F: Fn(usize) -> $int>(
                out: &mut [$int],
                fit: Fit,
                exact: F,
            ) -> Job<'_, F> {
                Job { out, fit, exact }
            }

            impl<F: Fn(usize) -> $int> Loop for Job<'_, F> {
                type Output = u64;

                #[inline(always)]
                fn run(self) -> u64 {
                    let Self { out, fit, exact } = self;
                    chosen(out, fit, exact)
                }
            }

            #[inline(always)]
            fn chosen(out: &mut [$int], fit: Fit, exact: impl Fn(usize) -> $int) -> u64 {
                let mode = if fit.left > 0 {
                    3
                } else if fit.negative != 0 {
                    1
                } else if fit.odd != 0 {
                    2
                } else {
                    0
                };
                match (mode, fit.wraps) {
                    (0, false) => each::<0, false>(out, fit, exact),
                    (0, true) => each::<0, true>(out, fit, exact),
                    (1, false) => each::<1, false>(out, fit, exact),
                    (1, true) => each::<1, true>(out, fit, exact),
                    (2, false) => each::<2, false>(out, fit, exact),
                    (2, true) => each::<2, true>(out, fit, exact),
                    (_, false) => each::<3, false>(out, fit, exact),
                    (_, true) => each::<3, true>(out, fit, exact),
                }
            }
        }
    };
}
width!(narrow, i32, "32-bit intermediates.");
width!(wide, i64, "64-bit intermediates.");

/// A loop to come that writes values as they are.
pub(super) struct Each<'a, T, F> {
    out: &'a mut [T],
    value: F,
}

/// Writes the values.
#[inline(always)]
pub(super) fn each<T, F: Fn(usize) -> T>(out: &mut [T], value: F) -> Each<'_, T, F> {
    Each { out, value }
}

impl<T, F: Fn(usize) -> T> Loop for Each<'_, T, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (at, out) in self.out.iter_mut().enumerate() {
            *out = (self.value)(at);
        }
    }
}

/// 1.5 2^52: a sum with it shows an integer of up to 51 bits in the low bits of an `f64`, and back,
/// in two operations that every vector unit has.
const MAGIC: f64 = 6_755_399_441_055_744.0;

#[inline(always)]
fn to_real(x: i64) -> f64 {
    f64::from_bits(
        x.wrapping_add(MAGIC.to_bits().cast_signed())
            .cast_unsigned(),
    ) - MAGIC
}

/// The nearest integer.
#[inline(always)]
fn to_integer(x: f64) -> i64 {
    (x + MAGIC)
        .to_bits()
        .cast_signed()
        .wrapping_sub(MAGIC.to_bits().cast_signed())
}

const fn mask(condition: bool) -> i64 {
    -(condition as i64)
}

/// How a quotient or a root is rounded, as masks.
#[derive(Clone, Copy)]
pub(super) struct Nearest {
    ceil: i64,
    zero: i64,
    nearest: i64,
    tie_up: i64,
    tie_away: i64,
    tie_even: i64,
}

impl Nearest {
    pub(super) const fn new(rounding: Rounding) -> Self {
        Self {
            ceil: mask(matches!(rounding, Rounding::Ceil)),
            zero: mask(matches!(rounding, Rounding::Zero)),
            nearest: mask(matches!(
                rounding,
                Rounding::NearestUp | Rounding::NearestAway | Rounding::NearestEven
            )),
            tie_up: mask(matches!(rounding, Rounding::NearestUp)),
            tie_away: mask(matches!(rounding, Rounding::NearestAway)),
            tie_even: mask(matches!(rounding, Rounding::NearestEven)),
        }
    }
}

/// n / d rounded; both below 2^51, d not 0.
#[inline(always)]
pub(super) fn quotient(n: i64, d: i64, how: Nearest) -> i64 {
    let sign = d >> 63;
    let (n, d) = ((n ^ sign) - sign, (d ^ sign) - sign);
    // Off by less than 3/4, so that the floor is this or the one below.
    let near = to_integer(to_real(n) / to_real(d));
    let rest = n - near * d;
    let below = rest >> 63;
    let (floor, rest) = (near + below, rest + (d & below));
    let left = d - rest;
    let negative = floor >> 63;
    let tie = how.tie_up | (how.tie_away & !negative) | (how.tie_even & -(floor & 1));
    let up = (mask(rest != 0) & (how.ceil | (how.zero & negative)))
        | (mask(rest > left) & how.nearest)
        | (mask(rest == left) & tie);
    floor - up
}

/// sqrt(radicand) rounded; the radicand is below 2^51, negative ones count as 0.
#[inline(always)]
pub(super) fn root(radicand: i64, how: Nearest) -> i64 {
    let radicand = radicand & !(radicand >> 63);
    let near = to_integer(to_real(radicand).sqrt());
    let below = (radicand - near * near) >> 63;
    let floor = near + below;
    let rest = radicand - floor * floor;
    let up = (mask(rest != 0) & how.ceil) | (mask(rest > floor) & how.nearest);
    floor - up
}
