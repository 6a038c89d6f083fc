//! Watchdog timer (data sheet section 10.9): its own 128 kHz oscillator, interrupt and reset.
//!
//! Inaccuracies: the oscillator is exact; the real one varies with supply and temperature.

use crate::system::CHANGE_WINDOW;

const WDIF: u8 = 0x80;
const WDIE: u8 = 0x40;
const WDCE: u8 = 0x10;
const WDE: u8 = 0x08;
const WDP: u8 = 0x27;
/// Oscillator frequency, and its cycles in the shortest time-out.
const OSCILLATOR_HZ: u64 = 128_000;
const SHORTEST: u64 = 2048;

/// What a time-out brings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TimeOut {
    Interrupt,
    Reset,
}

/// Watchdog register and counter.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Watchdog {
    control: u8,
    flag: bool,
    /// Cycle at which the counter was zero.
    started: u64,
    change_until: u64,
    /// WDRF in MCUSR and the WDTON fuse both keep WDE set.
    is_forced: bool,
    /// The WDTON fuse keeps WDIE clear as well.
    is_always_on: bool,
}

impl Watchdog {
    /// After a reset at cycle `at`; `is_always_on`: by the WDTON fuse.
    pub(crate) fn after_reset(at: u64, is_forced: bool, is_always_on: bool) -> Watchdog {
        Watchdog {
            started: at,
            is_forced,
            is_always_on,
            ..Watchdog::default()
        }
    }

    /// WDRF or WDTON hold WDE.
    pub(crate) fn force(&mut self, is_forced: bool) {
        if self.is_forced && !is_forced {
            // WDE stays as it was until the program clears it.
            self.control |= WDE;
        }
        self.is_forced = is_forced;
    }

    /// Whether a time-out resets the chip: the next one, or in interrupt and system reset mode the
    /// one behind it, unless the interrupt is executed in between.
    pub(crate) fn resets(&self) -> bool {
        self.is_forced || self.control & WDE != 0
    }

    pub(crate) fn requests(&self) -> bool {
        self.flag && self.control & WDIE != 0
    }

    fn timeout(&self, hz: u64) -> u64 {
        let wdp = (self.control >> 2 & 8 | self.control & 7).min(9);
        ((SHORTEST << wdp) * hz).div_ceil(OSCILLATOR_HZ)
    }

    pub(crate) fn next_event(&self, hz: u64) -> Option<u64> {
        let runs = self.resets() || self.control & WDIE != 0;
        runs.then(|| self.started + self.timeout(hz))
    }

    /// WDR at cycle `at`.
    pub(crate) fn restart(&mut self, at: u64) {
        self.started = at;
    }

    /// The counter has run out at cycle `at`.
    pub(crate) fn time_out(&mut self, at: u64) -> TimeOut {
        self.started = at;
        // With WDIE set the first time-out interrupts; if that is still waiting, the next resets.
        if self.resets() && (self.control & WDIE == 0 || self.flag) {
            return TimeOut::Reset;
        }
        self.flag = true;
        TimeOut::Interrupt
    }

    /// The vector is entered: in interrupt and reset mode WDIE is cleared too.
    pub(crate) fn acknowledge(&mut self) {
        self.flag = false;
        if self.resets() {
            self.control &= !WDIE;
        }
    }

    pub(crate) fn read(&self, at: u64) -> u8 {
        let forced = if self.is_forced { WDE } else { 0 };
        let change = if at < self.change_until { WDCE } else { 0 };
        self.control | forced | change | if self.flag { WDIF } else { 0 }
    }

    /// WDTCSR with effect at cycle `at`.
    pub(crate) fn write(&mut self, value: u8, at: u64) {
        if value & WDIF != 0 {
            self.flag = false;
        }
        let is_open = at <= self.change_until && self.change_until > 0;
        let was_idle = !self.resets() && self.control & WDIE == 0;
        // Setting WDE needs no timed sequence; clearing it and changing the prescaler do.
        let mut control = self.control & !WDIE | value & WDIE | value & WDE;
        if value & (WDCE | WDE) == WDCE | WDE {
            self.change_until = at + CHANGE_WINDOW;
        } else if is_open && value & WDCE == 0 {
            control = value & (WDIE | WDE | WDP);
            self.change_until = 0;
        }
        if self.is_always_on {
            control &= !WDIE;
        }
        self.control = control;
        if was_idle {
            self.started = at;
        }
    }

    /// The processor clock changes from `old_hz` to `new_hz` at cycle `at`: the time left stays.
    pub(crate) fn rescale(&mut self, at: u64, old_hz: u64, new_hz: u64) {
        let elapsed = at - self.started;
        let scaled = u128::from(elapsed) * u128::from(new_hz) / u128::from(old_hz);
        self.started = at.saturating_sub(scaled as u64);
    }
}
