//! Rounding and overflow in all three widths agree with exact rational arithmetic.

#[allow(dead_code, reason = "each test uses its part of the oracle")]
mod rationals;

use cardan_datapath::{Format, Overflow, Rounding};
use num_bigint::BigInt;
use num_rational::BigRational;
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

use rationals::{limited, power_of_two, random_operations, rounded, rounded_root};

/// 128 random bits, of which a random number is kept: all magnitudes are as likely.
fn any_magnitude(rng: &mut ChaCha8Rng, bits: u32) -> i128 {
    let raw = (u128::from(rng.next_u64()) << 64 | u128::from(rng.next_u64())).cast_signed();
    let kept = 1 + rng.next_u32() % bits;
    let edge = i128::MAX >> (128 - kept);
    match rng.next_u32() % 16 {
        0 => edge,
        1 => -edge - 1,
        _ => raw >> (128 - kept),
    }
}

fn formats(overflow: Overflow, words: std::ops::RangeInclusive<u32>) -> Vec<Format> {
    words
        .map(|word| Format::new(word, 0, Rounding::Floor, overflow))
        .collect()
}

macro_rules! laws {
    ($width:ident, $int:ident, $uint:ident) => {
        mod $width {
            use super::*;
            use cardan_datapath::rounding::$width::{divide, limit, shift_right, square_root};

            fn check_shift(raw: $int, shift: u32, mode: Rounding) {
                let exact = BigRational::from_integer(raw.into()) * power_of_two(-i64::from(shift));
                assert_eq!(
                    BigInt::from(shift_right(raw, shift, mode)),
                    rounded(&exact, mode),
                    "{raw} / 2^{shift} {mode:?}"
                );
            }

            fn check_division(n: $int, d: $int, mode: Rounding) {
                let exact = BigRational::new(n.into(), d.into());
                assert_eq!(
                    BigInt::from(divide(n, d, mode)),
                    rounded(&exact, mode),
                    "{n} / {d} {mode:?}"
                );
            }

            fn check_root(radicand: $uint, mode: Rounding) {
                let exact = BigRational::from_integer(radicand.into());
                assert_eq!(
                    BigInt::from(square_root(radicand, mode)),
                    rounded_root(&exact, mode),
                    "sqrt {radicand} {mode:?}"
                );
            }

            fn check_limit(raw: $int, format: Format) {
                let (kept, overflow) = limit(raw, format);
                assert_eq!(
                    (BigInt::from(kept), overflow),
                    limited(&raw.into(), format),
                    "{raw} in {format:?}"
                );
            }

            #[test]
            fn every_small_case_agrees() {
                for (mode, _) in Rounding::ALL {
                    for raw in -64..64 {
                        for shift in 0..=2 * $int::BITS {
                            check_shift(raw, shift, mode);
                        }
                        for d in (-64..64).filter(|d| *d != 0) {
                            check_division(raw, d, mode);
                        }
                    }
                    for radicand in 0..4096 {
                        check_root(radicand, mode);
                    }
                }
                for (overflow, _) in Overflow::ALL {
                    for format in formats(overflow, 1..=6) {
                        for raw in -256..256 {
                            check_limit(raw, format);
                        }
                    }
                }
            }

            #[test]
            fn the_ends_of_the_range_agree() {
                // One bit of headroom is the callers' part.
                let (min, max) = ($int::MIN >> 1, $int::MAX >> 1);
                for (mode, _) in Rounding::ALL {
                    for raw in [min, min + 1, max - 1, max, min >> 1, max >> 1] {
                        for shift in 0..=$int::BITS + 1 {
                            check_shift(raw, shift, mode);
                        }
                        for d in [1, -1, 2, -2, 3, -3, min, min + 1, max, max - 1] {
                            check_division(raw, d, mode);
                        }
                        check_division(raw, $int::MIN, mode);
                        check_division(raw, $int::MAX, mode);
                    }
                    for radicand in [0, 1, $uint::MAX, $uint::MAX - 1, $uint::MAX >> 1] {
                        check_root(radicand, mode);
                    }
                }
                for (overflow, _) in Overflow::ALL {
                    for format in formats(overflow, 1..=64) {
                        for raw in [$int::MIN, $int::MIN + 1, -1, 0, 1, $int::MAX - 1, $int::MAX] {
                            check_limit(raw, format);
                        }
                    }
                }
            }

            #[test]
            fn random_cases_agree() {
                let mut rng = ChaCha8Rng::seed_from_u64(u64::from($int::BITS));
                let headroom = $int::BITS - 1;
                for (mode, _) in Rounding::ALL {
                    for _ in 0..random_operations() / 3 {
                        let raw = any_magnitude(&mut rng, headroom) as $int;
                        check_shift(raw, rng.next_u32() % ($int::BITS + 2), mode);
                        let d = any_magnitude(&mut rng, $int::BITS) as $int;
                        if d != 0 {
                            check_division(raw, d, mode);
                        }
                        check_root(any_magnitude(&mut rng, $int::BITS) as $uint, mode);
                    }
                }
                for (overflow, _) in Overflow::ALL {
                    let formats = formats(overflow, 1..=64);
                    for _ in 0..random_operations() {
                        let format = formats[rng.next_u32() as usize % formats.len()];
                        check_limit(any_magnitude(&mut rng, $int::BITS) as $int, format);
                    }
                }
            }
        }
    };
}

laws!(narrow, i32, u32);
laws!(wide, i64, u64);
laws!(exact, i128, u128);
