//! Formats as values: ends, constants, and the hash of a node table.

#[allow(dead_code, reason = "each test uses its part of the oracle")]
mod rationals;

use cardan_datapath::{Format, NodeInfo, Overflow, Rounding, table_hash};
use num_bigint::BigInt;
use num_rational::BigRational;
use proptest::prelude::*;

use rationals::{limited, power_of_two, rounded};

fn any_format() -> impl Strategy<Value = Format> {
    (1u32..=64, 0u32..=64, 0usize..6, 0usize..3).prop_map(|(word, frac, rounding, overflow)| {
        Format::new(
            word,
            frac,
            Rounding::ALL[rounding].0,
            Overflow::ALL[overflow].0,
        )
    })
}

/// A constant is rounded and limited as its documentation says, whatever the node's modes.
fn check_constant(format: Format, value: f64) {
    let exact = BigRational::from_float(value).unwrap() * power_of_two(format.frac.into());
    let saturated = Format {
        overflow: Overflow::Saturate,
        ..format
    };
    let (expected, _) = limited(&rounded(&exact, Rounding::NearestAway), saturated);
    assert_eq!(
        BigInt::from(format.constant(value)),
        expected,
        "{value:e} in {format:?}"
    );
}

#[test]
fn constants_beside_a_tie_and_beyond_53_bits_are_not_rounded_twice() {
    let format = |word| Format::new(word, 0, Rounding::Floor, Overflow::Wrap);
    for value in [
        0.5f64.next_down(),
        0.5,
        1.5f64.next_down(),
        4503599627370497.0,
        4503599627370496.5,
        9007199254740991.0,
        9.3e18,
        f64::MAX,
    ] {
        for word in [1, 8, 53, 63, 64] {
            check_constant(format(word), value);
            check_constant(format(word), -value);
        }
    }
}

proptest! {
    #[test]
    fn constants_are_nearest_with_ties_away_and_saturated(
        format in any_format(),
        value in prop_oneof![any::<f64>().prop_filter("finite", |x| x.is_finite()), -4.0..4.0],
    ) {
        check_constant(format, value);
    }

    #[test]
    fn the_ends_and_the_last_place_are_those_of_the_word(format in any_format()) {
        let end = BigInt::from(1) << (format.word - 1);
        prop_assert_eq!(BigInt::from(format.min_raw()), -end.clone());
        prop_assert_eq!(BigInt::from(format.max_raw()), end - 1);
        prop_assert_eq!(
            BigRational::from_float(format.lsb()).unwrap(),
            power_of_two(-i64::from(format.frac))
        );
    }

    #[test]
    fn the_hash_changes_with_every_part_of_every_format(
        formats in proptest::collection::vec(any_format(), 1..12),
        at in any::<proptest::sample::Index>(),
        other in any_format(),
    ) {
        const NAMES: [&str; 12] = ["a", "b", "c", "d", "e", "f", "g", "h", "i", "j", "k", "l"];
        let row = |(name, format): (&&'static str, &Format)| NodeInfo {
            name,
            unit: "1", meaning: "",
            format: *format,
        };
        let table: Vec<NodeInfo> = NAMES.iter().zip(&formats).map(row).collect();
        let at = at.index(table.len());
        let before = table[at].format;
        let parts = [
            Format { word: other.word, ..before },
            Format { frac: other.frac, ..before },
            Format { rounding: other.rounding, ..before },
            Format { overflow: other.overflow, ..before },
        ];
        for part in parts {
            let mut changed = table.clone();
            changed[at].format = part;
            prop_assert_eq!(table_hash(&changed) == table_hash(&table), part == before);
        }
        let mut renamed = table.clone();
        renamed[at].name = "renamed";
        prop_assert_ne!(table_hash(&renamed), table_hash(&table));
        prop_assert_ne!(table_hash(&table[1..]), table_hash(&table));
    }
}
