//! Clock, carrier, conversion and serial rates of the reference board, and its pin map.

/// CPU clock in hertz: the fastest the part allows at 5 V, and 1000 cycles per carrier period.
pub const CPU_HZ: u64 = 16_000_000;

/// Half a carrier period in CPU cycles: Timer1 in CTC mode counts 0..=499 and each output toggles
/// once per count. 16 kHz is the mechanical resonance of the magnetometer (sensors reference, 2).
pub const HALF_CARRIER_CYCLES: u64 = 500;

/// The carrier in hertz.
pub const CARRIER_HZ: u64 = CPU_HZ / (2 * HALF_CARRIER_CYCLES);

/// Timer1 count at which OC1A (the carrier) toggles.
pub const CARRIER_COUNT: u16 = 499;

/// Timer1 count at which OC1B (the strobe) toggles: a quarter period after the carrier, where the
/// band-passed tilt signal peaks. The same match triggers the converter.
pub const STROBE_COUNT: u16 = 249;

/// CPU cycles between conversions. A conversion takes 13.5 ADC clocks (1728 cycles at 125 kHz) and
/// 3 cycles of synchronisation, so the next compare match it can follow is four half periods on.
pub const CONVERSION_CYCLES: u64 = 4 * HALF_CARRIER_CYCLES;

/// ADC prescaler: 16 MHz / 128 = 125 kHz, inside the 50..200 kHz of full resolution.
pub const ADC_PRESCALER: u64 = 128;

/// CPU cycles from the trigger (the compare match) to the ADC's own sample-and-hold: 3 cycles of
/// synchronisation and 2 ADC clocks (data sheet, ADC timing, auto-triggered conversion).
pub const ADC_HOLD_CYCLES: u64 = 3 + 2 * ADC_PRESCALER;

/// log2 of the number of conversions averaged per channel.
pub const AVERAGING_LOG2: u32 = 4;

/// Conversions averaged per channel: 16 give 125 solutions per second, each 8 ms long.
pub const AVERAGING: usize = 1 << AVERAGING_LOG2;

/// Conversions per solution; the channels are interleaved, one conversion each in turn.
pub const CONVERSIONS_PER_SOLUTION: usize = AVERAGING * super::CHANNELS;

/// CPU cycles per solution.
pub const SOLUTION_CYCLES: u64 = CONVERSIONS_PER_SOLUTION as u64 * CONVERSION_CYCLES;

/// Solutions' worth of conversions ignored after reset (neither summed nor published), while the
/// analog filters settle: 12 of 8 ms are more than ten time constants of the slowest (31 Hz)
/// low-pass.
pub const WARM_UP_SOLUTIONS: usize = 12;

/// UBRR0 with U2X0 set: 16 MHz / (8 * 17) = 117,647 baud, 2.1 % above 115,200.
pub const UBRR: u16 = 16;

/// CPU cycles per byte on the wire: start, eight data and one stop bit.
pub const BYTE_CYCLES: u64 = 10 * 8 * (UBRR as u64 + 1);

/// Pins of the reference board, named as in the data sheet.
pub mod pins {
    /// Carrier: bias of the tilt bridges, drive of the magnetometers, and by the quarter-period
    /// lag of a resonator the strobe of the magnetometers' track-and-hold pairs. OC1A.
    pub const CARRIER: &str = "PB1";
    /// Strobe of the tilt channels' track-and-hold pairs: the falling edge samples the positive
    /// half-cycle, the rising edge the negative. OC1B.
    pub const STROBE: &str = "PB2";
    /// High while a solution is computed; an oscilloscope, or a bench, sees load and deadlines.
    pub const SOLVING: &str = "PB5";
}
