//! General digital I/O (data sheet section 13): one port of up to eight pins.
//!
//! A pin is driven by PORT where DDR is set, unless an alternate function overrides value or
//! direction. PIN reads the level through a latch and a flip-flop: the level of the cycle before,
//! so that IN directly after OUT still reads the old level (figure 13-3, 13-4).

/// What alternate functions impose on the pins of a port.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Override {
    /// Pins whose value is overridden, and the values.
    pub(crate) value_mask: u8,
    pub(crate) value: u8,
    /// Pins forced to be outputs, pins forced to be inputs.
    pub(crate) force_out: u8,
    pub(crate) force_in: u8,
}

impl Override {
    /// Imposes `level` on the pins of `mask` where it is known.
    #[inline]
    pub(crate) fn drive(&mut self, mask: u8, level: Option<bool>) {
        if let Some(level) = level {
            self.value_mask |= mask;
            self.value = self.value & !mask | if level { mask } else { 0 };
        }
    }
}

/// Registers and output stage of one port.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Port {
    pub(crate) port: u8,
    pub(crate) ddr: u8,
    /// Pins driven by the chip, and their levels.
    driven: u8,
    level: u8,
    /// `driven` and `level` before cycle `changed`.
    before: (u8, u8),
    changed: u64,
    /// PORT as of the last update: the pull-ups.
    pulled: u8,
    /// Last level reported per pin.
    reported: u8,
}

impl Port {
    /// Registers and output stage as after a reset; what was reported stays known.
    pub(crate) fn reset(&mut self) {
        *self = Port {
            reported: self.reported,
            ..Port::default()
        };
    }

    /// Works out the output stage from registers and overrides, at cycle `at`. Returns the pins
    /// whose driven level differs from the last one reported, and those whose level may differ in
    /// any way (driven or pulled).
    #[inline]
    pub(crate) fn update(&mut self, over: Override, at: u64) -> (u8, u8) {
        let driven = (self.ddr | over.force_out) & !over.force_in;
        let value = self.port & !over.value_mask | over.value & over.value_mask;
        let level = value & driven;
        let touched = (driven ^ self.driven) | (level ^ self.level) | (self.port ^ self.pulled);
        self.pulled = self.port;
        if (driven, level) != (self.driven, self.level) {
            if at != self.changed {
                self.before = (self.driven, self.level);
                self.changed = at;
            }
            (self.driven, self.level) = (driven, level);
        }
        let edges = (self.level ^ self.reported) & self.driven;
        self.reported ^= edges;
        (edges, touched)
    }

    /// What drives the pin of `mask` changes its level at cycle `at`, and nothing else changes.
    /// Returns whether the pin shows it.
    #[inline]
    pub(crate) fn flip(&mut self, mask: u8, at: u64) -> bool {
        if self.driven & mask == 0 {
            return false;
        }
        if at != self.changed {
            self.before = (self.driven, self.level);
            self.changed = at;
        }
        self.level ^= mask;
        self.reported ^= mask;
        true
    }

    /// Pins the chip drives and their levels during cycle `at`.
    pub(crate) fn outputs(&self, at: u64) -> (u8, u8) {
        if at < self.changed {
            self.before
        } else {
            (self.driven, self.level)
        }
    }

    #[inline]
    pub(crate) fn level(&self) -> u8 {
        self.level
    }

    /// Pins with the pull-up switched on; `disabled`: PUD.
    pub(crate) fn pull_ups(&self, disabled: bool) -> u8 {
        if disabled {
            0
        } else {
            self.port & !self.driven
        }
    }
}
