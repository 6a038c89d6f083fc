//! Clock, carrier, conversion and serial rates of the reference board, and its pin map.

use crate::ThirdTilt;

/// CPU clock in hertz: the fastest the part allows at 5 V, and 1000 cycles per carrier period.
pub const CPU_HZ: u64 = 16_000_000;

/// Half a carrier period in CPU cycles: Timer1 in CTC mode counts 0..=499 and each output toggles
/// once per count. 16 kHz is the mechanical resonance of the magnetometer (docs/sensors.md, 2).
pub const HALF_CARRIER_CYCLES: u64 = 500;

/// The carrier in hertz.
pub const CARRIER_HZ: u64 = CPU_HZ / (2 * HALF_CARRIER_CYCLES);

/// Timer1 count at which OC1A (the carrier) toggles.
pub const CARRIER_COUNT: u16 = 499;

/// Timer1 count at which OC1B (the strobe) toggles: a quarter period after the carrier, where the
/// band-passed tilt signal peaks. The same match triggers the converter.
pub const STROBE_COUNT: u16 = 249;

/// A turn of the tilt multiplexer in CPU cycles, for which one channel has the band-pass. Every turn
/// begins at the same phase of the carrier, so it is a multiple of its 1000 cycles, and Timer2 counts
/// 125 of 128 cycles in it: 16,000 is the least multiple of both. Its band-pass forgets the neighbour
/// with a constant of Q/(pi f0), 1,273 cycles: 12 of them before the last strobe; half a turn would
/// leave an LSB.
pub const TURN_CYCLES: u64 = (SELECT_COUNT as u64 + 1) * TURN_PRESCALER;

/// Prescaler of Timer2.
pub const TURN_PRESCALER: u64 = 128;

/// Timer2 count at which OC2A (the multiplexer's select) toggles and the timer starts over.
pub const SELECT_COUNT: u8 = 124;

/// Timer2 count at which OC2B (settled) toggles: 12,032 cycles after select, with room for four
/// strobes of either sense before the turn ends. A strobe is 218 cycles away from either end of that
/// window, or more, if select toggles with the carrier.
pub const SETTLED_COUNT: u8 = 93;

/// CPU cycles from a turn's start to its first strobes.
pub const SETTLING_CYCLES: u64 = (SETTLED_COUNT as u64 + 1) * TURN_PRESCALER;

/// Most CPU cycles by which select may follow an edge of the carrier, always the same number: both
/// timers are started one after the other. Under the 218 cycles to the next strobe.
pub const MOST_TURN_LAG_CYCLES: u64 = 32;

/// Most CPU cycles from the end of a solution (its pin falls) to the first byte on the serial line: what
/// encoding a frame takes, and the interrupts that come in between (2,400 measured).
pub const MOST_SEND_LAG_CYCLES: u64 = 4000;

/// CPU cycles between conversions. A conversion takes 13.5 ADC clocks (1728 cycles at 125 kHz) and
/// 3 cycles of synchronisation, so the next compare match it can follow is four half periods on.
pub const CONVERSION_CYCLES: u64 = 4 * HALF_CARRIER_CYCLES;

/// ADC prescaler: 16 MHz / 128 = 125 kHz, inside the 50..200 kHz of full resolution.
pub const ADC_PRESCALER: u64 = 128;

/// CPU cycles from the trigger (the compare match) to the ADC's own sample-and-hold: 3 cycles of
/// synchronisation and 2 ADC clocks (data sheet, ADC timing, auto-triggered conversion).
pub const ADC_HOLD_CYCLES: u64 = 3 + 2 * ADC_PRESCALER;

/// CPU cycles from the trigger to the result and its interrupt: 3 of synchronisation and 13.5 ADC
/// clocks (data sheet, ADC timing, auto-triggered conversion).
pub const ADC_RESULT_CYCLES: u64 = 3 + 27 * ADC_PRESCALER / 2;

/// What the sample interrupt may wait before it must re-arm the trigger for the next compare match.
pub const MOST_INTERRUPT_LATENCY_CYCLES: u64 = CONVERSION_CYCLES - ADC_RESULT_CYCLES;

/// Rounds (one conversion of each channel) of a block. The sample interrupt sums blocks, the main loop
/// adds blocks to averages of any length.
pub const BLOCK_ROUNDS: usize = 16;

/// Conversions of a block of four channels; they are interleaved, one conversion each in turn.
pub const BLOCK_CONVERSIONS: usize = BLOCK_ROUNDS * super::CHANNELS;

/// CPU cycles of a block of four channels: 8 ms.
pub const BLOCK_CYCLES: u64 = BLOCK_CONVERSIONS as u64 * CONVERSION_CYCLES;

/// Blocks ignored after reset (neither summed nor published), while the analog filters settle: 12 of
/// 8 ms are more than ten time constants of the slowest (28 Hz) low-pass. Solution periods follow.
pub const WARM_UP_BLOCKS: usize = 12;

/// How many conversions of a channel are averaged, and how often: once in a period, the last of it; and
/// of how many channels, which are converted in turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Averaging {
    log2: u8,
    period_log2: u8,
    channels: u8,
}

impl Averaging {
    /// Largest log2 of averaging length and period: 4096 conversions, 2 s.
    pub const MOST_LOG2: u8 = 12;
    /// Least log2 of the period: a block, so that solutions leave time to be computed and sent.
    pub const LEAST_PERIOD_LOG2: u8 = BLOCK_ROUNDS.trailing_zeros() as u8;
    /// What a device without a valid calibration does: 16 of 16, 125 solutions per second.
    pub const DEFAULT: Self = Self {
        log2: Self::LEAST_PERIOD_LOG2,
        period_log2: Self::LEAST_PERIOD_LOG2,
        channels: super::CHANNELS as u8,
    };

    /// From the log2 of both numbers of conversions per channel, of four channels; `None` if the period is not between
    /// [`Self::LEAST_PERIOD_LOG2`] and [`Self::MOST_LOG2`], or shorter than what is averaged.
    #[must_use]
    pub const fn new(log2: u8, period_log2: u8) -> Option<Self> {
        let is_admissible = log2 <= period_log2
            && Self::LEAST_PERIOD_LOG2 <= period_log2
            && period_log2 <= Self::MOST_LOG2;
        if is_admissible {
            Some(Self {
                log2,
                period_log2,
                channels: super::CHANNELS as u8,
            })
        } else {
            None
        }
    }

    /// The same with the channels that a device with `third_tilt` converts.
    #[must_use]
    pub const fn with(self, third_tilt: ThirdTilt) -> Self {
        Self {
            channels: third_tilt.channels() as u8,
            ..self
        }
    }

    /// Channels that are converted in turn.
    #[must_use]
    pub const fn channels(self) -> usize {
        self.channels as usize
    }

    /// Conversions of a block.
    #[must_use]
    pub const fn block_conversions(self) -> usize {
        BLOCK_ROUNDS * self.channels()
    }

    /// CPU cycles of a block: 8 ms for four channels, 10 ms for five.
    #[must_use]
    pub const fn block_cycles(self) -> u64 {
        self.block_conversions() as u64 * CONVERSION_CYCLES
    }

    /// Conversions that are ignored after reset.
    #[must_use]
    pub const fn warm_up_conversions(self) -> usize {
        WARM_UP_BLOCKS * self.block_conversions()
    }

    /// CPU cycles that they take.
    #[must_use]
    pub const fn warm_up_cycles(self) -> u64 {
        WARM_UP_BLOCKS as u64 * self.block_cycles()
    }

    /// log2 of the conversions averaged per channel.
    #[must_use]
    pub const fn log2(self) -> u8 {
        self.log2
    }

    /// log2 of the conversions per channel from one solution to the next.
    #[must_use]
    pub const fn period_log2(self) -> u8 {
        self.period_log2
    }

    /// Conversions averaged per channel.
    #[must_use]
    pub const fn length(self) -> usize {
        1 << self.log2
    }

    /// Conversions per channel from one solution to the next.
    #[must_use]
    pub const fn period(self) -> usize {
        1 << self.period_log2
    }

    /// Conversions of all channels from one solution to the next.
    #[must_use]
    pub const fn conversions(self) -> usize {
        self.period() * self.channels()
    }

    /// CPU cycles from one solution to the next.
    #[must_use]
    pub const fn cycles(self) -> u64 {
        self.conversions() as u64 * CONVERSION_CYCLES
    }

    /// Blocks of a period.
    #[must_use]
    pub const fn blocks(self) -> usize {
        self.period() / BLOCK_ROUNDS
    }

    /// Blocks of a period that count: the last.
    #[must_use]
    pub const fn counted_blocks(self) -> usize {
        if self.length() < BLOCK_ROUNDS {
            1
        } else {
            self.length() / BLOCK_ROUNDS
        }
    }

    /// Rounds of each block that are summed, its last: all, or one average's.
    #[must_use]
    pub const fn summed_rounds(self) -> usize {
        if self.length() < BLOCK_ROUNDS {
            self.length()
        } else {
            BLOCK_ROUNDS
        }
    }

    /// Conversions of each block that are summed.
    #[must_use]
    pub const fn summed_conversions(self) -> usize {
        self.summed_rounds() * self.channels()
    }

    /// Whether conversion `index` of a period is one of those that are averaged.
    #[must_use]
    pub const fn counts(self, index: usize) -> bool {
        index >= self.conversions() - self.length() * self.channels()
    }

    /// Whether conversion `index` of a period is summed in its block.
    #[must_use]
    pub const fn is_summed(self, index: usize) -> bool {
        let block = self.block_conversions();
        index % block >= block - self.summed_conversions()
    }
}

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
    /// Select of the tilt channels' multiplexer: low gives the band-pass to x, high to y. OC2A.
    pub const SELECT: &str = "PB3";
    /// Follows SELECT by [`super::SETTLING_CYCLES`]: while the two differ the band-pass has settled,
    /// and strobes reach the track-and-hold pair of the selected channel. OC2B.
    pub const SETTLED: &str = "PD3";
    /// Positive input of the analog comparator: the third tilt channel, where it is compared. AIN0.
    /// (Where it is measured, it is on ADC4.)
    pub const THIRD_TILT: &str = "PD6";
    /// Negative input of the analog comparator: mid supply, where a third tilt channel is compared. AIN1.
    pub const MID_SUPPLY: &str = "PD7";
    /// High while a solution is computed; an oscilloscope, or a bench, sees load and deadlines.
    pub const SOLVING: &str = "PB5";
}
