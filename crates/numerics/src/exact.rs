//! Operations on words with run-time formats: exact inside, rounded and limited once at the end.
//!
//! Intermediates are 128 bits wide. What exceeds even these (quotients and shifts far beyond the
//! result's word) is followed just closely enough to know the low bits and that it does not fit.

use cardan_datapath::rounding::exact;
use cardan_datapath::{Format, Overflow};

/// An exact word: raw / 2^frac.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word {
    /// The raw integer.
    pub raw: i64,
    /// Its fractional bits.
    pub frac: u32,
}

/// A raw word of the result's format, and whether the exact result did not fit it.
pub(crate) type Fitted = (i64, bool);

/// a + b or a - b. The formats' span is checked beforehand to leave headroom.
pub(crate) fn sum(a: Word, b: Word, minus: bool, format: Format) -> Fitted {
    let (a, b, frac) = aligned(a, b);
    fit(
        if minus { a - b } else { a + b },
        frac.cast_signed(),
        format,
    )
}

/// a * b.
pub(crate) fn product(a: Word, b: Word, format: Format) -> Fitted {
    let raw = i128::from(a.raw) * i128::from(b.raw);
    fit(raw, (a.frac + b.frac).cast_signed(), format)
}

/// a < b.
pub(crate) fn less(a: Word, b: Word) -> bool {
    let (a, b, _) = aligned(a, b);
    a < b
}

/// Both raw values at the finer resolution.
fn aligned(a: Word, b: Word) -> (i128, i128, u32) {
    let frac = a.frac.max(b.frac);
    let raw = |word: Word| i128::from(word.raw) << (frac - word.frac);
    (raw(a), raw(b), frac)
}

/// raw / 2^frac in `format`. Needs a bit of headroom in `raw`.
pub(crate) fn fit(raw: i128, frac: i32, format: Format) -> Fitted {
    let drop = frac.saturating_sub(format.frac.cast_signed());
    if drop >= 0 {
        let rounded = exact::shift_right(raw, drop.unsigned_abs(), format.rounding);
        return limit(rounded, format);
    }
    let lift = drop.unsigned_abs();
    let lifted = raw.checked_shl(lift).unwrap_or(0);
    if raw == 0 || (lift < i128::BITS && lifted >> lift == raw) {
        limit(lifted, format)
    } else {
        overflowed(lifted, raw < 0, format)
    }
}

fn limit(raw: i128, format: Format) -> Fitted {
    let (limited, overflow) = exact::limit(raw, format);
    (limited as i64, overflow)
}

/// A value beyond 128 bits of which only the low bits and the sign are known.
fn overflowed(low: i128, negative: bool, format: Format) -> Fitted {
    let unused = i128::BITS - format.word;
    let limited = match (format.overflow, negative) {
        (Overflow::Wrap, _) => ((low << unused) >> unused) as i64,
        (Overflow::Saturate | Overflow::Trap, true) => format.min_raw(),
        (Overflow::Saturate | Overflow::Trap, false) => format.max_raw(),
    };
    (limited, true)
}

/// a / b; b is not 0.
pub(crate) fn quotient(a: Word, b: Word, format: Format) -> Fitted {
    // raw(result) = raw(a) 2^up / raw(b), with up from -64 to 128.
    let up = (format.frac + b.frac).cast_signed() - a.frac.cast_signed();
    let (n, d) = (i128::from(a.raw), i128::from(b.raw));
    let lift = up.unsigned_abs();
    if up <= 0 {
        limit(exact::divide(n, d << lift, format.rounding), format)
    } else if lift < i64::BITS {
        limit(exact::divide(n << lift, d, format.rounding), format)
    } else {
        long_quotient(n, d, lift, format)
    }
}

/// n 2^up / d bit by bit, for numerators beyond 128 bits.
fn long_quotient(n: i128, d: i128, up: u32, format: Format) -> Fitted {
    let negative = (n < 0) != (d < 0);
    let (n, d) = (n.unsigned_abs(), d.unsigned_abs());
    let (mut magnitude, mut rest) = (n / d, n % d);
    let mut beyond = false;
    for _ in 0..up {
        // The highest bit is kept free for the sign.
        beyond |= magnitude >> (u128::BITS - 2) != 0;
        magnitude <<= 1;
        rest <<= 1;
        if rest >= d {
            rest -= d;
            magnitude |= 1;
        }
    }
    let odd = magnitude & 1 == 1;
    let up = exact::quotient_up(rest, d - rest, odd, negative, format.rounding);
    let magnitude = magnitude.wrapping_add(u128::from(up)).cast_signed();
    let low = if negative {
        magnitude.wrapping_neg()
    } else {
        magnitude
    };
    if beyond {
        overflowed(low, negative, format)
    } else {
        limit(low, format)
    }
}

/// sqrt(a); a is not negative.
pub(crate) fn root(a: Word, format: Format) -> Fitted {
    // root = floor(sqrt(a) 2^(frac + extra)): at least one extra bit, so that with a last bit for
    // "something remains" every rounding mode sees on which side of a tie it is.
    let up = 2 * format.frac.cast_signed() - a.frac.cast_signed();
    let extra = 1 + up.min(0).unsigned_abs().div_ceil(2);
    let (root, inexact) = root_floor(a.raw.unsigned_abs(), up + 2 * extra.cast_signed());
    let raw = (root << 1) | i128::from(inexact);
    fit(raw, (format.frac + extra + 1).cast_signed(), format)
}

/// floor(sqrt(raw 2^up)) and whether something remains. `up` is 0 to 130; two binary digits of the
/// radicand enter per digit of the root, so that only the root must fit.
fn root_floor(raw: u64, up: i32) -> (i128, bool) {
    let up = up.unsigned_abs();
    let head = u128::from(raw) << (up % 2);
    let (mut root, mut rest) = (0u128, 0u128);
    // The head has up to 65 bits.
    for pair in (0..33 + up / 2).rev() {
        let next = pair
            .checked_sub(up / 2)
            .map_or(0, |at| (head >> (2 * at)) & 3);
        rest = (rest << 2) | next;
        let trial = (root << 2) | 1;
        root <<= 1;
        if rest >= trial {
            rest -= trial;
            root |= 1;
        }
    }
    (root.cast_signed(), rest != 0)
}

/// A finite real number in `format`, rounded from its exact value.
pub(crate) fn quantise(value: f64, format: Format) -> Fitted {
    const MANTISSA_BITS: u32 = f64::MANTISSA_DIGITS - 1;
    let bits = value.to_bits();
    let biased = ((bits >> MANTISSA_BITS) & 0x7ff) as i32;
    let fraction = (bits & ((1 << MANTISSA_BITS) - 1)) as i128;
    let hidden = i128::from(biased != 0) << MANTISSA_BITS;
    let magnitude = fraction | hidden;
    // value = magnitude 2^(exponent - 1075), subnormals with the exponent of the smallest normals.
    let frac = 1075 - biased.max(1);
    fit(
        if value < 0.0 { -magnitude } else { magnitude },
        frac,
        format,
    )
}
