//! The free-running 10-bit prescaler of the timers (data sheet section 17).
//!
//! It counts the I/O clock whatever the timers select, so the first tick after a timer is
//! enabled comes 1 to N clocks later. PSRSYNC/PSRASY reset it, TSM holds it in reset.

/// Prescaler phase: the cycle at which the count was zero.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Prescaler {
    origin: u64,
    held: bool,
}

impl Prescaler {
    /// Resets the count at cycle `at`; `hold` keeps it in reset until [`Prescaler::release`].
    pub(crate) fn reset(&mut self, at: u64, hold: bool) {
        self.origin = at;
        self.held = hold;
    }

    /// Ends the reset at cycle `at`.
    pub(crate) fn release(&mut self, at: u64) {
        if self.held {
            self.held = false;
            self.origin = at;
        }
    }

    pub(crate) fn is_held(&self) -> bool {
        self.held
    }

    /// The clock stood still for `cycles`: the count goes on where it was.
    pub(crate) fn shift(&mut self, cycles: u64) {
        self.origin += cycles;
    }

    /// Ticks of the clock divided by `2^shift` after cycle `from`, up to and including `to`.
    #[inline]
    pub(crate) fn ticks(&self, shift: u8, from: u64, to: u64) -> u64 {
        if self.held || to <= from {
            return 0;
        }
        self.count(shift, to) - self.count(shift, from)
    }

    /// Cycle of the `n`-th tick (from 1) after cycle `from`; `None` while held in reset.
    #[inline]
    pub(crate) fn cycle_of(&self, shift: u8, from: u64, n: u64) -> Option<u64> {
        if self.held {
            return None;
        }
        let ticks = self.count(shift, from).checked_add(n)?;
        // The origin may lie after `from` when it was set for a later edge.
        ticks.checked_mul(1 << shift)?.checked_add(self.origin)
    }

    /// Ticks from the origin to `cycle`.
    #[inline]
    fn count(&self, shift: u8, cycle: u64) -> u64 {
        cycle.saturating_sub(self.origin) >> shift
    }
}
