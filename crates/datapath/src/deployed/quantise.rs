//! Quantisation: exact intermediates into nodes' words.

use fixed::traits::Fixed;

use super::Deployed;
use crate::container::Container;
use crate::kernel;
use crate::rounding::{narrow, wide};
use crate::{Format, Node, Overflow, Rounding, Tap, Value};

impl<T: Tap> Deployed<T> {
    /// The 16-bit kernels limit words but do not tell that they did.
    pub(super) const WITH_KERNELS: bool = !T::SEES_OVERFLOWS;

    /// Rounds and limits a 32-bit value with `frac` fractional bits into node `N`.
    #[inline(always)]
    pub(super) fn fit32<N: Node>(&self, raw: i32, frac: u32) -> Value<Self, N> {
        let format = const { format_of::<N>() };
        if Self::WITH_KERNELS && is_kernel_word(format) {
            match frac.wrapping_sub(format.frac) {
                14 => return self.of16(kernel::round14(raw)),
                15 => return self.of16(kernel::round15(raw)),
                _ => {}
            }
        }
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
    pub(super) fn fit64<N: Node>(&self, raw: i64, frac: u32) -> Value<Self, N> {
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
    pub(super) fn record<N: Node>(&self, value: Value<Self, N>) -> Value<Self, N> {
        self.tap.write(N::INDEX, raw64(value));
        value
    }

    #[inline(always)]
    pub(super) fn write32<N: Node>(&self, raw: i32, frac: u32) -> Value<Self, N> {
        self.record(self.fit32(raw, frac))
    }

    /// A word that needs no more rounding or limiting.
    #[inline(always)]
    fn of16<N: Node>(&self, raw: i16) -> Value<Self, N> {
        Value(<N::Word as Fixed>::from_bits(Container::from_i32(
            i32::from(raw),
        )))
    }

    #[inline(always)]
    pub(super) fn write16<N: Node>(&self, raw: i16) -> Value<Self, N> {
        self.record(self.of16(raw))
    }

    #[inline(always)]
    pub(super) fn write64<N: Node>(&self, raw: i64, frac: u32) -> Value<Self, N> {
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

    /// Whether a + b and a - b are sums of 16-bit words in one format: then the 16-bit instructions
    /// of every machine do. (They tell no overflow.)
    pub(super) const fn is_word16<N: Node, A: Node, B: Node>() -> bool {
        let frac = N::FORMAT.frac;
        Self::WITH_KERNELS
            && !matches!(N::FORMAT.overflow, Overflow::Trap)
            && N::FORMAT.word == 16
            && A::FORMAT.word == 16
            && B::FORMAT.word == 16
            && A::FORMAT.frac == frac
            && B::FORMAT.frac == frac
    }

    /// Bits that a value of `word` bits and `frac` fractional bits needs, aligned to `to` fractional
    /// bits, before it is limited.
    pub(super) const fn aligned(word: u32, frac: u32, to: u32) -> u32 {
        if to > frac { word + to - frac } else { word }
    }

    #[inline(always)]
    pub(super) fn sum<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
        minus: bool,
    ) -> Value<Self, N> {
        // One bit for the carry, and one of headroom where the rounding needs it.
        let frac = const { max(A::FORMAT.frac, B::FORMAT.frac) };
        let bits = const {
            let frac = max(A::FORMAT.frac, B::FORMAT.frac);
            let a = Self::aligned(A::FORMAT.word, A::FORMAT.frac, frac);
            let b = Self::aligned(B::FORMAT.word, B::FORMAT.frac, frac);
            let headroom = 1 + needs_headroom(N::FORMAT, frac) as u32;
            let bits = Self::aligned(max(a, b) + headroom, frac, N::FORMAT.frac);
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
    pub(super) fn convert<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N> {
        let bits = const {
            let bits = Self::aligned(A::FORMAT.word + 1, A::FORMAT.frac, N::FORMAT.frac);
            assert!(
                bits <= 64,
                "a conversion needs more than 64 bits: choose narrower formats"
            );
            bits
        };
        if let Some(doublings) = const { Self::doublings::<N, A>(A::FORMAT.frac) } {
            self.write16(double16(raw16(a), doublings))
        } else if const { A::FORMAT.frac == N::FORMAT.frac && A::FORMAT.word <= N::FORMAT.word } {
            self.record(Value(<N::Word as Fixed>::from_bits(
                if const { N::FORMAT.word <= 32 } {
                    Container::from_i32(raw32(a))
                } else {
                    Container::from_i64(raw64(a))
                },
            )))
        } else if bits <= 32 {
            self.write32(raw32(a), A::FORMAT.frac)
        } else {
            self.write64(raw64(a), A::FORMAT.frac)
        }
    }

    /// How often a 16-bit word is doubled on its way into node N; `frac` are the fractional bits it
    /// is taken to have. `None` if that is not all, or if it is not worth it.
    pub(super) const fn doublings<N: Node, A: Node>(frac: u32) -> Option<u32> {
        let format = N::FORMAT;
        if Self::WITH_KERNELS
            && format.word == 16
            && matches!(format.overflow, Overflow::Saturate)
            && A::FORMAT.word <= 16
            && format.frac >= frac
            && format.frac - frac <= 3
        {
            Some(format.frac - frac)
        } else {
            None
        }
    }

    /// -a if `condition`, else a.
    #[inline(always)]
    pub(super) fn negate_if<N: Node, A: Node>(
        &self,
        condition: bool,
        a: Value<Self, A>,
    ) -> Value<Self, N> {
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
pub(super) const fn format_of<N: Node>() -> Format {
    assert!(
        <N::Word as Fixed>::FRAC_NBITS == N::FORMAT.frac
            && N::FORMAT.word as usize <= 8 * size_of::<N::Word>(),
        "a node's `Word` must have the fractional bits of its FORMAT and hold its word"
    );
    N::FORMAT
}

pub(super) const fn max(a: u32, b: u32) -> u32 {
    if a > b { a } else { b }
}

pub(super) const fn min(a: u32, b: u32) -> u32 {
    if a < b { a } else { b }
}

#[inline(always)]
pub(super) fn raw64<T: Tap, N: Node>(value: Value<Deployed<T>, N>) -> i64 {
    value.0.to_bits().to_i64()
}

#[inline(always)]
pub(super) fn raw32<T: Tap, N: Node>(value: Value<Deployed<T>, N>) -> i32 {
    value.0.to_bits().to_i32()
}

/// The low 16 bits of a narrower or equal word.
#[inline(always)]
pub(super) fn raw16<T: Tap, N: Node>(value: Value<Deployed<T>, N>) -> i16 {
    value.0.to_bits().to_i16()
}

/// raw 2^times limited to 16 bits.
#[inline(always)]
pub(super) fn double16(raw: i16, times: u32) -> i16 {
    // No loop: small code is preferred to unrolled code where this matters.
    let once = kernel::add16(raw, raw);
    match times {
        0 => raw,
        1 => once,
        2 => kernel::add16(once, once),
        _ => double16_twice(once),
    }
}

#[inline(always)]
fn double16_twice(raw: i16) -> i16 {
    let once = kernel::add16(raw, raw);
    kernel::add16(once, once)
}

/// The formats that the 16-bit kernels round into.
pub(super) const fn is_kernel_word(format: Format) -> bool {
    format.word == 16
        && matches!(format.rounding, Rounding::NearestUp)
        && matches!(format.overflow, Overflow::Saturate)
}

/// Roundings from `frac` fractional bits that negate, or add before they shift.
pub(super) const fn needs_headroom(format: Format, frac: u32) -> bool {
    match format.rounding {
        Rounding::Ceil | Rounding::Zero | Rounding::NearestAway => true,
        Rounding::NearestUp => frac == format.frac + 1,
        Rounding::Floor | Rounding::NearestEven => false,
    }
}
