//! The averager and its window against a plain model, for every length and period, also where the
//! main loop comes late.

use cardan_datapath::{Deployed, Silent, Value};
use cardan_firmware::averaging::{Averager, Averages, Decimator, Window};
use cardan_firmware::calibration::{NOMINAL, Settings};
use cardan_firmware::nodes::Average;
use cardan_spec::calibration::{AVERAGING_AT, LEN, OPTIONS_AT, PERIOD_AT, WORDS};
use cardan_spec::timing::{Averaging, WARM_UP_BLOCKS};
use cardan_spec::{MOST_CHANNELS, ThirdTilt};
use cardan_units::AdcCode;
use proptest::prelude::*;

/// What a solution should be: the sums' averages with 15 fractional bits, half rounded up, and whether
/// a code of them is clipped.
type Expected = ([i16; MOST_CHANNELS], bool);

/// Straight from the definition.
fn expected(averaging: Averaging, codes: &[AdcCode]) -> Vec<Expected> {
    let (settled, channels) = (averaging.warm_up_conversions(), averaging.channels());
    let periods = codes[settled..].chunks_exact(averaging.conversions());
    let average = |period: &[AdcCode]| -> Expected {
        let counted = &period[period.len() - channels * averaging.length()..];
        let mean = |channel: usize| {
            if channel >= channels {
                return 0;
            }
            let codes = counted.iter().skip(channel).step_by(channels);
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

/// What the interrupt does.
fn convert(m: &Deployed<Silent>, averager: &mut Averager<Deployed<Silent>>, code: AdcCode) {
    let turn = averager.turn();
    averager.advance(turn);
    averager.add(m, turn, code);
}

fn found(averages: &Averages<Deployed<Silent>>) -> Expected {
    let word = |value: Value<Deployed<Silent>, Average>| value.word().to_bits();
    (averages.values.map(word), averages.clipped)
}

fn any_third_tilt() -> impl Strategy<Value = ThirdTilt> {
    prop::sample::select(&ThirdTilt::ALL)
}

fn every_averaging() -> impl Strategy<Value = Averaging> {
    (4_u8..=12)
        .prop_flat_map(|period| (0..=period, Just(period), any_third_tilt()))
        .prop_map(|(log2, period, third_tilt)| {
            Averaging::new(log2, period)
                .expect("admissible")
                .with(third_tilt)
        })
}

/// Codes of some periods behind the warm-up: mostly inside the scale, now and then at its ends.
fn codes(averaging: Averaging, periods: usize, seed: u32) -> Vec<AdcCode> {
    let mut state = seed | 1;
    let count = averaging.warm_up_conversions() + periods * averaging.conversions();
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
        averaging in every_averaging(), seed: u32, lags in prop::collection::vec(0_usize..80, 1..40),
    ) {
        let codes = codes(averaging, 2, seed);
        let m = Deployed::new(Silent);
        let mut averager = Averager::new(&m, averaging);
        let mut window = Window::new(&m, averaging);
        let mut solved = Vec::new();
        let (settled, per_block) = (averaging.warm_up_conversions(), averaging.block_conversions());
        // Each block is taken a number of conversions after its end; the warm-up's at once.
        let comes = |conversion: usize| {
            let (block, after) = (conversion / per_block, conversion % per_block);
            let lag = if conversion <= settled { 0 } else { lags[block % lags.len()] % per_block };
            after == lag
        };
        for conversion in 0..codes.len() + per_block {
            if comes(conversion)
                && let Some(block) = averager.take(&m)
                && let Some(averages) = window.add(&m, &block)
            {
                prop_assert!(!averages.late);
                solved.push(found(&averages).0);
            }
            let code = codes.get(conversion).copied().unwrap_or(AdcCode(512));
            convert(&m, &mut averager, code);
        }
        let expected = expected(averaging, &codes);
        let averages: Vec<_> = expected.iter().map(|(averages, _)| *averages).collect();
        prop_assert_eq!(solved, averages);
    }

    #[test]
    fn settings_read_back_and_any_change_of_a_byte_makes_them_nominal(
        averaging in every_averaging(), words: [i32; WORDS], third_tilt in any_third_tilt(), at in 0..LEN,
        change in 1_u8..,
    ) {
        let averaging = averaging.with(third_tilt);
        let settings = Settings { words, averaging, third_tilt, uncalibrated: false };
        let mut image = settings.image();
        prop_assert_eq!(Settings::from_image(&image), settings);
        image[at] ^= change;
        let refused = Settings::from_image(&image);
        prop_assert!(refused.uncalibrated);
        prop_assert_eq!((refused.words, refused.averaging), (NOMINAL, Averaging::DEFAULT));
        prop_assert_eq!(refused.third_tilt, ThirdTilt::Absent);
    }
}

#[test]
fn a_block_that_nobody_took_makes_its_solution_late() {
    for third_tilt in ThirdTilt::ALL {
        let averaging = Averaging::new(5, 5).expect("admissible").with(third_tilt);
        let m = Deployed::new(Silent);
        let (mut averager, mut window) = (Averager::new(&m, averaging), Window::new(&m, averaging));
        let mut late = Vec::new();
        for conversion in 1..=(WARM_UP_BLOCKS + 8) * averaging.block_conversions() {
            convert(&m, &mut averager, AdcCode(512));
            let block = conversion / averaging.block_conversions();
            // The main loop sleeps through the end of the second block after the warm-up.
            let is_away = block == WARM_UP_BLOCKS + 2;
            if !is_away && let Some(block) = averager.take(&m) {
                late.extend(window.add(&m, &block).map(|averages| averages.late));
            }
        }
        assert_eq!(late, [true, false, false]);
    }
}

#[test]
fn the_channels_of_a_round_follow_each_other_and_the_last_is_followed_by_the_first() {
    for third_tilt in ThirdTilt::ALL {
        let m = Deployed::new(Silent);
        let mut averager = Averager::new(&m, Averaging::DEFAULT.with(third_tilt));
        for conversion in 0..5 * 64 * third_tilt.channels() {
            let turn = averager.turn();
            assert_eq!(
                usize::from(turn.channel()),
                conversion % third_tilt.channels()
            );
            averager.advance(turn);
        }
    }
}

#[test]
fn options_that_mean_nothing_are_not_settings_even_with_a_good_checksum() {
    let mut image = Settings {
        words: NOMINAL,
        averaging: Averaging::DEFAULT,
        third_tilt: ThirdTilt::Absent,
        uncalibrated: false,
    }
    .image();
    for options in 0..=255 {
        image[OPTIONS_AT] = options;
        let crc = cardan_firmware::frame::crc16(&image[..LEN - 2]);
        image[LEN - 2..].copy_from_slice(&crc.to_le_bytes());
        let settings = Settings::from_image(&image);
        assert_eq!(settings.uncalibrated, options > 2, "{options}");
        if !settings.uncalibrated {
            assert_eq!(settings.third_tilt as u8, options);
            assert_eq!(
                settings.averaging.channels(),
                settings.third_tilt.channels()
            );
        }
    }
}

#[test]
fn lengths_out_of_range_are_not_settings_even_with_a_good_checksum() {
    let averaging = Averaging::DEFAULT;
    let settings = Settings {
        words: NOMINAL,
        averaging,
        third_tilt: ThirdTilt::Absent,
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
