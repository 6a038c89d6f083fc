//! Sleep modes and resets: which clocks stop, what wakes, how long it takes (data sheet
//! sections 10 and 11).

use crate::environment::Environment;
use crate::interrupts::vector;
use crate::machine::Machine;
use crate::observer::{Observer, Pause};
use crate::peripherals::adc::Adc;
use crate::peripherals::comparator::Comparator;
use crate::peripherals::external::{CaptureInput, External};
use crate::peripherals::prescaler::Prescaler;
use crate::peripherals::spi::Spi;
use crate::peripherals::spm::Spm;
use crate::peripherals::timer::Timer;
use crate::peripherals::twi::Twi;
use crate::peripherals::usart::Usart;
use crate::peripherals::watchdog::Watchdog;
use crate::schedule::{Schedule, Source};
use crate::stop::Cause;
use crate::system::System;

/// Cycles for which the processor is halted after the start-up time of a wake-up.
const WAKE_HALT: u64 = 4;
/// Start-up from Standby and Extended Standby, and the clock cycles of a reset.
const STANDBY_CYCLES: u64 = 6;
const RESET_CYCLES: u64 = 14;

/// Sleep modes SM2:0 (table 10-2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SleepMode {
    Idle,
    AdcNoiseReduction,
    /// Power-down, and Power-save without an asynchronous Timer2.
    PowerDown,
    /// Standby and Extended Standby.
    Standby,
}

impl SleepMode {
    fn from_bits(bits: u8) -> Option<SleepMode> {
        match bits {
            0 => Some(SleepMode::Idle),
            1 => Some(SleepMode::AdcNoiseReduction),
            2 | 3 => Some(SleepMode::PowerDown),
            6 | 7 => Some(SleepMode::Standby),
            _ => None,
        }
    }
}

/// Why the chip was reset: the bits of MCUSR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Supply switched on.
    PowerOn = 1,
    /// Pin RESET.
    External = 2,
    /// Supply too low.
    BrownOut = 4,
    /// Watchdog.
    Watchdog = 8,
}

impl Machine {
    /// SLEEP with SE set, at the end of the instruction.
    pub(crate) fn fall_asleep<E: Environment>(&mut self, env: &mut E) -> Result<(), Cause> {
        let Some(mode) = SleepMode::from_bits(self.system.sleep_mode()) else {
            return Err(Cause::NotModelled {
                register: "SMCR",
                what: "a reserved sleep mode",
            });
        };
        let now = self.core.cycle;
        self.fire_events(now, env);
        // SLEEP was the one instruction that follows SEI.
        self.one_more = false;
        self.is_sleeping = true;
        self.statistics.sleeps += 1;
        self.sleep_mode = mode;
        self.asleep_since = now;
        let samples = matches!(mode, SleepMode::Idle | SleepMode::AdcNoiseReduction);
        if samples && self.adc.trigger_source().is_none() {
            self.adc.start(now);
            self.after_adc(now);
        }
        if mode != SleepMode::Idle {
            self.stop_clocks(env);
        }
        Ok(())
    }

    /// Whether the I/O clock stands still.
    pub(crate) fn is_io_stopped(&self) -> bool {
        self.is_sleeping && self.sleep_mode != SleepMode::Idle
    }

    fn stop_clocks<E: Environment>(&mut self, env: &mut E) {
        let now = self.core.cycle;
        for number in 0..3 {
            self.sync_timer(number, now, env);
            self.schedule.set(Source::TIMERS[number], None);
            self.schedule.set_quiet(Source::TIMERS[number], None);
        }
        for source in [
            Source::Capture,
            Source::UsartTransmit,
            Source::SerialLine,
            Source::UsartReceive,
            Source::Spi,
            Source::Twi,
        ] {
            self.schedule.set(source, None);
        }
        if self.sleep_mode != SleepMode::AdcNoiseReduction {
            self.schedule.set(Source::Adc, None);
            self.schedule.set_quiet(Source::Adc, None);
        }
    }

    /// The clocks run again: whatever they drive goes on where it stood.
    fn start_clocks<E: Environment>(&mut self, env: &mut E) {
        let now = self.core.cycle;
        let gap = now - self.asleep_since;
        self.prescaler_sync.shift(gap);
        self.prescaler_t2.shift(gap);
        self.usart.shift(gap);
        self.spi.shift(gap);
        self.twi.shift(gap);
        if self.sleep_mode != SleepMode::AdcNoiseReduction {
            self.adc.shift(gap);
        }
        // A byte that came while the receiver had no clock is lost.
        while self
            .system
            .serial
            .is_some_and(|serial| serial.start_cycle < now)
        {
            self.system.serial = env.uart_rx(now);
        }
        for number in 0..3 {
            self.timers[number].skip_to(now);
            self.after_timer(number, now, env);
        }
        self.after_usart(now);
        self.after_spi(now, env);
        self.after_twi(now);
        self.after_adc(now);
        self.schedule
            .set(Source::Capture, self.capture_input.next_event());
    }

    /// Passes the time asleep up to the next event, or wakes the processor.
    pub(crate) fn sleep_on<E: Environment, O: Observer>(
        &mut self,
        until: u64,
        env: &mut E,
        observer: &mut O,
    ) {
        let now = self.core.cycle;
        observer.pause(Pause::Asleep, self);
        if self.interrupts.pending() & self.wake_mask() != 0 && self.core.flags.interrupts_enabled()
        {
            let was_stopped = self.is_io_stopped();
            self.core.cycle += self.start_up();
            if was_stopped {
                self.start_clocks(env);
            }
            self.statistics.sleeping_cycles += self.core.cycle - now;
            self.is_sleeping = false;
            observer.pause(Pause::Halted, self);
            self.core.cycle += WAKE_HALT;
            return;
        }
        let next = self.schedule.attention().min(until).max(now);
        self.statistics.sleeping_cycles += next - now;
        self.core.cycle = next;
    }

    /// Vectors that wake: those whose module has no clock cannot rise; EE_READY and SPM_READY
    /// can, but wake only from Idle and ADC Noise Reduction.
    fn wake_mask(&self) -> u32 {
        match self.sleep_mode {
            SleepMode::Idle | SleepMode::AdcNoiseReduction => u32::MAX,
            _ => !(1 << vector::EE_READY | 1 << vector::SPM_READY),
        }
    }

    fn start_up(&self) -> u64 {
        match self.sleep_mode {
            SleepMode::Idle | SleepMode::AdcNoiseReduction => 0,
            SleepMode::Standby => STANDBY_CYCLES,
            SleepMode::PowerDown => self.fuses.wake_cycles(),
        }
    }

    /// Resets the chip: registers and peripherals start anew, memories and counters stay. The
    /// program begins after the delay that the fuses give.
    pub fn reset<E: Environment>(&mut self, cause: ResetCause, env: &mut E) {
        let at = self.core.cycle;
        let causes = self.system.mcusr | cause as u8;
        self.core.reset();
        self.core.cycle += self.reset_delay();
        self.interrupts.clear();
        self.contexts.clear();
        self.schedule = Schedule::new();
        let serial = self.system.serial;
        self.system = System::new();
        self.system.mcusr = causes;
        self.system.serial = serial;
        self.prescaler_sync = Prescaler::default();
        self.prescaler_t2 = Prescaler::default();
        self.timers = [Timer::new(0), Timer::new(1), Timer::new(2)];
        self.adc = Adc::new();
        self.usart = Usart::new();
        self.usart.shows_line = env.shows_serial_edges();
        self.eeprom.reset();
        self.comparator = Comparator::default();
        self.external = External::default();
        self.capture_input = CaptureInput::default();
        self.spi = Spi::default();
        self.twi = Twi::new();
        self.spm = Spm::default();
        self.trigger_level = false;
        self.is_sleeping = false;
        self.one_more = false;
        for port in &mut self.ports {
            port.reset();
        }
        self.start_from_fuses();
        env.reset(at, cause);
        let start = self.core.cycle;
        for number in 0..3 {
            self.timers[number].skip_to(start);
        }
        self.prescaler_sync.reset(start, false);
        self.prescaler_t2.reset(start, false);
        self.poll_input(start, env);
    }

    fn reset_delay(&self) -> u64 {
        RESET_CYCLES + self.fuses.reset_delay_us() * self.oscillator_hz / 1_000_000
    }

    /// What fuses and reset flags decide at the start of a program.
    pub(crate) fn start_from_fuses(&mut self) {
        self.system.clock_shift = if self.fuses.divides_clock() { 3 } else { 0 };
        if self.fuses.boots_to_loader() {
            self.core.pc = self.boot_start();
        }
        let is_always_on = self.fuses.watchdog_always_on();
        let is_forced = self.watchdog_is_forced();
        self.watchdog = Watchdog::after_reset(self.core.cycle, is_forced, is_always_on);
        self.after_watchdog(self.core.cycle);
    }

    pub(crate) fn watchdog_is_forced(&self) -> bool {
        self.system.mcusr & ResetCause::Watchdog as u8 != 0 || self.fuses.watchdog_always_on()
    }

    /// First word of the boot section.
    pub(crate) fn boot_start(&self) -> u16 {
        let words = (self.device.flash_bytes / 2) as u32;
        (words - u32::from(self.fuses.boot_words())) as u16
    }
}
