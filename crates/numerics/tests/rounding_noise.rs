//! Variance and mean of what rounding adds are those of all cases, counted over exact rationals.

#[allow(dead_code, reason = "each test uses its part of the oracle")]
#[path = "../../datapath/tests/rationals/mod.rs"]
mod rationals;

use cardan_datapath::{Format, Overflow, Rounding};
use cardan_numerics::tape::rounding_noise;
use num_rational::BigRational;
use num_traits::ToPrimitive;

use rationals::{power_of_two, real, rounded};

/// Every pattern of `dropped` bits behind some whole places, with either sign.
fn errors(mode: Rounding, dropped: u32) -> Vec<f64> {
    let whole = 4_i64 << dropped;
    let error = |raw: i64| {
        let exact = real(raw, dropped);
        let kept = BigRational::from_integer(rounded(&exact, mode));
        (kept - exact).to_f64().expect("is finite")
    };
    (-whole..whole).map(error).collect()
}

#[test]
fn variance_and_mean_are_those_of_all_patterns_of_the_bits_that_are_dropped() {
    for (mode, name) in Rounding::ALL {
        for dropped in 0..=9 {
            let errors = errors(mode, dropped);
            let count = errors.len() as f64;
            let mean = errors.iter().sum::<f64>() / count;
            let variance = errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / count;
            for frac in [0, 12] {
                let format = Format::new(16, frac, mode, Overflow::Saturate);
                let lsb = power_of_two(-i64::from(frac)).to_f64().expect("is finite");
                let (found, bias) = rounding_noise(format, dropped.into());
                let what = format!("{name}, {dropped} bits: {found} {bias}");
                assert!((bias / lsb - mean).abs() < 1e-12, "{what}: mean {mean}");
                assert!(
                    (found / (lsb * lsb) - variance).abs() < 1e-12,
                    "{what}: variance {variance}"
                );
            }
        }
    }
}

#[test]
fn what_ends_before_the_word_loses_nothing_and_an_endless_result_what_a_uniform_error_has() {
    for (mode, name) in Rounding::ALL {
        let format = Format::new(16, 3, mode, Overflow::Wrap);
        for dropped in [i64::MIN, -1, 0] {
            assert_eq!(rounding_noise(format, dropped), (0.0, 0.0), "{name}");
        }
        let (variance, mean) = rounding_noise(format, 64);
        assert_eq!(rounding_noise(format, i64::MAX), (variance, mean), "{name}");
        let rms = (variance + mean * mean).sqrt() * 8.0;
        let nearest = matches!(
            mode,
            Rounding::NearestUp | Rounding::NearestAway | Rounding::NearestEven
        );
        let expected = if nearest { 1.0 / 12.0 } else { 1.0 / 3.0 };
        assert!((rms * rms - expected).abs() < 1e-12, "{name}: {rms}");
    }
}
