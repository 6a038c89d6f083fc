//! Analog-to-digital converter (data sheet section 24).
//!
//! The ADC clock is a tap of a 7-bit counter that starts with ADEN. A conversion begins at a
//! rising edge of that clock and samples 1.5 (first conversion: 13.5) ADC clocks later, ending
//! after 13 (25). A trigger resets the counter, 3 cycles later (synchroniser); so it samples 2
//! ADC clocks and ends 13.5 ADC clocks after that (24.4, figures 24-4 to 24-7, table 24-1).
//!
//! Inaccuracies: settling after a change of reference, and a change of ADPS while converting
//! (the conversion under way keeps its clock).

use crate::environment::{AnalogInput, Conversion};

const ADEN: u8 = 0x80;
const ADSC: u8 = 0x40;
const ADATE: u8 = 0x20;
const ADIF: u8 = 0x10;
const ADIE: u8 = 0x08;
/// Cycles from a trigger edge to the reset of the ADC prescaler.
const TRIGGER_SYNC: u64 = 3;

/// Progress of a conversion; every variant holds the cycles still to come.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    Idle,
    /// Waits for the rising ADC clock edge at `start`.
    Waiting {
        trigger: u64,
        start: u64,
    },
    Sampling {
        trigger: u64,
        start: u64,
        hold: u64,
        done: u64,
        input: u8,
    },
    Holding {
        sampled: Conversion,
    },
}

/// What the machine has to do at the ADC's event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Step {
    Nothing,
    /// Ask for the voltage of a multiplexer input, then call [`Adc::hold`].
    Sample {
        input: u8,
        reference: u8,
    },
    Complete(Conversion),
}

/// Converter state.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Adc {
    admux: u8,
    /// ADEN, ADATE, ADIE, ADPS as written.
    control: u8,
    trigger_select: u8,
    flag: bool,
    phase: Phase,
    /// Cycle at which the prescaler count was zero.
    origin: u64,
    /// The next conversion is the first since ADEN was set.
    first: bool,
    result: u16,
    unread: bool,
    locked: bool,
}

impl Adc {
    pub(crate) fn new() -> Adc {
        Adc {
            admux: 0,
            control: 0,
            trigger_select: 0,
            flag: false,
            phase: Phase::Idle,
            origin: 0,
            first: false,
            result: 0,
            unread: false,
            locked: false,
        }
    }

    /// Cycle of the next step, if a conversion is under way.
    #[inline]
    pub(crate) fn next_event(&self) -> Option<u64> {
        match self.phase {
            Phase::Idle => None,
            Phase::Waiting { start, .. } => Some(start),
            Phase::Sampling { hold, .. } => Some(hold),
            Phase::Holding { sampled } => Some(sampled.done_cycle),
        }
    }

    /// Cycle at which the conversion under way ends, as far as it is known now.
    #[inline]
    pub(crate) fn end(&self) -> Option<u64> {
        match self.phase {
            Phase::Idle => None,
            Phase::Waiting { start, .. } => Some(start + self.period() * self.timing().1),
            Phase::Sampling { done, .. } => Some(done),
            Phase::Holding { sampled } => Some(sampled.done_cycle),
        }
    }

    /// From the start of the next conversion to its sample, in halves of ADC clocks, and to its end,
    /// in ADC clocks.
    #[inline]
    fn timing(&self) -> (u64, u64) {
        if self.first { (27, 25) } else { (3, 13) }
    }

    #[inline]
    pub(crate) fn requests(&self) -> bool {
        self.flag && self.control & ADIE != 0
    }

    pub(crate) fn clear_flag(&mut self) {
        self.flag = false;
    }

    pub(crate) fn is_enabled(&self) -> bool {
        self.control & ADEN != 0
    }

    pub(crate) fn is_busy(&self) -> bool {
        !matches!(self.phase, Phase::Idle)
    }

    /// Trigger source ADTS2:0 if auto triggering is on.
    #[inline]
    pub(crate) fn trigger_source(&self) -> Option<u8> {
        (self.control & ADATE != 0).then_some(self.trigger_select & 7)
    }

    fn is_free_running(&self) -> bool {
        self.trigger_source() == Some(0)
    }

    /// ADC clock period in cycles.
    #[inline]
    fn period(&self) -> u64 {
        1 << (self.control & 7).max(1)
    }

    /// First rising edge of the ADC clock after cycle `after`.
    fn rising_edge(&self, after: u64) -> u64 {
        let period = self.period();
        let first = self.origin + period / 2;
        match after.checked_sub(first) {
            None => first,
            Some(past) => first + (past / period + 1) * period,
        }
    }

    /// Starts a conversion by software at cycle `at`, unless one is under way.
    pub(crate) fn start(&mut self, at: u64) {
        if self.is_enabled() && !self.is_busy() {
            self.phase = Phase::Waiting {
                trigger: at,
                start: self.rising_edge(at),
            };
        }
    }

    /// The rising edge of the selected trigger flag. Returns whether it starts a conversion.
    pub(crate) fn trigger(&mut self, at: u64) -> bool {
        if !self.is_enabled() || self.is_busy() {
            return false;
        }
        self.origin = at + TRIGGER_SYNC;
        self.phase = Phase::Waiting {
            trigger: at,
            start: self.origin + self.period() / 2,
        };
        true
    }

    /// Carries out the step that is due at [`Adc::next_event`].
    pub(crate) fn step(&mut self) -> Step {
        match self.phase {
            Phase::Idle => Step::Nothing,
            Phase::Waiting { trigger, start } => {
                let (hold_halves, clocks) = self.timing();
                let period = self.period();
                let hold = start + period / 2 * hold_halves;
                let done = start + period * clocks;
                self.first = false;
                // The multiplexer and reference selection are locked from here on.
                self.phase = Phase::Sampling {
                    trigger,
                    start,
                    hold,
                    done,
                    input: self.admux,
                };
                Step::Nothing
            }
            Phase::Sampling { input, .. } => Step::Sample {
                input: input & 15,
                reference: input >> 6,
            },
            Phase::Holding { sampled } => self.complete(sampled),
        }
    }

    /// Takes the held voltage and the reference, both in volts.
    pub(crate) fn hold(&mut self, input: AnalogInput, volts: f64, reference_volts: f64) {
        if let Phase::Sampling {
            trigger,
            start,
            hold,
            done,
            ..
        } = self.phase
        {
            let sampled = Conversion {
                trigger_cycle: trigger,
                start_cycle: start,
                hold_cycle: hold,
                done_cycle: done,
                input,
                code: quantise(volts, reference_volts),
                volts,
                reference_volts,
                discarded: false,
                overwrote_unread: false,
            };
            self.phase = Phase::Holding { sampled };
        }
    }

    fn complete(&mut self, mut conversion: Conversion) -> Step {
        conversion.discarded = self.locked;
        conversion.overwrote_unread = self.unread && !self.locked;
        if !self.locked {
            self.result = conversion.code;
            self.unread = true;
        }
        self.flag = true;
        let at = conversion.done_cycle;
        self.phase = match self.is_free_running() {
            true => Phase::Waiting {
                trigger: at,
                start: at,
            },
            false => Phase::Idle,
        };
        Step::Complete(conversion)
    }

    fn adjusted(&self) -> u16 {
        if self.admux & 0x20 != 0 {
            self.result << 6
        } else {
            self.result
        }
    }

    /// ADCL: locks the result until ADCH is read.
    pub(crate) fn read_low(&mut self) -> u8 {
        self.locked = true;
        self.adjusted() as u8
    }

    pub(crate) fn read_high(&mut self) -> u8 {
        self.locked = false;
        self.unread = false;
        (self.adjusted() >> 8) as u8
    }

    pub(crate) fn read_control(&self) -> u8 {
        let busy = if self.is_busy() { ADSC } else { 0 };
        let flag = if self.flag { ADIF } else { 0 };
        self.control | busy | flag
    }

    /// ADCSRA, taking effect at cycle `at`.
    pub(crate) fn write_control(&mut self, value: u8, at: u64) {
        let was_enabled = self.is_enabled();
        self.control = value & (ADEN | ADATE | ADIE | 7);
        if value & ADIF != 0 {
            self.flag = false;
        }
        if self.is_enabled() && !was_enabled {
            self.origin = at;
            self.first = true;
        }
        if !self.is_enabled() {
            self.phase = Phase::Idle;
        }
        if value & ADSC != 0 {
            self.start(at);
        }
    }

    pub(crate) fn trigger_select(&self) -> u8 {
        self.trigger_select
    }

    /// ADCSRB: ACME and ADTS.
    pub(crate) fn write_trigger_select(&mut self, value: u8) {
        self.trigger_select = value & 0x47;
    }

    pub(crate) fn mux(&self) -> u8 {
        self.admux
    }

    pub(crate) fn write_mux(&mut self, value: u8) {
        self.admux = value & 0xEF;
    }

    /// The clock stood still for `cycles`.
    pub(crate) fn shift(&mut self, cycles: u64) {
        self.origin += cycles;
        match &mut self.phase {
            Phase::Idle => {}
            Phase::Waiting { start, .. } => *start += cycles,
            Phase::Sampling {
                start, hold, done, ..
            } => {
                *start += cycles;
                *hold += cycles;
                *done += cycles;
            }
            Phase::Holding { sampled } => sampled.done_cycle += cycles,
        }
    }
}

/// Code of a voltage: floor(V * 1024 / Vref), clipped to 0..=1023 (section 24.7). A voltage that
/// is not a number reads 0.
fn quantise(volts: f64, reference_volts: f64) -> u16 {
    let code = (volts * 1024.0 / reference_volts).floor();
    code.clamp(0.0, 1023.0) as u16
}
