//! What each parameter of sensors and electronics does to the output, against closed forms, and which
//! combinations are refused.

mod common;

use cardan_frontend::{Design, Frontend};
use cardan_scenario::{Experience, Scenario};
use cardan_spec::timing::{ADC_HOLD_CYCLES, CONVERSION_CYCLES, CPU_HZ, STROBE_COUNT, TURN_CYCLES};
use cardan_spec::{Channel, FIELD_FULL_SCALE_UT, TILT_FULL_SCALE_G};
use common::{Script, constant, quiet, voltages};

#[test]
fn parameters_that_cannot_work_together_are_refused_with_their_key() {
    let refused = |change: fn(&mut Scenario)| {
        let mut scenario = quiet();
        change(&mut scenario);
        Frontend::new(&scenario, 1, constant(0.0, 0.0))
            .map(|_| ())
            .expect_err("refused")
            .to_string()
    };
    let message = refused(|s| s.frontend.band_pass_swing_v = 0.5);
    assert!(message.contains("frontend.band_pass_swing_v"), "{message}");
    let message = refused(|s| s.sensors.magnetometer.quality = 1e4);
    assert!(
        message.contains("sensors.magnetometer.quality"),
        "{message}"
    );
    let message = refused(|s| s.sensors.accelerometer.offset_x_mg = 300.0);
    assert!(
        message.contains("sensors.accelerometer") && message.contains("TiltX"),
        "{message}"
    );
    let message = refused(|s| s.sensors.magnetometer.offset_y_ut = -80.0);
    assert!(
        message.contains("sensors.magnetometer") && message.contains("FieldY"),
        "{message}"
    );
    let message = refused(|s| s.frontend.gain_error = 0.3);
    assert!(message.contains("frontend.gain_error"), "{message}");
}

#[test]
fn a_band_pass_too_slow_for_the_multiplexer_is_refused_with_the_largest_quality_that_is_not() {
    let with = |quality: f64, hz: f64| {
        let mut scenario = quiet();
        scenario.frontend.band_pass_quality = quality;
        scenario.frontend.band_pass_hz = hz;
        Design::new(&scenario)
    };
    // By the constant Q/(pi f0) alone, the last strobe 15,750 cycles after select leaves
    // 512 exp(-15750/16e6 pi f0/Q).
    for (quality, hz) in [(3.0, 16e3), (4.0, 16e3), (5.0, 16e3)] {
        let found = with(quality, hz)
            .expect("a working design")
            .tilt
            .residue_lsb;
        let single = 512.0 * f64::exp(-15_750.0 / 16e6 * std::f64::consts::PI * hz / quality);
        println!("{quality}: {found} LSB, last strobe {single}");
        assert!(
            found > 0.9 * single && found < 4.0 * single,
            "{quality}: {found} {single}"
        );
    }
    for quality in [6.5, 8.0, 30.0, 100.0] {
        let message = with(quality, 16e3).expect_err("refused").to_string();
        for part in [
            "frontend.band_pass_quality",
            "frontend.band_pass_hz",
            "LSB",
            "at most 0.1",
        ] {
            assert!(message.contains(part), "{part}: {message}");
        }
        let told = message
            .split("up to ")
            .nth(1)
            .and_then(|rest| rest.split(' ').next());
        let most: f64 = told.and_then(|text| text.parse().ok()).expect("a number");
        assert!(with(most, 16e3).is_ok(), "{most}");
        assert!(with(most + 0.01, 16e3).is_err(), "{most}");
    }
}

/// Steady output of channel x, as a share of full scale, for half of full scale: the mean over the hold
/// instants of a period of the multiplexer, as the design takes it.
fn steady_share(channel: Channel, change: impl Fn(&mut Scenario)) -> f64 {
    let mut scenario = quiet();
    change(&mut scenario);
    let stimulus = Script(move |_| Experience {
        specific_force_g: [0.5 * TILT_FULL_SCALE_G, 0.0, 0.0],
        field_ut: [0.5 * FIELD_FULL_SCALE_UT, 0.0, 0.0],
        temperature_k: scenario.climate.start_k,
    });
    let first = CPU_HZ / 2 + u64::from(STROBE_COUNT) + 1 + ADC_HOLD_CYCLES;
    let holds = (first..first + 2 * TURN_CYCLES).step_by(CONVERSION_CYCLES as usize);
    let times = holds.map(|cycle| (cycle as f64 + 0.5) / CPU_HZ as f64);
    let volts = voltages(&scenario, 1, stimulus, channel, times);
    volts.iter().sum::<f64>() / volts.len() as f64 / 2.5 - 1.0
}

#[test]
fn a_detuned_resonator_loses_what_its_resonance_curve_says() {
    // Sampled at the drive's edges, the part in phase of 1/(1 + 2jQd) counts: 1/(1 + (2Qd)^2), but
    // for the aperture, which samples 0.1 rad later and sees sin(0.1) of the quadrature part.
    let late = 2.0 * std::f64::consts::PI * 16_000.0 * 1e-6;
    for ppm in [-5000.0, -1000.0, 1000.0, 5000.0] {
        let x = 2.0 * 100.0 * ppm * 1e-6;
        let expected = 0.5 * (1.0 - x * f64::tan(late)) / (1.0 + x * x);
        let found = steady_share(Channel::FieldX, |s| {
            s.sensors.magnetometer.detuning_x_ppm = ppm
        });
        // Harmonics of the drive and the finite settling of the aperture are left out above.
        assert!(
            (found / expected - 1.0).abs() < 0.02,
            "{ppm} ppm: {found} {expected}"
        );
    }
}

#[test]
fn a_slow_clock_or_a_hot_beam_detunes_like_a_detuned_resonator() {
    let detuned = steady_share(Channel::FieldX, |s| {
        s.sensors.magnetometer.detuning_x_ppm = 2000.0
    });
    let slow = steady_share(Channel::FieldX, |s| s.clock.error_ppm = -2000.0);
    let hot = steady_share(Channel::FieldX, |s| {
        s.sensors.magnetometer.detuning_drift_ppm_per_k = 40.0;
        s.climate.start_k = 293.15 + 50.0;
    });
    assert!((hot - detuned).abs() < 1e-9, "{hot} {detuned}");
    // The clock moves the carrier against the band-pass as well: 2 Q 0.002 = 0.016 of its phase.
    assert!(
        (slow - detuned).abs() < 0.01 && (slow - 0.5).abs() > 0.01,
        "{slow} {detuned}"
    );
}

#[test]
fn a_resonator_follows_the_temperature_during_the_run() {
    let mut scenario = quiet();
    scenario.sensors.magnetometer.detuning_drift_ppm_per_k = 40.0;
    let heating = Script(|t: f64| Experience {
        field_ut: [0.5 * FIELD_FULL_SCALE_UT, 0.0, 0.0],
        temperature_k: 293.15 + 50.0 * (t / 0.5).min(1.0),
        ..Experience::default()
    });
    let end = voltages(&scenario, 1, heating, Channel::FieldX, std::iter::once(0.8))[0] / 2.5 - 1.0;
    let hot = steady_share(Channel::FieldX, |s| {
        s.sensors.magnetometer.detuning_x_ppm = 2000.0
    });
    assert!((end - hot).abs() < 1e-4, "{end} {hot}");
}

#[test]
fn feed_through_in_quadrature_shows_only_through_the_aperture() {
    let change = |s: &mut Scenario| s.sensors.magnetometer.feedthrough_ut = 30.0;
    let without = steady_share(Channel::FieldX, |_| ());
    let with = steady_share(Channel::FieldX, change);
    // Harmonic k of the square, 1/k, through the band-pass 1/(1 + jx) with x = Q (k - 1/k), at the
    // aperture's end less the capacitor's lag of 0.1 us; the signal itself is sampled off its peak by the same angle.
    let late = 2.0 * std::f64::consts::PI * 16_000.0 * 0.9e-6;
    let harmonic = |k: f64| {
        let x = 4.0 * (k - 1.0 / k);
        ((k * late).sin() - x * (k * late).cos()) / (1.0 + x * x) / k
    };
    let sum: f64 = (0..50).map(|i| harmonic(f64::from(2 * i + 1))).sum();
    let expected = 0.5 * sum / late.cos();
    assert!(
        ((with - without).abs() / expected - 1.0).abs() < 0.15,
        "{with} {without} {expected}"
    );
}

#[test]
fn injected_charge_cancels_between_the_capacitors_and_its_mismatch_is_an_offset() {
    let both = steady_share(Channel::TiltX, |s| {
        s.frontend.injection_plus_pc = 2.0;
        s.frontend.injection_minus_pc = 2.0;
    });
    assert!((both - 0.5).abs() < 1e-4, "{both}");
    let one = steady_share(Channel::TiltX, |s| s.frontend.injection_plus_pc = 2.0);
    // 2 pC on 100 pF are 20 mV on H+, 10 mV of the difference, 20 mV at the output, except during
    // the apertures, four of 1 us in 2 ms.
    let expected = 0.02 / 2.5 * (1.0 - 4.0 / 2000.0);
    assert!((one - 0.5 - expected).abs() < 5e-5, "{one}");
}

#[test]
fn the_gain_makes_up_for_the_droop_of_a_leaking_capacitor() {
    // 1 Gohm and 100 pF: 0.1 s. Of 2 ms a value is held for 62.5 us three times, then for the rest:
    // the mean droop is the mean age over 0.1 s.
    let gain = |leak_ohm| {
        let mut scenario = quiet();
        scenario.frontend.leak_ohm = leak_ohm;
        Design::new(&scenario)
            .expect("a working design")
            .tilt
            .band_pass_gain
    };
    let loss = gain(1e9) / gain(1e15) - 1.0;
    let (short, rest) = (62.5e-6_f64, 2e-3 - 3.0 * 62.5e-6);
    let age_s = (3.0 * short * short + rest * rest) / 2.0 / 2e-3;
    assert!((loss / (age_s / 0.1) - 1.0).abs() < 0.01, "{loss}");
    let share = steady_share(Channel::TiltX, |s| s.frontend.leak_ohm = 1e9);
    assert!((share - 0.5).abs() < 1e-9, "{share}");
}
