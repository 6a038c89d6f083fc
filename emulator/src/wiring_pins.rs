//! The wiring inside the chip, third part: what comes in through pins. External interrupts,
//! external timer clocks, input capture, analog comparator.

use crate::environment::{AnalogInput, Environment};
use crate::interrupts::vector;
use crate::machine::Machine;
use crate::peripherals::external::Levels;
use crate::peripherals::timer_mode::Clock;
use crate::schedule::Source;

/// Clock inputs T0 and T1 on port D, capture input ICP1 on port B.
const CLOCK_PORT: usize = 2;
const CLOCK_MASKS: [u8; 2] = [0x10, 0x20];
const CAPTURE_PORT: usize = 0;
const CAPTURE_MASK: u8 = 0x01;
/// TCCR1B: noise canceler and edge select.
const ICNC1: u8 = 0x80;
const ICES1: u8 = 0x40;

impl Machine {
    /// Brings the list of watched pins up to date after a register that decides it was written.
    pub(crate) fn update_watch<E: Environment>(&mut self, at: u64, env: &mut E) {
        let mut pins = self.external.interrupt_pins();
        for (number, mask) in CLOCK_MASKS.into_iter().enumerate() {
            if matches!(self.timers[number].clock(), Clock::External(_)) {
                pins[CLOCK_PORT] |= mask;
            }
        }
        if self.timers[1].control_b() != 0 && !self.comparator.drives_capture() {
            pins[CAPTURE_PORT] |= CAPTURE_MASK;
        }
        let old = self.external.watched();
        if pins == old {
            return;
        }
        let levels = self.levels_of(pins, at, env);
        let is_new = pins[CAPTURE_PORT] & !old[CAPTURE_PORT] & CAPTURE_MASK != 0;
        if is_new {
            self.capture_input
                .preset(levels[CAPTURE_PORT] & CAPTURE_MASK != 0);
        }
        self.external.watch(pins, levels);
        for number in 0..3 {
            self.plan_timer(number);
        }
        self.after_external(at, env);
    }

    fn levels_of<E: Environment>(&self, pins: Levels, at: u64, env: &mut E) -> Levels {
        let mut levels = [0; 3];
        for port in 0..3 {
            if pins[port] != 0 {
                levels[port] = self.pin_levels(port, pins[port], at, env);
            }
        }
        levels
    }

    /// Takes the levels of the watched pins into the synchroniser.
    pub(crate) fn look_at_pins<E: Environment>(&mut self, at: u64, env: &mut E) {
        let watched = self.external.watched();
        if watched == [0; 3] {
            return;
        }
        let levels = self.levels_of(watched, at, env);
        self.external.observe(levels, at);
        self.schedule.set(Source::Pins, self.external.next_event());
    }

    /// A change comes out of the synchroniser.
    pub(crate) fn step_pins<E: Environment>(&mut self, at: u64, env: &mut E) {
        let is_clocked = !self.is_io_stopped();
        if let Some((old, new)) = self.external.step(is_clocked)
            && is_clocked
        {
            self.clock_timers(old, new, at, env);
            let change = old[CAPTURE_PORT] ^ new[CAPTURE_PORT];
            let is_capture_pin = self.external.watched()[CAPTURE_PORT] & CAPTURE_MASK != 0;
            if is_capture_pin && change & CAPTURE_MASK != 0 {
                self.capture_level(new[CAPTURE_PORT] & CAPTURE_MASK != 0, at, env);
            }
        }
        self.after_external(at, env);
    }

    /// Edges of T0 and T1 clock the timers that select them.
    fn clock_timers<E: Environment>(&mut self, old: Levels, new: Levels, at: u64, env: &mut E) {
        for (number, mask) in CLOCK_MASKS.into_iter().enumerate() {
            let Clock::External(rising) = self.timers[number].clock() else {
                continue;
            };
            let (was, is) = (old[CLOCK_PORT] & mask != 0, new[CLOCK_PORT] & mask != 0);
            if was != is && is == rising {
                self.sync_timer(number, at, env);
                self.timers[number].external_tick(at);
                self.after_timer(number, at, env);
            }
        }
    }

    /// A new level at the capture unit, from ICP1 or the comparator.
    fn capture_level<E: Environment>(&mut self, level: bool, at: u64, env: &mut E) {
        let has_canceler = self.timers[1].control_b() & ICNC1 != 0;
        let edge = self.capture_input.input(level, at, has_canceler);
        self.schedule
            .set(Source::Capture, self.capture_input.next_event());
        self.capture(edge, at, env);
    }

    /// The noise canceler lets a level through.
    pub(crate) fn step_capture<E: Environment>(&mut self, at: u64, env: &mut E) {
        let edge = self.capture_input.step();
        self.schedule
            .set(Source::Capture, self.capture_input.next_event());
        self.capture(edge, at, env);
    }

    fn capture<E: Environment>(&mut self, edge: Option<bool>, at: u64, env: &mut E) {
        let selected = self.timers[1].control_b() & ICES1 != 0;
        if edge == Some(selected) {
            self.sync_timer(1, at, env);
            self.timers[1].capture();
            self.after_timer(1, at, env);
        }
    }

    pub(crate) fn after_external<E: Environment>(&mut self, at: u64, env: &mut E) {
        for n in 0..2 {
            let requests = self.external.int_requests(n);
            self.interrupts.request(vector::INT0 + n, requests, at);
        }
        for group in 0..3 {
            let requests = self.external.change_requests(group);
            self.interrupts
                .request(vector::PCINT0 + group, requests, at);
        }
        self.schedule.set(Source::Pins, self.external.next_event());
        self.update_trigger(at, env);
    }

    /// Compares the inputs of the analog comparator as they are at cycle `at`.
    pub(crate) fn compare_inputs<E: Environment>(&mut self, at: u64, env: &mut E) {
        let output = self.comparison(at, env);
        if self.comparator.compare(output) && self.comparator.drives_capture() {
            let level = self.comparator.output();
            self.capture_level(level, at, env);
        }
        self.after_comparator(at, env);
    }

    /// The comparator's output: positive input above the negative one.
    pub(crate) fn comparison<E: Environment>(&self, at: u64, env: &mut E) -> bool {
        let positive = match self.comparator.uses_bandgap() {
            true => self.supply.bandgap_volts,
            false => {
                let volts = env.analog(at, AnalogInput::Ain0);
                self.at_pin(AnalogInput::Ain0, volts, at, env)
            }
        };
        let has_mux = self.adc.trigger_select() & 0x40 != 0 && !self.adc.is_enabled();
        let negative = match has_mux {
            true => self.analog_input(self.adc.mux() & 7, at, env).1,
            false => {
                let volts = env.analog(at, AnalogInput::Ain1);
                self.at_pin(AnalogInput::Ain1, volts, at, env)
            }
        };
        positive > negative
    }

    pub(crate) fn after_comparator<E: Environment>(&mut self, at: u64, env: &mut E) {
        self.interrupts
            .request(vector::ANALOG_COMP, self.comparator.requests(), at);
        self.update_trigger(at, env);
    }
}
