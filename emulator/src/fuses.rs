//! Fuse bytes and what they decide (data sheet sections 8.2 to 8.7 and 27.2).

/// Fuse bytes; a cleared bit is programmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fuses {
    /// CKDIV8, CKOUT, SUT1:0, CKSEL3:0.
    pub low: u8,
    /// RSTDISBL, DWEN, SPIEN, WDTON, EESAVE, BOOTSZ1:0, BOOTRST.
    pub high: u8,
    /// BODLEVEL2:0.
    pub extended: u8,
}

impl Default for Fuses {
    /// A crystal at full speed with slow start-up, reset to address 0, brown-out at 2.7 V.
    fn default() -> Fuses {
        Fuses {
            low: 0xFF,
            high: 0xDF,
            extended: 0xFD,
        }
    }
}

impl Fuses {
    /// CKDIV8: the clock prescaler starts at 8.
    pub(crate) fn divides_clock(self) -> bool {
        self.low & 0x80 == 0
    }

    /// BOOTRST: reset goes to the boot section.
    pub(crate) fn boots_to_loader(self) -> bool {
        self.high & 1 == 0
    }

    /// WDTON: the watchdog resets, always.
    pub(crate) fn watchdog_always_on(self) -> bool {
        self.high & 0x10 == 0
    }

    /// Size of the boot section in words.
    pub(crate) fn boot_words(self) -> u16 {
        256 << (3 - (self.high >> 1 & 3))
    }

    fn is_crystal(self) -> bool {
        self.low & 15 >= 6
    }

    /// Start-up time from Power-down in clock cycles (tables 8-4, 8-6, 8-12, 8-16).
    pub(crate) fn wake_cycles(self) -> u64 {
        if !self.is_crystal() {
            return 6;
        }
        match (self.low & 1, self.low >> 4 & 3) {
            (0, 0 | 1) => 258,
            (0, _) | (1, 0) => 1024,
            _ => 16 * 1024,
        }
    }

    /// Delay after a reset in microseconds, beyond its 14 clock cycles.
    pub(crate) fn reset_delay_us(self) -> u64 {
        let sut = self.low >> 4 & 3;
        if !self.is_crystal() {
            return [0, 4_100, 65_000, 65_000][usize::from(sut)];
        }
        match (self.low & 1, sut) {
            (0, 2) | (1, 1) => 0,
            (0, 0 | 3) | (1, 2) => 4_100,
            _ => 65_000,
        }
    }
}
