//! Laws and data-sheet figures of the timers.

use proptest::prelude::*;

use super::prescaler::Prescaler;
use super::timer::{ICF, OCFA, OCFB, Register, TOV, Timer};

/// Everything that others can see of a timer.
fn visible(timer: &mut Timer) -> (u8, u8, Option<bool>, Option<bool>, u8) {
    let count = timer.read(Register::CountLow);
    let high = timer.read(Register::CountHigh);
    (count, high, timer.output(0), timer.output(1), timer.flags())
}

/// A timer in mode `wgm` (bits 3:0), clocked by `cs`, with both outputs in mode `com`.
fn timer(number: usize, wgm: u8, cs: u8, com: u8, compare: [u16; 2], capture: u16) -> Timer {
    let mut timer = Timer::new(number);
    let wide = number == 1;
    // ICR1 can be written only in a mode that uses it.
    timer.write(Register::ControlB, 0x18);
    timer.write(Register::CaptureHigh, (capture >> 8) as u8);
    timer.write(Register::CaptureLow, capture as u8);
    timer.write(Register::ControlB, 0);
    for (channel, value) in compare.into_iter().enumerate() {
        timer.write(Register::CompareHigh(channel), (value >> 8) as u8);
        timer.write(Register::CompareLow(channel), value as u8);
    }
    timer.write(Register::ControlA, com << 6 | com << 4 | wgm & 3);
    let high = if wide {
        (wgm & 12) << 1
    } else {
        (wgm & 4) << 1
    };
    timer.write(Register::ControlB, high | cs);
    timer
}

fn any_timer() -> impl Strategy<Value = Timer> {
    // Small compare values turn often; a few are out of reach.
    let value = prop_oneof![0u16..40, 0u16..0x500, Just(0xFF), Just(0xFFFF)];
    (
        0usize..3,
        0u8..16,
        1u8..5,
        0u8..4,
        [value.clone(), value.clone()],
        value,
    )
        .prop_map(|(number, wgm, cs, com, compare, capture)| {
            timer(number, wgm, cs, com, compare, capture)
        })
}

proptest! {
    #[test]
    fn advancing_in_one_jump_equals_advancing_cycle_by_cycle(
        timer in any_timer(), phase in 0u64..2000, cycles in 1u64..20_000,
    ) {
        let mut prescaler = Prescaler::default();
        prescaler.reset(phase, false);
        let (mut jump, mut walk) = (timer.clone(), timer);
        jump.advance(phase + cycles, &prescaler);
        for at in 0..=phase + cycles {
            walk.advance(at, &prescaler);
        }
        prop_assert_eq!(visible(&mut jump), visible(&mut walk));
    }

    #[test]
    fn nothing_that_is_awaited_happens_before_the_next_event(
        timer in any_timer(), mask in 0u8..64, cycles in 1u64..5_000,
    ) {
        let prescaler = Prescaler::default();
        let mut timer = timer;
        timer.write(Register::Mask, mask);
        let pins = |t: &Timer| (t.output(0), t.output(1));
        let plans = |t: &Timer| (t.next_flag(&prescaler), t.next_output(&prescaler));
        let mut last = (timer.requests(), pins(&timer));
        let (mut flag, mut output) = plans(&timer);
        for at in 1..cycles {
            timer.advance(at, &prescaler);
            if timer.requests() != last.0 {
                prop_assert_eq!(flag, Some(at));
            }
            if pins(&timer) != last.1 {
                prop_assert_eq!(output, Some(at));
            }
            if flag == Some(at) {
                // As the program would: the flag is taken.
                timer.clear_flags(0xFF);
            }
            last = (timer.requests(), pins(&timer));
            (flag, output) = plans(&timer);
            prop_assert!([flag, output].into_iter().flatten().all(|next| next > at));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn a_timer_left_alone_for_long_ends_where_small_steps_end(
        timer in any_timer(), cycles in 9_000_000u64..10_000_000,
    ) {
        let prescaler = Prescaler::default();
        let (mut jump, mut walk) = (timer.clone(), timer);
        jump.advance(cycles, &prescaler);
        for at in (0..cycles).step_by(100_003) {
            walk.advance(at, &prescaler);
        }
        walk.advance(cycles, &prescaler);
        prop_assert_eq!(visible(&mut jump), visible(&mut walk));
    }
}

/// Cycles (at clk/1) at which `event` is newly true, within the first `cycles`.
fn times(mut timer: Timer, cycles: u64, mut event: impl FnMut(&mut Timer) -> bool) -> Vec<u64> {
    let prescaler = Prescaler::default();
    (1..=cycles)
        .filter(|&at| {
            timer.advance(at, &prescaler);
            event(&mut timer)
        })
        .collect()
}

/// Cycles at which a flag is set.
fn flag_times(timer: Timer, cycles: u64, flag: u8) -> Vec<u64> {
    times(timer, cycles, |t| {
        let is_set = t.flags() & flag != 0;
        t.clear_flags(flag);
        is_set
    })
}

/// Cycles at which output A changes.
fn edge_times(timer: Timer, cycles: u64) -> Vec<u64> {
    let mut level = timer.output(0);
    times(timer, cycles, |t| {
        let before = std::mem::replace(&mut level, t.output(0));
        before != level
    })
}

#[test]
fn ctc_period_is_ocr_plus_one_and_the_flag_comes_with_the_clear() {
    // Figure 15-9: OCFnA is set on the edge TOP to BOTTOM.
    let ctc = timer(0, 2, 1, 0, [9, 3], 0);
    assert_eq!(flag_times(ctc.clone(), 40, OCFA), [10, 20, 30, 40]);
    assert_eq!(flag_times(ctc.clone(), 40, OCFB), [4, 14, 24, 34]);
    assert_eq!(flag_times(ctc, 40, TOV), []);
}

#[test]
fn ctc_toggles_its_output_on_every_compare_match() {
    // f = clk / (2 N (1 + OCR)), section 15.7.2.
    assert_eq!(
        edge_times(timer(1, 4, 1, 1, [7, 0], 0), 40),
        [8, 16, 24, 32, 40]
    );
}

#[test]
fn ctc_sets_the_overflow_flag_only_at_max() {
    assert_eq!(
        flag_times(timer(0, 2, 1, 0, [255, 0], 0), 600, TOV),
        [256, 512]
    );
}

#[test]
fn fast_pwm_clears_on_match_and_sets_at_bottom() {
    // Section 15.7.3: high for OCR + 1 clocks, TOV at every TOP.
    let pwm = timer(0, 3, 1, 2, [63, 0], 0);
    assert_eq!(edge_times(pwm.clone(), 600), [256, 320, 512, 576]);
    assert_eq!(flag_times(pwm, 600, TOV), [256, 512]);
}

#[test]
fn fast_pwm_at_ocr_equal_top_is_constant_and_at_bottom_a_spike_of_one_clock() {
    assert_eq!(edge_times(timer(0, 3, 1, 2, [255, 0], 0), 2000), [256]);
    assert_eq!(
        edge_times(timer(0, 3, 1, 2, [0, 0], 0), 600),
        [256, 257, 512, 513]
    );
}

#[test]
fn phase_correct_pwm_is_symmetric_with_period_510() {
    // Section 15.7.4: clear up-counting, set down-counting; TOV at BOTTOM.
    let pwm = timer(2, 1, 1, 2, [100, 0], 0);
    assert_eq!(edge_times(pwm.clone(), 1030), [411, 611, 921]);
    assert_eq!(flag_times(pwm, 1600, TOV), [511, 1021, 1531]);
}

#[test]
fn phase_correct_extremes_are_constant() {
    assert_eq!(edge_times(timer(2, 1, 1, 2, [0, 0], 0), 2000), []);
    assert_eq!(edge_times(timer(2, 1, 1, 2, [255, 0], 0), 2000), [256]);
}

#[test]
fn timer1_uses_icr_as_top_and_flags_it() {
    // Modes 14 (fast), 12 (CTC), 8 and 10 (dual slope).
    assert_eq!(
        flag_times(timer(1, 14, 1, 0, [0, 0], 99), 300, ICF),
        [100, 200, 300]
    );
    assert_eq!(
        flag_times(timer(1, 12, 1, 0, [0, 0], 99), 300, ICF),
        [100, 200, 300]
    );
    assert_eq!(
        flag_times(timer(1, 8, 1, 0, [0, 0], 99), 600, ICF),
        [100, 298, 496]
    );
    assert_eq!(
        flag_times(timer(1, 10, 1, 0, [0, 0], 99), 600, TOV),
        [199, 397, 595]
    );
}

#[test]
fn a_write_to_tcnt_blocks_the_next_compare_match_even_while_stopped() {
    let mut blocked = timer(0, 0, 0, 0, [20, 21], 0);
    blocked.write(Register::CountLow, 20);
    blocked.write(Register::ControlB, 1);
    assert_eq!(flag_times(blocked.clone(), 10, OCFA), []);
    assert_eq!(flag_times(blocked, 10, OCFB), [2]);
}

#[test]
fn compare_values_are_buffered_in_pwm_modes_only() {
    let prescaler = Prescaler::default();
    let mut pwm = timer(0, 3, 1, 0, [10, 0], 0);
    pwm.advance(256, &prescaler);
    pwm.write(Register::CompareLow(0), 20);
    assert_eq!(pwm.read(Register::CompareLow(0)), 20);
    pwm.clear_flags(0xFF);
    pwm.advance(256 + 11, &prescaler);
    assert_eq!(pwm.flags() & OCFA, OCFA, "the old value still holds");
    pwm.clear_flags(0xFF);
    pwm.advance(512 + 20, &prescaler);
    assert_eq!(pwm.flags() & OCFA, 0);
    pwm.advance(512 + 21, &prescaler);
    assert_eq!(
        pwm.flags() & OCFA,
        OCFA,
        "the new value holds from BOTTOM on"
    );
}

#[test]
fn force_compare_acts_on_the_pin_without_a_flag_and_not_in_pwm() {
    let mut normal = timer(0, 0, 0, 1, [5, 5], 0);
    normal.write(Register::ControlB, 0x80);
    assert_eq!(
        (normal.output(0), normal.output(1), normal.flags()),
        (Some(true), Some(false), 0)
    );
    let mut pwm = timer(0, 3, 0, 2, [5, 5], 0);
    let before = pwm.output(0);
    pwm.write(Register::ControlB, 0x80);
    assert_eq!(pwm.output(0), before);
}

#[test]
fn reading_a_16_bit_register_goes_through_temp() {
    let mut wide = Timer::new(1);
    wide.write(Register::CountHigh, 0x12);
    wide.write(Register::CountLow, 0x34);
    assert_eq!(
        (
            wide.read(Register::CountLow),
            wide.read(Register::CountHigh)
        ),
        (0x34, 0x12)
    );
    // OCR1x is read directly, without TEMP.
    wide.write(Register::CompareHigh(0), 0xAB);
    wide.write(Register::CompareLow(0), 0xCD);
    wide.write(Register::CountHigh, 0x55);
    assert_eq!(wide.read(Register::CompareHigh(0)), 0xAB);
}

#[test]
fn the_prescaler_runs_on_whether_a_timer_uses_it_or_not() {
    let mut prescaler = Prescaler::default();
    // Enabled at cycle 100: the first tick at /64 comes at 128, not 164.
    assert_eq!(prescaler.cycle_of(6, 100, 1), Some(128));
    assert_eq!(prescaler.ticks(6, 100, 256), 3);
    prescaler.reset(110, false);
    assert_eq!(prescaler.cycle_of(6, 110, 1), Some(174));
    prescaler.reset(200, true);
    assert_eq!(
        (prescaler.cycle_of(0, 200, 1), prescaler.ticks(0, 200, 900)),
        (None, 0)
    );
    prescaler.release(300);
    assert_eq!(prescaler.cycle_of(3, 300, 1), Some(308));
}
