//! The oracle of arithmetic tests: rounding and overflow over exact rational numbers, written from
//! the modes' definitions and not from shifts. Also used by the tests of `numerics`.

use std::cmp::Ordering;

use cardan_datapath::{Format, Overflow, Rounding};
use num_bigint::BigInt;
use num_integer::Integer;
use num_rational::BigRational;
use num_traits::{One, Signed, Zero};

/// 2^power.
pub(crate) fn power_of_two(power: i64) -> BigRational {
    let magnitude = BigRational::from_integer(BigInt::one() << power.unsigned_abs());
    if power < 0 {
        magnitude.recip()
    } else {
        magnitude
    }
}

/// raw / 2^frac.
pub(crate) fn real(raw: impl Into<BigInt>, frac: u32) -> BigRational {
    BigRational::from_integer(raw.into()) / power_of_two(frac.into())
}

/// The integer that `mode` takes for `value`.
pub(crate) fn rounded(value: &BigRational, mode: Rounding) -> BigInt {
    let below = value.floor().to_integer();
    if value.is_integer() {
        return below;
    }
    let half = BigRational::new(1.into(), 2.into());
    let rest = value - BigRational::from_integer(below.clone());
    let up = match (mode, rest.cmp(&half)) {
        (Rounding::Floor, _) => false,
        (Rounding::Ceil, _) => true,
        (Rounding::Zero, _) => value.is_negative(),
        (_, Ordering::Less) => false,
        (_, Ordering::Greater) => true,
        (Rounding::NearestUp, Ordering::Equal) => true,
        (Rounding::NearestAway, Ordering::Equal) => !value.is_negative(),
        (Rounding::NearestEven, Ordering::Equal) => below.is_odd(),
    };
    if up { below + 1 } else { below }
}

/// The integer that `mode` takes for the square root of `value` >= 0.
pub(crate) fn rounded_root(value: &BigRational, mode: Rounding) -> BigInt {
    let below = value.floor().to_integer().sqrt();
    let square = |root: BigRational| &root * &root;
    let whole = BigRational::from_integer(below.clone());
    if square(whole.clone()) == *value {
        return below;
    }
    let half = BigRational::new(1.into(), 2.into());
    let up = match (mode, value.cmp(&square(whole + half))) {
        (Rounding::Floor | Rounding::Zero, _) => false,
        (Rounding::Ceil, _) => true,
        (_, Ordering::Less) => false,
        (_, Ordering::Greater) => true,
        (Rounding::NearestUp | Rounding::NearestAway, Ordering::Equal) => true,
        (Rounding::NearestEven, Ordering::Equal) => below.is_odd(),
    };
    if up { below + 1 } else { below }
}

/// The word that `format` keeps of `raw`, and whether that is another number.
pub(crate) fn limited(raw: &BigInt, format: Format) -> (BigInt, bool) {
    let span = BigInt::one() << format.word;
    let half: BigInt = &span / 2;
    let (min, max) = (-half.clone(), half - 1);
    let kept = match format.overflow {
        Overflow::Wrap => (raw - &min).mod_floor(&span) + &min,
        Overflow::Saturate | Overflow::Trap => raw.clone().clamp(min, max),
    };
    let overflow = kept != *raw;
    (kept, overflow)
}

/// `value` in `format`: the word, and whether it did not fit.
pub(crate) fn fitted(value: &BigRational, format: Format) -> (BigInt, bool) {
    limited(
        &rounded(&(value * power_of_two(format.frac.into())), format.rounding),
        format,
    )
}

/// sqrt(max(0, value)) in `format`.
pub(crate) fn fitted_root(value: &BigRational, format: Format) -> (BigInt, bool) {
    let value = if value.is_negative() {
        BigRational::zero()
    } else {
        value.clone()
    };
    let scaled = value * power_of_two(2 * i64::from(format.frac));
    limited(&rounded_root(&scaled, format.rounding), format)
}

/// Random operations per rounding and overflow mode: `CARDAN_RANDOM_OPERATIONS`, else 100,000.
pub(crate) fn random_operations() -> u32 {
    match std::env::var("CARDAN_RANDOM_OPERATIONS") {
        Ok(count) => count
            .parse()
            .expect("CARDAN_RANDOM_OPERATIONS: expected a count"),
        Err(_) => 100_000,
    }
}
