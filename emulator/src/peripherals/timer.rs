//! Timer/Counter 0, 1 and 2 (data sheet sections 15, 16, 18): one model, told apart by width,
//! mode table and clock table.
//!
//! The counter is brought forward from one *critical* tick to the next: a tick that leaves a
//! compare value, TOP, MAX or BOTTOM. Flags are set and OC outputs change on the timer clock edge
//! that leaves the compared value, in CTC that clears the counter (figures 15-8 to 15-11).
//!
//! Inaccuracies: the input of Timer2's asynchronous oscillator is not modelled.

mod outputs;

pub(crate) use self::outputs::OutputChange;
use super::prescaler::Prescaler;
use super::timer_mode::{CLOCKS_SYNC, CLOCKS_T2, Clock, MODES_8, MODES_16, Mode, Shape, Top};

/// Flag and mask bits, the same in TIFRn and TIMSKn.
pub(crate) const TOV: u8 = 1;
pub(crate) const OCFA: u8 = 2;
pub(crate) const OCFB: u8 = 4;
pub(crate) const ICF: u8 = 0x20;

/// Ticks after which a timer that nobody writes to has settled: four times the longest sequence.
const SETTLE: u64 = 4 * 2 * 0x1_0000;

/// A register of a timer; the machine maps addresses to these.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Register {
    ControlA,
    ControlB,
    ControlC,
    CountLow,
    CountHigh,
    CaptureLow,
    CaptureHigh,
    /// Compare register of channel 0 (A) or 1 (B).
    CompareLow(usize),
    CompareHigh(usize),
    Mask,
    Flags,
}

/// What tells one timer from another.
#[derive(Debug, PartialEq)]
pub(crate) struct Kind {
    max: u16,
    modes: &'static [Option<Mode>],
    clocks: &'static [Clock; 8],
    /// Valid bits of TIFRn and TIMSKn.
    flags: u8,
}

const TIMER0: Kind = Kind {
    max: 0xFF,
    modes: &MODES_8,
    clocks: &CLOCKS_SYNC,
    flags: TOV | OCFA | OCFB,
};
const TIMER1: Kind = Kind {
    max: 0xFFFF,
    modes: &MODES_16,
    clocks: &CLOCKS_SYNC,
    flags: TOV | OCFA | OCFB | ICF,
};
const TIMER2: Kind = Kind {
    max: 0xFF,
    modes: &MODES_8,
    clocks: &CLOCKS_T2,
    flags: TOV | OCFA | OCFB,
};
const KINDS: [&Kind; 3] = [&TIMER0, &TIMER1, &TIMER2];

/// State of one timer, valid for the clock edges up to and including cycle `last`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Timer {
    kind: &'static Kind,
    last: u64,
    count: u16,
    down: bool,
    /// A write to TCNT blocks the compare match of the next timer clock.
    blocked: bool,
    /// Compare values in use, and as the CPU wrote them (equal outside PWM modes).
    compare: [u16; 2],
    buffer: [u16; 2],
    capture: u16,
    control_a: u8,
    control_b: u8,
    mode: Mode,
    clock: Clock,
    /// Module clock switched off by PRR.
    frozen: bool,
    flags: u8,
    mask: u8,
    temp: u8,
    /// COM bits of both channels.
    output_modes: [u8; 2],
    /// Waveform generator outputs OCnA, OCnB.
    outputs: [bool; 2],
    /// Whether they drive their pins: follows the mode and the COM bits.
    connected: [bool; 2],
    /// What drove the pins when the machine last asked: `connected`, and `outputs` where connected.
    shown: ([bool; 2], [bool; 2]),
    /// Flags whose rising the ADC watches.
    pub(crate) watched: u8,
}

impl Timer {
    /// Timer `number` (0 to 2) after reset.
    pub(crate) fn new(number: usize) -> Timer {
        let kind = KINDS[number];
        Timer {
            kind,
            last: 0,
            count: 0,
            down: false,
            blocked: false,
            compare: [0; 2],
            buffer: [0; 2],
            capture: 0,
            control_a: 0,
            control_b: 0,
            mode: normal_mode(kind),
            clock: Clock::Stopped,
            frozen: false,
            flags: 0,
            mask: 0,
            temp: 0,
            output_modes: [0; 2],
            outputs: [false; 2],
            connected: [false; 2],
            shown: ([false; 2], [false; 2]),
            watched: 0,
        }
    }

    #[inline]
    pub(crate) fn flags(&self) -> u8 {
        self.flags
    }

    /// Flags that request an interrupt.
    #[inline]
    pub(crate) fn requests(&self) -> u8 {
        self.flags & self.mask
    }

    pub(crate) fn clear_flags(&mut self, bits: u8) {
        self.flags &= !bits;
    }

    pub(crate) fn clock(&self) -> Clock {
        self.clock
    }

    pub(crate) fn control_b(&self) -> u8 {
        self.control_b
    }

    /// Whether the mode bits select a reserved mode.
    pub(crate) fn is_reserved_mode(&self) -> bool {
        self.kind.modes[self.mode_index()].is_none()
    }

    /// Switches the module clock off or on at cycle `at` (up to which the caller has advanced).
    pub(crate) fn freeze(&mut self, frozen: bool) {
        self.frozen = frozen;
    }

    /// Takes all clock edges up to and including cycle `to`. Returns whether anything but the count
    /// may have changed.
    #[inline]
    pub(crate) fn advance(&mut self, to: u64, prescaler: &Prescaler) -> bool {
        let ticks = match self.clock {
            Clock::Divided(shift) if !self.frozen => prescaler.ticks(shift, self.last, to),
            _ => 0,
        };
        self.last = self.last.max(to);
        if ticks <= 2 * SETTLE {
            return self.advance_ticks(ticks);
        }
        self.settle(ticks)
    }

    /// Takes more timer clocks than it takes to settle.
    #[cold]
    fn settle(&mut self, ticks: u64) -> bool {
        // Nobody has looked for long. Once the buffers are loaded and the flags set, two periods
        // (outputs may toggle) change nothing: whole numbers of them are left out.
        self.advance_ticks(SETTLE);
        self.advance_ticks((ticks - SETTLE) % (2 * self.period()));
        true
    }

    /// Takes that many timer clocks. Returns whether one of them was critical.
    fn advance_ticks(&mut self, mut ticks: u64) -> bool {
        let mut any = false;
        while ticks > 0 {
            let critical = self.distance(true, true);
            if ticks < critical {
                self.glide(ticks);
                break;
            }
            self.glide(critical - 1);
            self.tick();
            ticks -= critical;
            any = true;
        }
        any
    }

    /// Ticks of one counting sequence.
    fn period(&self) -> u64 {
        let top = u64::from(self.top());
        if self.mode.is_phase() {
            (2 * top).max(2)
        } else {
            top + 1
        }
    }

    /// The clock stood still up to cycle `to`.
    pub(crate) fn skip_to(&mut self, to: u64) {
        self.last = self.last.max(to);
    }

    /// The next cycle at which a flag that somebody waits for may rise, or one at which the counter
    /// turns before it does.
    #[inline]
    pub(crate) fn next_flag(&self, prescaler: &Prescaler) -> Option<u64> {
        if !self.awaits(OCFA | OCFB | TOV | ICF) {
            return None;
        }
        self.next_critical(self.awaits(OCFA), self.awaits(OCFB), prescaler)
    }

    #[inline]
    fn next_critical(&self, a: bool, b: bool, prescaler: &Prescaler) -> Option<u64> {
        match self.clock {
            Clock::Divided(shift) if !self.frozen => {
                prescaler.cycle_of(shift, self.last, self.distance(a, b))
            }
            _ => None,
        }
    }

    /// One edge of an external clock at cycle `at`.
    pub(crate) fn external_tick(&mut self, at: u64) {
        self.last = self.last.max(at);
        if !self.frozen {
            self.tick();
        }
    }

    /// Input capture at the current count. Without effect where ICR is TOP.
    pub(crate) fn capture(&mut self) {
        if self.mode.top != Top::Icr {
            self.capture = self.count;
            self.flags |= ICF;
        }
    }

    fn awaits(&self, bits: u8) -> bool {
        !self.flags & bits & (self.mask | self.watched) != 0
    }

    fn top(&self) -> u16 {
        match self.mode.top {
            Top::Fixed(top) => top,
            Top::OcrA => self.compare[0],
            Top::Icr => self.capture,
        }
    }

    /// Ticks until the next critical one, that one included. Compare values count only if asked.
    #[inline]
    fn distance(&self, a: bool, b: bool) -> u64 {
        if self.blocked {
            return 1;
        }
        let (count, top) = (self.count, self.top());
        let is_down = self.mode.is_phase() && self.down;
        let turn = match is_down {
            true => count,
            false if count <= top => top - count,
            false => self.end_above_top() - count,
        };
        // A compare value behind the count is as good as a whole turn away.
        let gap = |value: u16| match is_down {
            true => count.wrapping_sub(value),
            false => value.wrapping_sub(count),
        };
        let mut nearest = turn;
        for (asked, value) in [(a, self.compare[0]), (b, self.compare[1])] {
            if asked {
                nearest = nearest.min(gap(value));
            }
        }
        u64::from(nearest) + 1
    }

    /// Where a counter that has passed TOP turns: at MAX, or at once in phase-correct modes.
    fn end_above_top(&self) -> u16 {
        if self.mode.is_phase() {
            self.count
        } else {
            self.kind.max
        }
    }

    /// Moves over ticks that are not critical.
    #[inline]
    fn glide(&mut self, ticks: u64) {
        let ticks = ticks as u16;
        self.count = if self.down {
            self.count - ticks
        } else {
            self.count + ticks
        };
    }

    /// One timer clock.
    #[inline]
    fn tick(&mut self) {
        let blocked = std::mem::take(&mut self.blocked);
        if self.mode.is_phase() {
            self.tick_dual_slope(blocked);
        } else {
            self.tick_single_slope(blocked);
        }
    }

    #[inline]
    fn tick_single_slope(&mut self, blocked: bool) {
        let (count, top) = (self.count, self.top());
        if !blocked {
            self.match_compares(count);
        }
        if count != top && count != self.kind.max {
            self.count = count + 1;
            return;
        }
        self.count = 0;
        if self.mode.shape != Shape::Ctc || count == self.kind.max {
            self.flags |= TOV;
        }
        if self.mode.top == Top::Icr && count == top {
            self.flags |= ICF;
        }
        if self.mode.shape == Shape::Fast {
            self.compare = self.buffer;
            self.drive_all(true);
        }
    }

    fn tick_dual_slope(&mut self, blocked: bool) {
        let (count, top) = (self.count, self.top());
        let at_top = !self.down && count >= top;
        let at_bottom = self.down && count == 0;
        // The outputs at TOP are those of a down match, at BOTTOM those of an up match.
        self.down = (self.down && !at_bottom) || at_top;
        if !blocked {
            self.match_compares(count);
        }
        if at_bottom {
            self.flags |= TOV;
            if self.mode.shape == Shape::PhaseFrequency {
                self.compare = self.buffer;
            }
        }
        if at_top {
            self.turn_at_top();
        }
        self.count = match self.down {
            true => count.saturating_sub(1),
            false => count.saturating_add(u16::from(top > 0)),
        };
    }

    fn turn_at_top(&mut self) {
        if self.mode.top == Top::Icr {
            self.flags |= ICF;
        }
        if self.mode.shape == Shape::Phase {
            self.compare = self.buffer;
        }
        // Symmetry around BOTTOM (data sheet 15.7.4): at TOP the output is what an up match left,
        // even where the match was missed because the compare value has just changed.
        let top = self.top();
        for channel in 0..2 {
            let high = self.compare[channel] >= top;
            match self.output_mode(channel) {
                2 => self.outputs[channel] = high,
                3 => self.outputs[channel] = !high,
                _ => {}
            }
        }
    }

    #[inline]
    fn match_compares(&mut self, count: u16) {
        for channel in 0..2 {
            if self.compare[channel] == count {
                self.flags |= OCFA << channel;
                self.drive_match(channel);
            }
        }
    }

    fn mode_index(&self) -> usize {
        let low = self.control_a & 3;
        let high = if self.kind.max == 0xFF {
            self.control_b >> 1 & 4
        } else {
            self.control_b >> 1 & 12
        };
        usize::from(low | high)
    }

    fn update_mode(&mut self) {
        self.mode = self.kind.modes[self.mode_index()].unwrap_or(normal_mode(self.kind));
        self.clock = self.kind.clocks[usize::from(self.control_b & 7)];
        if !self.mode.is_pwm() {
            // Outside PWM modes the buffers are transparent.
            self.compare = self.buffer;
        }
        if !self.mode.is_phase() {
            self.down = false;
        }
        self.output_modes = [self.control_a >> 6, self.control_a >> 4 & 3];
        self.connected = [0, 1].map(|channel| self.is_connected(channel));
    }

    /// Reads a register; the caller has advanced to the cycle of the access.
    pub(crate) fn read(&mut self, register: Register) -> u8 {
        match register {
            Register::ControlA => self.control_a,
            Register::ControlB => self.control_b,
            Register::ControlC => 0,
            Register::CountLow => self.latch(self.count),
            Register::CaptureLow => self.latch(self.capture),
            Register::CountHigh | Register::CaptureHigh => self.temp,
            Register::CompareLow(channel) => self.buffer[channel] as u8,
            Register::CompareHigh(channel) => (self.buffer[channel] >> 8) as u8,
            Register::Mask => self.mask,
            Register::Flags => self.flags,
        }
    }

    fn latch(&mut self, value: u16) -> u8 {
        self.temp = (value >> 8) as u8;
        value as u8
    }

    /// Writes a register; the caller has advanced to the edge at which the write takes effect.
    pub(crate) fn write(&mut self, register: Register, value: u8) {
        let wide = self.kind.max > 0xFF;
        let word = u16::from(value) | if wide { u16::from(self.temp) << 8 } else { 0 };
        match register {
            Register::ControlA => {
                self.control_a = value & 0xF3;
                self.update_mode();
            }
            Register::ControlB => {
                self.control_b = value & if wide { 0xDF } else { 0x0F };
                self.update_mode();
                if !wide {
                    self.force_outputs(value);
                }
            }
            Register::ControlC => self.force_outputs(value),
            Register::CountLow => {
                self.count = word;
                self.blocked = true;
            }
            Register::CaptureLow => {
                // ICR can be written only in the modes that use it as TOP.
                if self.mode.top == Top::Icr {
                    self.capture = word;
                }
            }
            Register::CountHigh | Register::CaptureHigh | Register::CompareHigh(_) => {
                self.temp = value;
            }
            Register::CompareLow(channel) => self.set_compare(channel, word),
            Register::Mask => self.mask = value & self.kind.flags,
            Register::Flags => self.flags &= !value,
        }
    }

    fn set_compare(&mut self, channel: usize, value: u16) {
        self.buffer[channel] = value;
        if !self.mode.is_pwm() {
            self.compare[channel] = value;
        }
    }
}

fn normal_mode(kind: &Kind) -> Mode {
    Mode {
        shape: Shape::Normal,
        top: Top::Fixed(kind.max),
        toggle_a: false,
    }
}
