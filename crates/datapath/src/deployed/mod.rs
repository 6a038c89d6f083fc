//! The deployed arithmetic: the firmware itself, with the same bits on every target.
//!
//! An operation computes exactly in the narrowest sufficient intermediate (32 or 64 bit, decided at
//! compile time from the formats), then rounds and limits once. A format pair that needs more than
//! 64 bits is a build error.

mod quantise;

use core::cell::Cell;

use fixed::traits::Fixed;

use self::quantise::{double16, is_kernel_word, max, min, needs_headroom, raw16, raw32, raw64};
use crate::container::Container;
use crate::kernel;
use crate::quantised::Quantised;
use crate::rounding::wide;
use crate::{Arithmetic, Constant, Node, Overflow, Table, Tap, Value};

/// Status bit of the arithmetic itself: a zero divisor, a negative radicand or a trapped overflow.
/// An algorithm whose own status bits lie otherwise chooses another.
pub const DEFAULT_DOMAIN_FLAG: u16 = 1 << 4;

/// Computes with the nodes' `fixed` types.
#[derive(Debug)]
pub struct Deployed<T: Tap> {
    tap: T,
    domain_flag: u16,
    status: Cell<u16>,
}

impl<T: Tap> Deployed<T> {
    /// Writes are shown to `tap`.
    pub const fn new(tap: T) -> Self {
        Self::with_domain_flag(tap, DEFAULT_DOMAIN_FLAG)
    }

    /// As [`Deployed::new`]; the arithmetic's own status bit is `domain_flag`.
    pub const fn with_domain_flag(tap: T, domain_flag: u16) -> Self {
        Self {
            tap,
            domain_flag,
            status: Cell::new(0),
        }
    }

    /// The tap.
    pub const fn tap(&self) -> &T {
        &self.tap
    }

    #[inline(always)]
    fn fail(&self) {
        self.status.set(self.status.get() | self.domain_flag);
    }
}

impl<T: Tap> Arithmetic for Deployed<T> {
    type Word<N: Node> = N::Word;
    type Bool = bool;

    #[inline(always)]
    fn input<N: Node, const F: u32>(&self, raw: i32) -> Value<Self, N> {
        self.record(self.parameter::<N, F>(raw))
    }

    #[inline(always)]
    fn parameter<N: Node, const F: u32>(&self, raw: i32) -> Value<Self, N> {
        // 32 bits suffice unless the rounding needs headroom.
        if const { F == N::FORMAT.frac || F > N::FORMAT.frac && !needs_headroom(N::FORMAT, F) } {
            self.fit32(raw, F)
        } else {
            const {
                assert!(
                    Self::aligned(33, F, N::FORMAT.frac) <= 64,
                    "input format too wide"
                )
            };
            self.fit64(i64::from(raw), F)
        }
    }

    #[inline(always)]
    fn constant<N: Node, C: Constant>(&self) -> Value<Self, N> {
        let raw = const { N::FORMAT.constant(C::VALUE) };
        Value(<N::Word as Fixed>::from_bits(Container::from_i64(raw)))
    }

    #[inline(always)]
    fn entry<N: Node, C: Table>(&self, index: usize) -> Value<Self, N> {
        let values = const { &Quantised::<N, C>::RAW };
        let raw = values[if index < C::VALUES.len() {
            index
        } else {
            C::VALUES.len() - 1
        }];
        Value(<N::Word as Fixed>::from_bits(Container::from_i64(raw)))
    }

    #[inline(always)]
    fn lookup<N: Node, I: Node, C: Table>(&self, index: Value<Self, I>) -> Value<Self, N> {
        let whole = raw64(index) >> const { min(I::FORMAT.frac, 63) };
        let last = (C::VALUES.len() - 1) as i64;
        let limited = if whole < 0 {
            0
        } else if whole > last {
            last
        } else {
            whole
        };
        self.record(self.entry::<N, C>(limited as usize))
    }

    #[inline(always)]
    fn add<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        if const { Self::is_word16::<N, A, B>() } {
            let (a, b) = (raw16(a), raw16(b));
            return self.write16(match N::FORMAT.overflow {
                Overflow::Wrap => a.wrapping_add(b),
                _ => kernel::add16(a, b),
            });
        }
        self.sum(a, b, false)
    }

    #[inline(always)]
    fn sub<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        if const { Self::is_word16::<N, A, B>() } {
            let (a, b) = (raw16(a), raw16(b));
            return self.write16(match N::FORMAT.overflow {
                Overflow::Wrap => a.wrapping_sub(b),
                _ => kernel::sub16(a, b),
            });
        }
        self.sum(a, b, true)
    }

    #[inline(always)]
    fn mul<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        let frac = const { A::FORMAT.frac + B::FORMAT.frac };
        let bits = const {
            let frac = A::FORMAT.frac + B::FORMAT.frac;
            let bits = Self::aligned(A::FORMAT.word + B::FORMAT.word, frac, N::FORMAT.frac);
            assert!(
                bits <= 64,
                "a product needs more than 64 bits: choose narrower formats"
            );
            bits
        };
        if A::FORMAT.word <= 16 && B::FORMAT.word <= 16 && bits <= 32 {
            let (a, b) = (raw16(a), raw16(b));
            let shift = frac.wrapping_sub(N::FORMAT.frac);
            if Self::WITH_KERNELS && is_kernel_word(N::FORMAT) && (12..=16).contains(&shift) {
                return self.write16(match shift {
                    12 => kernel::multiply_round12(a, b),
                    13 => kernel::multiply_round13(a, b),
                    14 => kernel::multiply_round14(a, b),
                    15 => kernel::multiply_round15(a, b),
                    _ => kernel::multiply_round16(a, b),
                });
            }
            if Self::WITH_KERNELS
                && N::FORMAT.word == 31
                && N::FORMAT.frac == frac
                && matches!(N::FORMAT.overflow, Overflow::Saturate)
            {
                let product = kernel::multiply31(a, b);
                return self.record(Value(<N::Word as Fixed>::from_bits(Container::from_i32(
                    product,
                ))));
            }
            self.write32(kernel::multiply16(a, b), frac)
        } else if bits <= 32 {
            self.write32(raw32(a) * raw32(b), frac)
        } else {
            self.write64(raw64(a) * raw64(b), frac)
        }
    }

    #[inline(always)]
    fn div<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        // raw(N) = raw(a) 2^up / raw(b), with up possibly negative: then the divisor is shifted.
        let up = const { N::FORMAT.frac as i32 + B::FORMAT.frac as i32 - A::FORMAT.frac as i32 };
        let bits = const {
            let up = N::FORMAT.frac as i32 + B::FORMAT.frac as i32 - A::FORMAT.frac as i32;
            let n = A::FORMAT.word + if up > 0 { up as u32 } else { 0 };
            let d = B::FORMAT.word + if up < 0 { up.unsigned_abs() } else { 0 };
            assert!(
                n < 64 && d < 64,
                "a quotient needs more than 64 bits: narrower formats"
            );
            max(n, d)
        };
        let format = N::FORMAT;
        let divisor = raw64(b);
        if divisor == 0 {
            self.fail();
            let end = if raw64(a) < 0 {
                format.min_raw()
            } else {
                format.max_raw()
            };
            self.tap.overflow(N::INDEX);
            return self.record(Value(<N::Word as Fixed>::from_bits(Container::from_i64(
                end,
            ))));
        }
        if Self::WITH_KERNELS
            && is_kernel_word(N::FORMAT)
            && A::FORMAT.word <= 16
            && B::FORMAT.word <= 16
            && (up == 14 || up == 15)
        {
            let (a, b) = (raw16(a), raw16(b));
            return self.write16(if up == 14 {
                kernel::divide14(a, b)
            } else {
                kernel::divide15(a, b)
            });
        }
        let (left, right) = if up > 0 {
            (up as u32, 0)
        } else {
            (0, up.unsigned_abs())
        };
        if bits < 32 {
            let quotient = kernel::divide32(raw32(a) << left, raw32(b) << right, format.rounding);
            self.write32(quotient, format.frac)
        } else {
            let quotient = wide::divide(raw64(a) << left, divisor << right, format.rounding);
            self.write64(quotient, format.frac)
        }
    }

    #[inline(always)]
    fn sqrt<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        // raw(N) = sqrt(raw(a) 2^up).
        let up = const {
            let up = 2 * N::FORMAT.frac as i32 - A::FORMAT.frac as i32;
            // Fewer would also bring ties, which `square_root` does not know.
            assert!(
                up >= 0,
                "a square root keeps at least half its argument's fractional bits"
            );
            let up = up as u32;
            assert!(
                A::FORMAT.word + up <= 64,
                "a square root needs more than 64 bits"
            );
            up
        };
        let format = N::FORMAT;
        let negative = raw64(a) < 0;
        if negative {
            self.fail();
        }
        if A::FORMAT.word + up <= 32 {
            let radicand = if negative { 0 } else { (raw32(a) as u32) << up };
            if Self::WITH_KERNELS && is_kernel_word(format) {
                return self.write16(kernel::square_root16(radicand));
            }
            self.write32(
                kernel::square_root32(radicand, format.rounding) as i32,
                format.frac,
            )
        } else {
            let radicand = if negative { 0 } else { (raw64(a) as u64) << up };
            self.write64(
                wide::square_root(radicand, format.rounding) as i64,
                format.frac,
            )
        }
    }

    #[inline(always)]
    fn shift<N: Node, A: Node, const POWER: i32>(&self, a: Value<Self, A>) -> Value<Self, N> {
        // a 2^POWER has frac - POWER fractional bits; a negative count is an exact shift first.
        let (frac, first) = const {
            let frac = A::FORMAT.frac as i32 - POWER;
            if frac >= 0 {
                (frac as u32, 0)
            } else {
                (0, frac.unsigned_abs())
            }
        };
        let bits = const {
            let frac = A::FORMAT.frac as i32 - POWER;
            let (frac, first) = if frac >= 0 {
                (frac as u32, 0)
            } else {
                (0, frac.unsigned_abs())
            };
            let bits = Self::aligned(A::FORMAT.word + first + 1, frac, N::FORMAT.frac);
            assert!(
                bits <= 64,
                "a shift needs more than 64 bits: choose narrower formats"
            );
            bits
        };
        let doublings = const {
            let frac = A::FORMAT.frac as i32 - POWER;
            if frac >= 0 {
                Self::doublings::<N, A>(frac as u32)
            } else {
                None
            }
        };
        if let Some(doublings) = doublings {
            self.write16(double16(raw16(a), doublings))
        } else if bits <= 32 {
            self.write32(raw32(a) << first, frac)
        } else {
            self.write64(raw64(a) << first, frac)
        }
    }

    #[inline(always)]
    fn scale<N: Node, A: Node, const LEAST: i32, const MOST: i32>(
        &self,
        a: Value<Self, A>,
        power: i32,
    ) -> Value<Self, N> {
        // Shifted left by what the power exceeds the least one, after which the point lies fixed.
        let (frac, bits) = const {
            assert!(LEAST <= MOST, "no power lies in LEAST..=MOST");
            let frac = A::FORMAT.frac as i32 - LEAST;
            assert!(
                frac >= 0,
                "the least power leaves no fractional bit: shift first"
            );
            let word = A::FORMAT.word + (MOST - LEAST) as u32 + 1;
            let bits = Self::aligned(word, frac as u32, N::FORMAT.frac);
            assert!(
                bits <= 64,
                "a scaled value needs more than 64 bits: choose narrower formats"
            );
            (frac as u32, bits)
        };
        let up = (if power < LEAST {
            0
        } else if power > MOST {
            MOST - LEAST
        } else {
            power - LEAST
        }) as u32;
        if bits <= 32 {
            self.write32(raw32(a) << up, frac)
        } else {
            self.write64(raw64(a) << up, frac)
        }
    }

    #[inline(always)]
    fn neg<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        if const { Self::is_word16::<N, A, A>() } {
            let raw = raw16(a);
            return self.write16(match N::FORMAT.overflow {
                Overflow::Wrap => raw.wrapping_neg(),
                _ => kernel::neg16(raw),
            });
        }
        self.negate_if(true, a)
    }

    #[inline(always)]
    fn abs<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        if const { Self::is_word16::<N, A, A>() } {
            let raw = raw16(a);
            return self.write16(match N::FORMAT.overflow {
                Overflow::Wrap => raw.wrapping_abs(),
                _ => kernel::abs16(raw),
            });
        }
        self.negate_if(self.negative(a), a)
    }

    #[inline(always)]
    fn less<A: Node, B: Node>(&self, a: Value<Self, A>, b: Value<Self, B>) -> bool {
        let frac = const { max(A::FORMAT.frac, B::FORMAT.frac) };
        let bits = const {
            let frac = max(A::FORMAT.frac, B::FORMAT.frac);
            let bits = max(
                Self::aligned(A::FORMAT.word, A::FORMAT.frac, frac),
                Self::aligned(B::FORMAT.word, B::FORMAT.frac, frac),
            );
            assert!(bits <= 64, "a comparison needs more than 64 bits");
            bits
        };
        if bits <= 32 {
            raw32(a) << (frac - A::FORMAT.frac) < raw32(b) << (frac - B::FORMAT.frac)
        } else {
            raw64(a) << (frac - A::FORMAT.frac) < raw64(b) << (frac - B::FORMAT.frac)
        }
    }

    #[inline(always)]
    fn negative<A: Node>(&self, a: Value<Self, A>) -> bool {
        a.0.to_bits().to_i64() < 0
    }

    #[inline(always)]
    fn truth(&self, value: bool) -> bool {
        value
    }

    #[inline(always)]
    fn not(&self, a: bool) -> bool {
        !a
    }

    #[inline(always)]
    fn or(&self, a: bool, b: bool) -> bool {
        a | b
    }

    #[inline(always)]
    fn xor(&self, a: bool, b: bool) -> bool {
        a ^ b
    }

    #[inline(always)]
    fn either(&self, condition: bool, a: bool, b: bool) -> bool {
        if condition { a } else { b }
    }

    #[inline(always)]
    fn select<N: Node, A: Node, B: Node>(
        &self,
        condition: bool,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
        if condition {
            self.convert(a)
        } else {
            self.convert(b)
        }
    }

    #[inline(always)]
    fn raise(&self, flags: u16, condition: bool) {
        if condition {
            self.status.set(self.status.get() | flags);
        }
    }

    #[inline(always)]
    fn take_status(&self) -> u16 {
        self.status.replace(0)
    }
}
