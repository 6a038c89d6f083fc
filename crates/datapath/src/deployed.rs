//! The deployed arithmetic: the firmware itself, with the same bits on every target.
//!
//! An operation computes exactly in the narrowest sufficient intermediate (32 or 64 bit, decided at
//! compile time from the formats), then rounds and limits once. A format pair that needs more than
//! 64 bits is a build error.

use core::cell::Cell;

use fixed::traits::Fixed;

use crate::container::Container;
use crate::kernel::{divide32, multiply16, square_root32};
use crate::quantised::Quantised;
use crate::rounding::{narrow, wide};
use crate::{Arithmetic, Constant, Format, Node, Overflow, Table, Tap, Value};

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

    /// Rounds and limits a 32-bit value with `frac` fractional bits into node `N`.
    #[inline(always)]
    fn fit32<N: Node>(&self, raw: i32, frac: u32) -> Value<Self, N> {
        let format = const { format_of::<N>() };
        let rounded = if frac >= format.frac {
            narrow::shift_right(raw, frac - format.frac, format.rounding)
        } else {
            raw << (format.frac - frac)
        };
        let (limited, overflow) = narrow::limit(rounded, format);
        self.note::<N>(overflow);
        Value(<N::Word as Fixed>::from_bits(Container::from_i32(limited)))
    }

    /// Rounds and limits a 64-bit value with `frac` fractional bits into node `N`.
    #[inline(always)]
    fn fit64<N: Node>(&self, raw: i64, frac: u32) -> Value<Self, N> {
        let format = const { format_of::<N>() };
        let rounded = if frac >= format.frac {
            wide::shift_right(raw, frac - format.frac, format.rounding)
        } else {
            raw << (format.frac - frac)
        };
        let (limited, overflow) = wide::limit(rounded, format);
        self.note::<N>(overflow);
        Value(<N::Word as Fixed>::from_bits(Container::from_i64(limited)))
    }

    /// Shows a write to the tap.
    #[inline(always)]
    fn record<N: Node>(&self, value: Value<Self, N>) -> Value<Self, N> {
        self.tap.write(N::INDEX, raw64(value));
        value
    }

    #[inline(always)]
    fn write32<N: Node>(&self, raw: i32, frac: u32) -> Value<Self, N> {
        self.record(self.fit32(raw, frac))
    }

    #[inline(always)]
    fn write64<N: Node>(&self, raw: i64, frac: u32) -> Value<Self, N> {
        self.record(self.fit64(raw, frac))
    }

    #[inline(always)]
    fn note<N: Node>(&self, overflow: bool) {
        if overflow {
            self.tap.overflow(N::INDEX);
            if matches!(N::FORMAT.overflow, Overflow::Trap) {
                self.fail();
            }
        }
    }

    /// Bits that a value of `word` bits and `frac` fractional bits needs, aligned to `to` fractional
    /// bits, before it is limited.
    const fn aligned(word: u32, frac: u32, to: u32) -> u32 {
        if to > frac { word + to - frac } else { word }
    }

    #[inline(always)]
    fn sum<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
        minus: bool,
    ) -> Value<Self, N> {
        // One bit for the carry and one of headroom for rounding.
        let frac = const { max(A::FORMAT.frac, B::FORMAT.frac) };
        let bits = const {
            let frac = max(A::FORMAT.frac, B::FORMAT.frac);
            let a = Self::aligned(A::FORMAT.word, A::FORMAT.frac, frac);
            let b = Self::aligned(B::FORMAT.word, B::FORMAT.frac, frac);
            let bits = Self::aligned(max(a, b) + 2, frac, N::FORMAT.frac);
            assert!(
                bits <= 64,
                "a sum needs more than 64 bits: choose narrower formats"
            );
            bits
        };
        if bits <= 32 {
            let a = raw32(a) << (frac - A::FORMAT.frac);
            let b = raw32(b) << (frac - B::FORMAT.frac);
            self.write32(if minus { a - b } else { a + b }, frac)
        } else {
            let a = raw64(a) << (frac - A::FORMAT.frac);
            let b = raw64(b) << (frac - B::FORMAT.frac);
            self.write64(if minus { a - b } else { a + b }, frac)
        }
    }

    /// A single operand brought into another format.
    #[inline(always)]
    fn convert<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        let bits = const {
            let bits = Self::aligned(A::FORMAT.word + 1, A::FORMAT.frac, N::FORMAT.frac);
            assert!(
                bits <= 64,
                "a conversion needs more than 64 bits: choose narrower formats"
            );
            bits
        };
        if bits <= 32 {
            self.write32(raw32(a), A::FORMAT.frac)
        } else {
            self.write64(raw64(a), A::FORMAT.frac)
        }
    }

    /// -a if `condition`, else a.
    #[inline(always)]
    fn negate_if<N: Node, A: Node>(&self, condition: bool, a: Value<Self, A>) -> Value<Self, N> {
        // One bit for the negation of the most negative word, one of headroom for rounding.
        let bits = const {
            let bits = Self::aligned(A::FORMAT.word + 2, A::FORMAT.frac, N::FORMAT.frac);
            assert!(
                bits <= 64,
                "a negation or magnitude needs more than 64 bits: choose narrower formats"
            );
            bits
        };
        if bits <= 32 {
            let raw = raw32(a);
            self.write32(if condition { -raw } else { raw }, A::FORMAT.frac)
        } else {
            let raw = raw64(a);
            self.write64(if condition { -raw } else { raw }, A::FORMAT.frac)
        }
    }
}

/// The format of `N`, which its `fixed` type must be able to hold.
const fn format_of<N: Node>() -> Format {
    assert!(
        <N::Word as Fixed>::FRAC_NBITS == N::FORMAT.frac
            && N::FORMAT.word as usize <= 8 * size_of::<N::Word>(),
        "a node's `Word` must have the fractional bits of its FORMAT and hold its word"
    );
    N::FORMAT
}

const fn max(a: u32, b: u32) -> u32 {
    if a > b { a } else { b }
}

const fn min(a: u32, b: u32) -> u32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn raw64<T: Tap, N: Node>(value: Value<Deployed<T>, N>) -> i64 {
    value.0.to_bits().to_i64()
}

#[inline(always)]
fn raw32<T: Tap, N: Node>(value: Value<Deployed<T>, N>) -> i32 {
    value.0.to_bits().to_i32()
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
        // Without rounding 32 bits suffice; rounding any i32 needs headroom.
        if const { F == N::FORMAT.frac } {
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
        self.sum(a, b, false)
    }

    #[inline(always)]
    fn sub<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N> {
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
            let (a, b) = (a.0.to_bits().to_i16(), b.0.to_bits().to_i16());
            self.write32(multiply16(a, b), frac)
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
        let (left, right) = if up > 0 {
            (up as u32, 0)
        } else {
            (0, up.unsigned_abs())
        };
        if bits < 32 {
            let quotient = divide32(raw32(a) << left, raw32(b) << right, format.rounding);
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
            self.write32(square_root32(radicand, format.rounding) as i32, format.frac)
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
        if bits <= 32 {
            self.write32(raw32(a) << first, frac)
        } else {
            self.write64(raw64(a) << first, frac)
        }
    }

    #[inline(always)]
    fn neg<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        self.negate_if(true, a)
    }

    #[inline(always)]
    fn abs<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
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
