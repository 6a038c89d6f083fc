//! System control: sleep mode, clock prescaler, power reduction, reset flags, general purpose
//! I/O registers (data sheet sections 9, 10, 11).

use crate::environment::SerialByte;

/// Cycles within which a protected change must follow its enable.
pub(crate) const CHANGE_WINDOW: u64 = 4;

/// Power reduction bits in PRR.
pub(crate) mod power {
    pub(crate) const ADC: u8 = 0x01;
    pub(crate) const SPI: u8 = 0x04;
    pub(crate) const TWI: u8 = 0x80;
    pub(crate) const USART: u8 = 0x02;
    pub(crate) const TIMER1: u8 = 0x08;
    pub(crate) const TIMER0: u8 = 0x20;
    pub(crate) const TIMER2: u8 = 0x40;
}

/// Plain system registers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct System {
    /// Sleep control: SM2:0 in bits 3:1, SE in bit 0.
    pub(crate) smcr: u8,
    pub(crate) mcusr: u8,
    pub(crate) mcucr: u8,
    pub(crate) prr: u8,
    pub(crate) osccal: u8,
    pub(crate) gpior: [u8; 3],
    pub(crate) didr: [u8; 2],
    /// Processor clock = oscillator / 2^clock_shift.
    pub(crate) clock_shift: u8,
    /// Until which cycle a write to CLKPR may change the division.
    clock_change_until: u64,
    /// Until which cycle IVSEL may change.
    vector_change_until: u64,
    /// Next byte on the receive line, fetched from the environment ahead of its time.
    pub(crate) serial: Option<SerialByte>,
}

impl System {
    pub(crate) fn new() -> System {
        System {
            smcr: 0,
            // PORF: power-on reset.
            mcusr: 0x01,
            mcucr: 0,
            prr: 0,
            osccal: 0x80,
            gpior: [0; 3],
            didr: [0; 2],
            clock_shift: 0,
            clock_change_until: 0,
            vector_change_until: 0,
            serial: None,
        }
    }

    pub(crate) fn read_clkpr(&self, at: u64) -> u8 {
        self.clock_shift | u8::from(at < self.clock_change_until) << 7
    }

    /// CLKPR with effect at cycle `at`. Returns whether the clock changed.
    pub(crate) fn write_clkpr(&mut self, value: u8, at: u64) -> bool {
        if value == 0x80 {
            self.clock_change_until = at + CHANGE_WINDOW;
            return false;
        }
        let armed = at <= self.clock_change_until && self.clock_change_until > 0;
        if value & 0x80 != 0 || !armed {
            return false;
        }
        self.clock_change_until = 0;
        self.clock_shift = (value & 15).min(8);
        true
    }

    /// Setting IVCE disables interrupts for the cycles of its window.
    pub(crate) fn interrupts_held_until(&self) -> u64 {
        self.vector_change_until
    }

    /// MCUCR with effect at cycle `at`: bit 0 IVCE opens a window in which bit 1 IVSEL changes.
    pub(crate) fn write_mcucr(&mut self, value: u8, at: u64) {
        let is_open = at <= self.vector_change_until && self.vector_change_until > 0;
        let vectors = if is_open && value & 1 == 0 {
            value
        } else {
            self.mcucr
        } & 2;
        self.mcucr = value & 0x70 | vectors;
        self.vector_change_until = if value & 1 != 0 {
            at + CHANGE_WINDOW
        } else {
            0
        };
    }

    pub(crate) fn sleep_enabled(&self) -> bool {
        self.smcr & 1 != 0
    }

    pub(crate) fn sleep_mode(&self) -> u8 {
        self.smcr >> 1 & 7
    }

    pub(crate) fn is_off(&self, module: u8) -> bool {
        self.prr & module != 0
    }
}
