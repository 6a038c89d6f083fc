//! The averager and its window against a plain model, for every length and period, also where the
//! main loop comes late.

use cardan_datapath::{Deployed, Silent, Value};
use cardan_firmware::averaging::{Averager, Averages, Decimator, Window};
use cardan_firmware::calibration::{NOMINAL, Settings};
use cardan_firmware::nodes::Average;
use cardan_spec::CHANNELS;
use cardan_spec::calibration::{AVERAGING_AT, LEN, PERIOD_AT};
use cardan_spec::timing::{Averaging, BLOCK_CONVERSIONS, WARM_UP_BLOCKS};
use cardan_units::AdcCode;
use proptest::prelude::*;

/// What a solution should be: the sums' averages with 15 fractional bits, half rounded up, and whether
/// a code of them is clipped.
type Expected = ([i16; CHANNELS], bool);

/// Straight from the definition.
fn expected(averaging: Averaging, codes: &[AdcCode]) -> Vec<Expected> {
    let settled = WARM_UP_BLOCKS * BLOCK_CONVERSIONS;
    let periods = codes[settled..].chunks_exact(averaging.conversions());
    let average = |period: &[AdcCode]| -> Expected {
        let counted = &period[period.len() - CHANNELS * averaging.length()..];
        let mean = |channel: usize| {
            let codes = counted.iter().skip(channel).step_by(CHANNELS);
            let sum: i64 = codes.map(|code| i64::from(code.0) - 512).sum();
            // sum / length / 512 in units of 2^-15.
            let (numerator, denominator) = (sum * 64, averaging.length() as i64);
            (2 * numerator + denominator).div_euclid(2 * denominator) as i16
        };
        let clipped = counted.iter().any(|code| code.0 == 0 || code.0 == 1023);
        (std::array::from_fn(mean), clipped)
    };
    periods.map(average).collect()
}

fn found(averages: &Averages<Deployed<Silent>>) -> Expected {
    let word = |value: Value<Deployed<Silent>, Average>| value.word().to_bits();
    (averages.values.map(word), averages.clipped)
}

fn every_averaging() -> impl Strategy<Value = Averaging> {
    (4_u8..=12)
        .prop_flat_map(|period| (0..=period, Just(period)))
        .prop_map(|(log2, period)| Averaging::new(log2, period).expect("admissible"))
}

/// Codes of some periods behind the warm-up: mostly inside the scale, now and then at its ends.
fn codes(averaging: Averaging, periods: usize, seed: u32) -> Vec<AdcCode> {
    let mut state = seed | 1;
    let count = WARM_UP_BLOCKS * BLOCK_CONVERSIONS + periods * averaging.conversions();
    let mut next = |_| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        let code = (state >> 8) as u16 % 1024;
        let is_rare = state.is_multiple_of(997);
        AdcCode(if is_rare { code } else { code.clamp(1, 1022) })
    };
    (0..count).map(&mut next).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn every_length_and_period_gives_the_averages_of_its_definition(
        averaging in every_averaging(), seed: u32,
    ) {
        let codes = codes(averaging, 2, seed);
        let m = Deployed::new(Silent);
        let mut decimator = Decimator::new(&m, averaging);
        let mut solved = Vec::new();
        for code in &codes {
            if let Some(averages) = decimator.push(&m, *code) {
                prop_assert!(!averages.late);
                solved.push(found(&averages));
            }
        }
        prop_assert_eq!(solved, expected(averaging, &codes));
    }

    /// The main loop may come for a block at any time before the next but one begins.
    #[test]
    fn a_main_loop_that_comes_within_a_block_gets_the_same_averages(
        averaging in every_averaging(), seed: u32, lags in prop::collection::vec(0_usize..64, 1..40),
    ) {
        let codes = codes(averaging, 2, seed);
        let m = Deployed::new(Silent);
        let mut averager = Averager::new(&m, averaging);
        let mut window = Window::new(&m, averaging);
        let mut solved = Vec::new();
        let settled = WARM_UP_BLOCKS * BLOCK_CONVERSIONS;
        // Each block is taken a number of conversions after its end; the warm-up's at once.
        let comes = |conversion: usize| {
            let (block, after) = (conversion / 64, conversion % 64);
            let lag = if conversion <= settled { 0 } else { lags[block % lags.len()] };
            after == lag
        };
        for conversion in 0..codes.len() + 64 {
            if comes(conversion)
                && let Some(block) = averager.take(&m)
                && let Some(averages) = window.add(&m, &block)
            {
                prop_assert!(!averages.late);
                solved.push(found(&averages).0);
            }
            let code = codes.get(conversion).copied().unwrap_or(AdcCode(512));
            averager.add(&m, averager.turn(), code);
        }
        let expected = expected(averaging, &codes);
        let averages: Vec<_> = expected.iter().map(|(averages, _)| *averages).collect();
        prop_assert_eq!(solved, averages);
    }

    #[test]
    fn settings_read_back_and_any_change_of_a_byte_makes_them_nominal(
        averaging in every_averaging(), words: [i32; 15], third_tilt: bool, at in 0..LEN, change in 1_u8..,
    ) {
        let settings = Settings { words, averaging, third_tilt, uncalibrated: false };
        let mut image = settings.image();
        prop_assert_eq!(Settings::from_image(&image), settings);
        image[at] ^= change;
        let refused = Settings::from_image(&image);
        prop_assert!(refused.uncalibrated);
        prop_assert_eq!((refused.words, refused.averaging), (NOMINAL, Averaging::DEFAULT));
        prop_assert!(!refused.third_tilt);
    }
}

#[test]
fn a_block_that_nobody_took_makes_its_solution_late() {
    let averaging = Averaging::new(5, 5).expect("admissible");
    let m = Deployed::new(Silent);
    let (mut averager, mut window) = (Averager::new(&m, averaging), Window::new(&m, averaging));
    let mut late = Vec::new();
    for conversion in 1..=(WARM_UP_BLOCKS + 8) * BLOCK_CONVERSIONS {
        averager.add(&m, averager.turn(), AdcCode(512));
        let block = conversion / BLOCK_CONVERSIONS;
        // The main loop sleeps through the end of the second block after the warm-up.
        let is_away = block == WARM_UP_BLOCKS + 2;
        if !is_away && let Some(block) = averager.take(&m) {
            late.extend(window.add(&m, &block).map(|averages| averages.late));
        }
    }
    assert_eq!(late, [true, false, false]);
}

#[test]
fn lengths_out_of_range_are_not_settings_even_with_a_good_checksum() {
    let averaging = Averaging::DEFAULT;
    let settings = Settings {
        words: NOMINAL,
        averaging,
        third_tilt: false,
        uncalibrated: false,
    };
    for (log2, period_log2) in [(5, 4), (0, 3), (13, 13), (4, 13), (255, 4)] {
        let mut image = settings.image();
        image[AVERAGING_AT] = log2;
        image[PERIOD_AT] = period_log2;
        let crc = cardan_firmware::frame::crc16(&image[..LEN - 2]);
        image[LEN - 2..].copy_from_slice(&crc.to_le_bytes());
        assert!(
            Settings::from_image(&image).uncalibrated,
            "{log2} of {period_log2}"
        );
    }
}
