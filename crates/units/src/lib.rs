//! Volts, ADC codes, MCU cycles and angles as types that carry their scale.
//!
//! A leaf without `std`: firmware, models and tools share these types, so that a number's unit is
//! known wherever it crosses a border. Inside a formula plain `f64` with a unit suffix is fine.
#![no_std]

/// A point in time or a span, counted in clock cycles of the controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Cycles(pub u64);

impl Cycles {
    /// Seconds at a clock of `frequency_hz`.
    #[must_use]
    pub fn seconds(self, frequency_hz: u64) -> f64 {
        self.0 as f64 / frequency_hz as f64
    }
}

/// An electrical potential against ground, in volts.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Volts(pub f64);

/// A result of the 10-bit converter, 0..=1023.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AdcCode(pub u16);

impl AdcCode {
    /// Number of codes of the 10-bit converter.
    pub const COUNT: u16 = 1024;
    /// The largest code.
    pub const MAX: AdcCode = AdcCode(Self::COUNT - 1);
    /// Code at half the reference, taken as zero by a bipolar chain.
    pub const CENTRE: i16 = 512;

    /// The code as a signed deviation from mid scale, -512..=511.
    #[must_use]
    pub const fn bipolar(self) -> i16 {
        self.0 as i16 - Self::CENTRE
    }

    /// True at either end of the scale: the converter may have clipped.
    #[must_use]
    pub const fn is_clipped(self) -> bool {
        // Byte by byte, which an 8-bit interrupt does without copying the code: the low byte is 0 or
        // 255 and the high byte its last two bits.
        const { assert!(Self::COUNT == 1024, "ten bits") };
        let [low, high] = self.0.to_le_bytes();
        low.wrapping_add(1) <= 1 && high == low & 3
    }
}

/// The bipolar code that an ideal converter without steps would give for `volts`: the value whose
/// quantisation error is centred, because code n covers n..n+1 LSB (data sheet: floor(V*1024/Vref)).
#[must_use]
pub fn ideal_bipolar_code(volts: Volts, reference: Volts) -> f64 {
    volts.0 * f64::from(AdcCode::COUNT) / reference.0 - f64::from(AdcCode::CENTRE) - 0.5
}

/// A plane angle in half turns: 1 is 180 degrees. The unit of angles in firmware and on the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct HalfTurns(pub f64);

impl HalfTurns {
    /// From degrees.
    #[must_use]
    pub const fn from_degrees(degrees: f64) -> Self {
        Self(degrees / 180.0)
    }

    /// From radians.
    #[must_use]
    pub const fn from_radians(radians: f64) -> Self {
        Self(radians / core::f64::consts::PI)
    }

    /// In degrees.
    #[must_use]
    pub const fn degrees(self) -> f64 {
        self.0 * 180.0
    }

    /// In radians.
    #[must_use]
    pub const fn radians(self) -> f64 {
        self.0 * core::f64::consts::PI
    }

    /// The same direction in [-1, 1).
    #[must_use]
    pub fn wrapped(self) -> Self {
        let turns = (self.0 + 1.0) / 2.0;
        let whole = turns as i64 as f64;
        let floor = if turns < whole { whole - 1.0 } else { whole };
        Self((turns - floor) * 2.0 - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_the_direction_and_ends_in_the_half_open_interval() {
        for (from, to) in [
            (1.0, -1.0),
            (-1.0, -1.0),
            (1.5, -0.5),
            (-2.25, -0.25),
            (0.75, 0.75),
        ] {
            assert_eq!(HalfTurns(from).wrapped(), HalfTurns(to), "{from}");
        }
    }

    #[test]
    fn the_ideal_code_lies_half_an_lsb_under_the_middle_of_its_step() {
        let volts = Volts(5.0 / 1024.0 * 700.5);
        assert!((ideal_bipolar_code(volts, Volts(5.0)) - 188.0).abs() < 1e-9);
        assert_eq!(AdcCode(700).bipolar(), 188);
    }
}
