//! Parameters of sensors, front end, converter and controller: `sensors.*`, `frontend`, `adc`, `controller`.
//!
//! Sources in brackets are those of docs/sensors.md (sections 1 to 3 and 6). The structures
//! are plain data; what they mean as physics stands in the `sensors` and `frontend` crates.

use cardan_spec::timing::Averaging;

use crate::parameter::Origin::{Assumed, Published, Setting};
use crate::parameter::parameters;

parameters! {
    /// Convective accelerometer: two of them, along body x and y, and a third along z where it is
    /// fitted (`sensors.third_tilt`).
    pub struct Accelerometer at "sensors.accelerometer" {
        /// Convection of the gas in the cavity, first-order lag.
        convection_bandwidth_hz = 100.0, "Hz", 1.0 => 1e4,
            Published("[LEM]: over 100 Hz with a small cavity");
        /// Heat capacity of the detector bridges, first-order lag.
        detector_bandwidth_hz = 50.0, "Hz", 1.0 => 1e4, Published("[LEM]");
        /// Bridge signal per g at full bias, before chopping.
        sensitivity_mv_per_g = 0.3, "mV/g", 1e-6 => 1e3,
            Assumed("0.2 K/g, poly TCR 9e-4/K, 3.3 V bridge with two active arms");
        /// Relative deviation of this unit's sensitivity from design, body x.
        sensitivity_error_x = 0.0, "1", -0.5 => 0.5, Assumed("a unit as designed");
        /// Relative deviation of this unit's sensitivity from design, body y.
        sensitivity_error_y = 0.0, "1", -0.5 => 0.5, Assumed("a unit as designed");
        /// Relative deviation of this unit's sensitivity from design, body z where fitted.
        sensitivity_error_z = 0.0, "1", -0.5 => 0.5, Assumed("a unit as designed");
        /// Cubic term: the signal is a + cubic a^3.
        cubic_per_g2 = 0.0, "1/g^2", -0.2 => 0.2,
            Assumed("linear; [MIL] gives under 0.5 % over +-90 degrees of tilt, i.e. up to 0.005");
        /// Zero-g offset of body x.
        offset_x_mg = 0.0, "mg", -500.0 => 500.0,
            Assumed("trimmed; [MXC25] gives under 50 mg before trimming");
        /// Zero-g offset of body y.
        offset_y_mg = 0.0, "mg", -500.0 => 500.0,
            Assumed("trimmed; [MXC25] gives under 50 mg before trimming");
        /// Zero-g offset of body z where fitted.
        offset_z_mg = 0.0, "mg", -500.0 => 500.0,
            Assumed("trimmed; [MXC25] gives under 50 mg before trimming");
        /// Offset drift with ambient temperature, away from 293.15 K.
        offset_drift_mg_per_k = 1.5, "mg/K", -20.0 => 20.0,
            Assumed("1 to 2 mg/K, sign differs from part to part; no effect at 293.15 K");
        /// Sensitivity goes with (293.15 K / T) to this power.
        temperature_exponent = 2.0, "1", 0.0 => 4.0, Assumed("gas properties, 1 to 3");
        /// Heater power over its design value; sensitivity is proportional to it.
        heater_power = 1.0, "1", 0.01 => 3.0, Published("[MIL]: sensitivity nearly linear in power");
        /// Sensitivity to each of the two other body axes over that of its own.
        cross_axis = 0.0, "1", -0.3 => 0.3, Assumed("corrected by calibration; 2 % is typical");
        /// White noise of the sensor itself, one-sided density, before its lags.
        noise_mg_per_rthz = 0.2, "mg/rtHz", 0.0 => 100.0,
            Assumed("the part of [MXD]; the published 1.7 degrees at system level need 4.9, see scenario 'published'");
        /// Corner under which the sensor's 1/f noise exceeds its white noise.
        flicker_corner_hz = 1.0, "Hz", 0.0 => 1e3, Assumed("not published");
        /// Resistance of the bridge, whose thermal noise adds to the amplifier's.
        bridge_ohm = 10_000.0, "ohm", 1.0 => 1e7, Assumed("polysilicon bridge");
    }
}

parameters! {
    /// U-shaped Lorentz cantilever with piezoresistive gauges: two, along body x and y.
    pub struct Magnetometer at "sensors.magnetometer" {
        /// Mechanical resonance by design; the controller's carrier has the same frequency.
        resonance_hz = 16_000.0, "Hz", 100.0 => 1e6, Published("[S1]");
        /// Relative deviation of the resonance of body x's cantilever from design.
        detuning_x_ppm = 0.0, "ppm", -1e5 => 1e5, Assumed("trimmed to the carrier");
        /// Relative deviation of the resonance of body y's cantilever from design.
        detuning_y_ppm = 0.0, "ppm", -1e5 => 1e5, Assumed("trimmed to the carrier");
        /// Drift of the resonance with temperature, away from 293.15 K.
        detuning_drift_ppm_per_k = -30.0, "ppm/K", -1e3 => 1e3,
            Assumed("stiffness of the beam; no effect at 293.15 K");
        /// Quality factor in air.
        quality = 100.0, "1", 0.6 => 1e5,
            Assumed("[ISVLSI]: 10 ms response bounds it to 503; 101 if that is five time constants");
        /// Gauge bridge amplitude per field, driven at resonance by a sine of the drive's amplitude.
        sensitivity_uv_per_ut = 0.145, "uV/uT", 1e-9 => 1e3,
            Assumed("first principles: 10 mA, 500 um crossbar, gauge factor 20");
        /// Relative deviation of this unit's sensitivity from design, body x.
        sensitivity_error_x = 0.0, "1", -0.5 => 0.5, Assumed("a unit as designed");
        /// Relative deviation of this unit's sensitivity from design, body y.
        sensitivity_error_y = 0.0, "1", -0.5 => 0.5, Assumed("a unit as designed");
        /// Constant field of magnetised parts, body x.
        offset_x_ut = 0.0, "uT", -100.0 => 100.0, Assumed("nulled by calibration");
        /// Constant field of magnetised parts, body y.
        offset_y_ut = 0.0, "uT", -100.0 => 100.0, Assumed("nulled by calibration");
        /// Drive current that couples straight into the gauge bridge, as the field whose signal at
        /// resonance has the same amplitude; it is in quadrature to that signal.
        feedthrough_ut = 0.0, "uT", -1e3 => 1e3,
            Assumed("nulled on chip; 10 to 100 uT before nulling");
        /// Sensitivity to each of the two other body axes over that of its own.
        cross_axis = 0.0, "1", -0.3 => 0.3, Assumed("corrected by calibration; 1 to 3 % is typical");
        /// Angle between the two sensing axes less 90 degrees.
        non_orthogonality_deg = 0.0, "deg", -10.0 => 10.0,
            Assumed("corrected by calibration; +-1 degree is typical");
        /// Brownian force on the beam, one-sided density as field.
        thermomechanical_nt_per_rthz = 15.0, "nT/rtHz", 0.0 => 1e5, Assumed("first principles");
        /// Resistance of the gauge bridge, whose thermal noise adds to the amplifier's.
        bridge_ohm = 5_000.0, "ohm", 1.0 => 1e7, Assumed("two gauges of 5 kohm and two references");
    }
}

parameters! {
    /// Amplifier, filters and track-and-hold of every channel.
    pub struct Frontend at "frontend" {
        /// Voltage gain of the first amplifier.
        lna_gain = 100.0, "1", 1.0 => 1e5, Assumed("not published");
        /// White noise of the first amplifier, one-sided density at its input.
        lna_noise_nv_per_rthz = 8.0, "nV/rtHz", 0.0 => 1e6, Assumed("not published");
        /// Corner of the first amplifier's 1/f noise.
        lna_flicker_corner_hz = 2_000.0, "Hz", 0.0 => 1e5, Assumed("1 to 5 kHz in CMOS");
        /// Largest swing of the first amplifier's output to either side.
        lna_swing_v = 2.0, "V", 1e-3 => 100.0, Assumed("5 V supply");
        /// Centre of the band-pass.
        band_pass_hz = 16_000.0, "Hz", 100.0 => 1e6, Assumed("the carrier");
        /// Quality factor of the band-pass, which both tilt channels use in turns: one that keeps over
        /// 0.1 LSB of the other channel in an average is refused.
        band_pass_quality = 4.0, "1", 0.3 => 100.0, Assumed("3 to 5");
        /// Largest amplitude of the band-pass's output.
        band_pass_swing_v = 2.0, "V", 1e-3 => 100.0, Assumed("5 V supply");
        /// Time for which an edge closes its switch, a whole number: the monostable's pulse.
        aperture_cycles = 16.0, "cycles", 1.0 => 1e5, Assumed("1 us, ten time constants");
        /// Resistance of a closed switch.
        switch_ohm = 1_000.0, "ohm", 1.0 => 1e6, Assumed("analog switch");
        /// Hold capacitor.
        hold_pf = 100.0, "pF", 0.1 => 1e6, Assumed("analog switch");
        /// Leakage resistance of a hold capacitor to mid supply (droop).
        leak_ohm = 1e12, "ohm", 1e5 => 1e18, Assumed("CMOS input");
        /// Charge that opening the H+ switch pushes onto its capacitor.
        injection_plus_pc = 0.0, "pC", -100.0 => 100.0, Assumed("compensated");
        /// Charge that opening the H- switch pushes onto its capacitor.
        injection_minus_pc = 0.0, "pC", -100.0 => 100.0, Assumed("compensated");
        /// Corner of the tilt channels' low-pass, second-order Butterworth. That of the
        /// magnetometers follows from equal group delay of all channels.
        tilt_low_pass_hz = 50.0, "Hz", 1.0 => 5e3, Assumed("30 ms response of [ISVLSI]");
        /// Gain of the differential amplifier before the converter.
        output_gain = 2.0, "1", 0.01 => 100.0,
            Assumed("leaves the filters a factor of headroom over the rails of the output");
        /// Offset of the differential amplifier at its output.
        output_offset_mv = 0.0, "mV", -1e3 => 1e3, Assumed("trimmed");
        /// Relative error of the gain of the whole chain, all channels.
        gain_error = 0.0, "1", -0.5 => 0.5, Assumed("a unit as designed");
    }
}

parameters! {
    /// The controller's oscillator.
    pub struct Clock at "clock" {
        /// Relative deviation of its frequency from 16 MHz. The carrier moves against the
        /// resonances; the motion is timed by this clock, so that it does not shift against truth.
        error_ppm = 0.0, "ppm", -2e4 => 2e4, Assumed("a quartz, within 50 ppm");
    }
}

parameters! {
    /// What the controller does with the conversions, as its EEPROM says.
    pub struct Controller at "controller" {
        /// Conversions of each channel that are averaged, a power of two and not more than the
        /// period: the last of it.
        averaging = 16.0, "conversions", 1.0 => 4096.0, Setting;
        /// Conversions of each channel from one solution to the next, a power of two; 16 take 8 ms.
        period = 16.0, "conversions", 16.0 => 4096.0, Setting;
    }
}

impl Controller {
    /// The device's setting; the default where the values are not admissible.
    #[must_use]
    pub fn averaging(&self) -> Averaging {
        let log2 = |value: f64| (value as u32).checked_ilog2().unwrap_or(0) as u8;
        Averaging::new(log2(self.averaging), log2(self.period)).unwrap_or(Averaging::DEFAULT)
    }
}

parameters! {
    /// Errors of the converter between pin voltage and code, in steps of the 10-bit converter.
    pub struct Adc at "adc" {
        /// Resistance between a channel's output amplifier and the converter's sampling capacitor:
        /// driver and multiplexer.
        source_ohm = 11_000.0, "ohm", 0.0 => 1e7,
            Assumed("1 kohm driver, 10 kohm multiplexer; [AIN]: 1 to 100 kohm in series");
        /// The sampling capacitor, which the multiplexer takes from channel to channel.
        sample_pf = 14.0, "pF", 0.0 => 1e4, Published("[AIN], AVR family");
        /// White noise of a conversion, rms.
        noise_lsb = 0.5, "LSB", 0.0 => 100.0, Assumed("from 2 LSB absolute accuracy");
        /// Offset error.
        offset_lsb = 0.0, "LSB", -50.0 => 50.0, Assumed("calibrated; 2 LSB in [AVRT]");
        /// Gain error at full scale.
        gain_lsb = 0.0, "LSB", -50.0 => 50.0, Assumed("calibrated; 2 LSB in [AVRT]");
        /// Integral nonlinearity: the peak of a bow between the ends of the scale.
        inl_lsb = 0.0, "LSB", -8.0 => 8.0, Assumed("none; 0.5 LSB in [AVRT]");
        /// Differential nonlinearity: every step's position is moved by up to half of this,
        /// uniformly, by the seed.
        dnl_lsb = 0.0, "LSB", 0.0 => 1.0, Assumed("none; 0.25 LSB in [AVRT]");
    }
}
