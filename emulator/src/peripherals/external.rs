//! Pin-driven inputs: INT0, INT1 and pin change interrupts (data sheet section 12.2), with the
//! synchroniser that the timers' clock and capture inputs share.
//!
//! A level that changes at cycle c is known inside three clock edges later (figure 13-1 for pin
//! changes; 2.5 to 3.5 clocks for T0, T1 and ICP1). For INT0 and INT1 the same delay is inferred.

use std::collections::VecDeque;

use crate::registers::{EICRA, EIFR, EIMSK, PCICR, PCIFR, PCMSK0};

/// Clock edges from a pin to the flag that it sets.
const DELAY: u64 = 3;
/// INT0 and INT1 are pins 2 and 3 of port D.
const INT_PORT: usize = 2;
const INT_MASKS: [u8; 2] = [0x04, 0x08];
/// Port C has seven pins with pin change interrupts.
const PCINT_VALID: [u8; 3] = [0xFF, 0x7F, 0xFF];

/// Levels of the three ports.
pub(crate) type Levels = [u8; 3];

/// Registers and synchroniser.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct External {
    control: u8,
    int_mask: u8,
    int_flags: u8,
    change_control: u8,
    change_flags: u8,
    change_masks: Levels,
    /// Pins that anybody looks at.
    watched: Levels,
    /// Levels outside, as last seen.
    outside: Levels,
    /// Levels behind the synchroniser.
    inside: Levels,
    /// Changes on their way through the synchroniser.
    moving: VecDeque<(u64, Levels)>,
}

impl External {
    /// Pins that the interrupts look at.
    pub(crate) fn interrupt_pins(&self) -> Levels {
        let mut pins = self.change_masks;
        for (n, mask) in INT_MASKS.into_iter().enumerate() {
            if self.sense(n) != 0 || self.int_mask >> n & 1 != 0 {
                pins[INT_PORT] |= mask;
            }
        }
        pins
    }

    pub(crate) fn watched(&self) -> Levels {
        self.watched
    }

    /// Sets the watched pins. Pins that are new start at their present `levels`, without an edge.
    pub(crate) fn watch(&mut self, pins: Levels, levels: Levels) {
        for port in 0..3 {
            let new = pins[port] & !self.watched[port];
            let merge = |old: u8| old & !new | levels[port] & new;
            self.outside[port] = merge(self.outside[port]);
            self.inside[port] = merge(self.inside[port]);
            for (_, moving) in &mut self.moving {
                moving[port] = moving[port] & !new | levels[port] & new;
            }
        }
        self.watched = pins;
    }

    /// Takes the levels of the watched pins from cycle `at` on.
    pub(crate) fn observe(&mut self, levels: Levels, at: u64) {
        let mut now = self.outside;
        for port in 0..3 {
            now[port] = now[port] & !self.watched[port] | levels[port] & self.watched[port];
        }
        if now != self.outside {
            self.outside = now;
            self.moving.push_back((at + DELAY, now));
        }
    }

    pub(crate) fn next_event(&self) -> Option<u64> {
        self.moving.front().map(|&(at, _)| at)
    }

    /// The oldest change comes out of the synchroniser: sets the flags and returns the levels
    /// before and after. `is_clocked`: the I/O clock runs, so that edges of INT0 and INT1 count.
    pub(crate) fn step(&mut self, is_clocked: bool) -> Option<(Levels, Levels)> {
        let (_, new) = self.moving.pop_front()?;
        let old = self.inside;
        self.inside = new;
        for port in 0..3 {
            if (old[port] ^ new[port]) & self.change_masks[port] != 0 {
                self.change_flags |= 1 << port;
            }
        }
        for (n, mask) in INT_MASKS.into_iter().enumerate() {
            let (was, is) = (old[INT_PORT] & mask != 0, new[INT_PORT] & mask != 0);
            let is_edge = match self.sense(n) {
                1 => was != is,
                2 => was && !is,
                3 => !was && is,
                _ => false,
            };
            if is_edge && is_clocked {
                self.int_flags |= 1 << n;
            }
        }
        Some((old, new))
    }

    /// Interrupt sense control of INTn: 0 low level, 1 any change, 2 falling, 3 rising edge.
    fn sense(&self, n: usize) -> u8 {
        self.control >> (2 * n) & 3
    }

    pub(crate) fn int_flag(&self, n: usize) -> bool {
        self.int_flags >> n & 1 != 0
    }

    /// Whether INTn requests an interrupt: by flag, or as a level while the pin is low.
    pub(crate) fn int_requests(&self, n: usize) -> bool {
        let is_low = self.inside[INT_PORT] & INT_MASKS[n] == 0;
        let level = self.sense(n) == 0 && is_low;
        self.int_mask >> n & 1 != 0 && (level || self.int_flag(n))
    }

    pub(crate) fn change_requests(&self, group: usize) -> bool {
        self.change_flags & self.change_control & 1 << group != 0
    }

    pub(crate) fn clear_int(&mut self, n: usize) {
        self.int_flags &= !(1 << n);
    }

    pub(crate) fn clear_change(&mut self, group: usize) {
        self.change_flags &= !(1 << group);
    }

    pub(crate) fn read(&self, address: u16) -> u8 {
        match address {
            EICRA => self.control,
            EIMSK => self.int_mask,
            EIFR => self.int_flags,
            PCICR => self.change_control,
            PCIFR => self.change_flags,
            _ => self.change_masks[usize::from(address - PCMSK0)],
        }
    }

    pub(crate) fn write(&mut self, address: u16, value: u8) {
        match address {
            EICRA => self.control = value & 15,
            EIMSK => self.int_mask = value & 3,
            EIFR => self.int_flags &= !value,
            PCICR => self.change_control = value & 7,
            PCIFR => self.change_flags &= !value,
            _ => {
                let group = usize::from(address - PCMSK0);
                self.change_masks[group] = value & PCINT_VALID[group];
            }
        }
    }
}

/// Input capture unit of Timer1 behind the synchroniser: edge detector and noise canceler, which
/// wants four equal samples in a row (section 16.6.2).
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct CaptureInput {
    level: bool,
    /// A level that differs, and the cycle at which it will have been steady for four samples.
    candidate: Option<(u64, bool)>,
}

const NOISE_SAMPLES: u64 = 4;

impl CaptureInput {
    pub(crate) fn next_event(&self) -> Option<u64> {
        self.candidate.map(|(at, _)| at)
    }

    /// The synchronised level is `level` from cycle `at` on. Returns whether an edge passes now.
    pub(crate) fn input(&mut self, level: bool, at: u64, has_canceler: bool) -> Option<bool> {
        if !has_canceler {
            self.candidate = None;
            return self.accept(level);
        }
        self.candidate = (level != self.level).then_some((at + NOISE_SAMPLES, level));
        None
    }

    /// The candidate has been steady for long enough.
    pub(crate) fn step(&mut self) -> Option<bool> {
        let (_, level) = self.candidate.take()?;
        self.accept(level)
    }

    fn accept(&mut self, level: bool) -> Option<bool> {
        let is_edge = level != self.level;
        self.level = level;
        is_edge.then_some(level)
    }

    /// Starts at a level without an edge.
    pub(crate) fn preset(&mut self, level: bool) {
        *self = CaptureInput {
            level,
            candidate: None,
        };
    }
}
