//! The machine: core, peripherals and their schedule, and what users may ask of it.

use crate::alu::Flags;
use crate::contexts::Contexts;
use crate::core::Core;
use crate::device::Device;
use crate::disassembler::disassemble;
use crate::environment::Pin;
use crate::fuses::Fuses;
use crate::image::Image;
use crate::interrupts::{Interrupts, VectorStatistics};
use crate::peripherals::adc::Adc;
use crate::peripherals::comparator::Comparator;
use crate::peripherals::eeprom::Eeprom;
use crate::peripherals::external::{CaptureInput, External};
use crate::peripherals::port::Port;
use crate::peripherals::prescaler::Prescaler;
use crate::peripherals::spi::Spi;
use crate::peripherals::spm::Spm;
use crate::peripherals::timer::Timer;
use crate::peripherals::twi::Twi;
use crate::peripherals::usart::Usart;
use crate::peripherals::watchdog::Watchdog;
use crate::power::{ResetCause, SleepMode};
use crate::schedule::Schedule;
use crate::stop::{Cause, Crash, Report, Stop};
use crate::system::System;
use crate::traps::Traps;

/// Supply and reference voltages, in volts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Supply {
    /// Analog supply, the ADC reference for REFS = 1.
    pub avcc_volts: f64,
    /// Pin AREF, the ADC reference for REFS = 0.
    pub aref_volts: f64,
    /// On-chip bandgap, nominally 1.1 V: input 14 and the reference for REFS = 3.
    pub bandgap_volts: f64,
}

impl Default for Supply {
    fn default() -> Supply {
        Supply {
            avcc_volts: 5.0,
            aref_volts: 5.0,
            bandgap_volts: 1.1,
        }
    }
}

/// Counters of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Statistics {
    /// Processor cycles since the start.
    pub cycles: u64,
    /// Instructions executed.
    pub instructions: u64,
    /// Cycles spent asleep.
    pub sleeping_cycles: u64,
    /// Times that SLEEP put the processor to sleep.
    pub sleeps: u64,
    /// Lowest stack pointer (stack high-water mark).
    pub lowest_sp: u16,
    /// Per interrupt vector, in the order of [`Device::vectors`].
    pub vectors: Vec<VectorStatistics>,
    /// Completed conversions.
    pub conversions: u64,
    /// Conversions whose result the program never saw: discarded or overwritten unread.
    pub conversions_lost: u64,
    /// Trigger edges that came while a conversion was under way.
    pub triggers_ignored: u64,
    /// Bytes that the transmitter has sent.
    pub uart_bytes: u64,
    /// Changes of level that the chip has driven, by [`Pin::index`]: those that
    /// [`crate::Environment::pin_edge`] reports (so of the serial line only the first, unless
    /// [`crate::Environment::SERIAL_EDGES`] asks for its bits).
    pub pin_edges: [u64; Pin::COUNT],
}

impl Statistics {
    /// Changes of level that the chip has driven on a pin.
    pub fn edges(&self, pin: Pin) -> u64 {
        self.pin_edges[pin.index()]
    }
}

/// One emulated chip. A plain value: a clone is a snapshot.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    pub(crate) device: &'static Device,
    /// Clock of the oscillator, before the clock prescaler.
    pub(crate) oscillator_hz: u64,
    pub(crate) core: Core,
    pub(crate) interrupts: Interrupts,
    pub(crate) contexts: Contexts,
    pub(crate) schedule: Schedule,
    pub(crate) system: System,
    pub(crate) ports: [Port; 3],
    pub(crate) prescaler_sync: Prescaler,
    pub(crate) prescaler_t2: Prescaler,
    pub(crate) timers: [Timer; 3],
    pub(crate) adc: Adc,
    pub(crate) usart: Usart,
    pub(crate) eeprom: Eeprom,
    pub(crate) comparator: Comparator,
    pub(crate) external: External,
    pub(crate) capture_input: CaptureInput,
    pub(crate) spi: Spi,
    pub(crate) twi: Twi,
    pub(crate) watchdog: Watchdog,
    pub(crate) spm: Spm,
    pub(crate) fuses: Fuses,
    pub(crate) supply: Supply,
    /// Level of the selected ADC trigger flag when last looked at.
    pub(crate) trigger_level: bool,
    pub(crate) is_sleeping: bool,
    pub(crate) sleep_mode: SleepMode,
    pub(crate) asleep_since: u64,
    /// One more instruction executes before an interrupt is taken (after SEI and RETI).
    pub(crate) one_more: bool,
    /// Cycles for which the instruction just executed halts the processor.
    pub(crate) stall: u64,
    /// See [`Machine::set_end_at_halt`].
    pub(crate) ends_at_halt: bool,
    pub(crate) fault: Option<Cause>,
    /// A reset to be carried out at the next instruction boundary.
    pub(crate) pending_reset: Option<ResetCause>,
    pub(crate) statistics: Counters,
    pub(crate) reports: Vec<Report>,
    pub(crate) traps: Traps,
}

/// Counters that the core does not keep.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Counters {
    pub(crate) sleeping_cycles: u64,
    pub(crate) sleeps: u64,
    pub(crate) conversions: u64,
    pub(crate) conversions_lost: u64,
    pub(crate) triggers_ignored: u64,
    pub(crate) uart_bytes: u64,
    pub(crate) pin_edges: [u64; Pin::COUNT],
}

impl Machine {
    /// A chip with erased memories, just after power-on, running at `frequency_hz`.
    pub fn new(device: &'static Device, frequency_hz: u64) -> Machine {
        Machine {
            device,
            oscillator_hz: frequency_hz.max(1),
            core: Core::new(device.flash_bytes / 2, device.sram_start, device.sram_bytes),
            interrupts: Interrupts::new(),
            contexts: Contexts::default(),
            schedule: Schedule::new(),
            system: System::new(),
            ports: Default::default(),
            prescaler_sync: Prescaler::default(),
            prescaler_t2: Prescaler::default(),
            timers: [Timer::new(0), Timer::new(1), Timer::new(2)],
            adc: Adc::new(),
            usart: Usart::new(),
            eeprom: Eeprom::new(device.eeprom_bytes),
            comparator: Comparator::default(),
            external: External::default(),
            capture_input: CaptureInput::default(),
            spi: Spi::default(),
            twi: Twi::new(),
            watchdog: Watchdog::default(),
            spm: Spm::default(),
            fuses: Fuses::default(),
            supply: Supply::default(),
            trigger_level: false,
            is_sleeping: false,
            sleep_mode: SleepMode::Idle,
            asleep_since: 0,
            one_more: false,
            stall: 0,
            ends_at_halt: true,
            fault: None,
            pending_reset: None,
            statistics: Counters::default(),
            reports: Vec::new(),
            traps: Traps::default(),
        }
    }

    /// Programs flash and, where the image has them, EEPROM and fuses. Image bytes beyond the device's
    /// memories are refused when the image is read, not here: they are cut off.
    pub fn load(&mut self, image: &Image) {
        let words: Vec<u16> = image
            .flash
            .chunks(2)
            .take(self.device.flash_bytes / 2)
            .map(|pair| u16::from_le_bytes([pair[0], pair.get(1).copied().unwrap_or(0xFF)]))
            .collect();
        self.core.write_flash(0, &words);
        let size = image.eeprom.len().min(self.eeprom.bytes.len());
        self.eeprom.bytes[..size].copy_from_slice(&image.eeprom[..size]);
        if let Some([low, high, extended]) = image.fuses {
            self.set_fuses(Fuses {
                low,
                high,
                extended,
            });
        }
    }

    /// The fuses.
    pub fn fuses(&self) -> Fuses {
        self.fuses
    }

    /// Sets the fuses, before a run: clock division, reset address and watchdog follow them.
    pub fn set_fuses(&mut self, fuses: Fuses) {
        self.fuses = fuses;
        self.start_from_fuses();
    }

    /// The device.
    pub fn device(&self) -> &'static Device {
        self.device
    }

    /// Processor clock in hertz: the oscillator after the clock prescaler.
    pub fn frequency_hz(&self) -> u64 {
        (self.oscillator_hz >> self.system.clock_shift).max(1)
    }

    /// EEPROM contents.
    pub fn eeprom(&self) -> &[u8] {
        &self.eeprom.bytes
    }

    /// EEPROM contents, to be prepared before a run.
    pub fn eeprom_mut(&mut self) -> &mut [u8] {
        &mut self.eeprom.bytes
    }

    /// Data space from address 0 to the end of SRAM: general registers, then I/O space (which
    /// reads 0 here), then SRAM.
    pub fn data(&self) -> &[u8] {
        &self.core.data[..=usize::from(self.device.ram_end())]
    }

    /// Data space, writable (for debuggers and tests). Bytes of the I/O space have no effect.
    pub fn data_mut(&mut self) -> &mut [u8] {
        &mut self.core.data[..=usize::from(self.device.ram_end())]
    }

    /// Program memory as words.
    pub fn flash(&self) -> &[u16] {
        self.core.flash()
    }

    /// Writes program memory at a word address; addresses wrap at the end of flash.
    pub fn write_flash(&mut self, word_address: usize, words: &[u16]) {
        self.core.write_flash(word_address, words);
    }

    /// The 32 general registers.
    pub fn registers(&self) -> &[u8] {
        &self.core.data[..32]
    }

    /// Byte address of the next instruction.
    pub fn pc(&self) -> u32 {
        u32::from(self.core.pc & self.core.pc_mask()) * 2
    }

    /// Sets the byte address of the next instruction (rounded down to a word).
    pub fn set_pc(&mut self, byte_address: u32) {
        self.core.pc = (byte_address / 2) as u16 & self.core.pc_mask();
    }

    /// Stack pointer.
    pub fn sp(&self) -> u16 {
        self.core.sp
    }

    /// Sets the stack pointer.
    pub fn set_sp(&mut self, sp: u16) {
        self.core.sp = sp;
    }

    /// Status register.
    pub fn sreg(&self) -> u8 {
        self.core.flags.sreg()
    }

    /// Sets the status register.
    pub fn set_sreg(&mut self, sreg: u8) {
        self.core.flags = Flags::from_sreg(sreg);
    }

    /// Processor cycles since the start.
    pub fn cycle(&self) -> u64 {
        self.core.cycle
    }

    /// Whether the processor sleeps.
    pub fn is_sleeping(&self) -> bool {
        self.is_sleeping
    }

    /// Supply and reference voltages.
    pub fn supply(&self) -> Supply {
        self.supply
    }

    /// Sets supply and reference voltages.
    pub fn set_supply(&mut self, supply: Supply) {
        self.supply = supply;
    }

    /// Whether a jump to itself with interrupts disabled ends a run with [`Stop::Halt`], as it does
    /// unless this is called. Otherwise time passes there, and peripherals go on (a PWM output needs
    /// no program) until something else ends the run.
    pub fn set_end_at_halt(&mut self, ends: bool) {
        self.ends_at_halt = ends;
    }

    /// Counters since the start.
    pub fn statistics(&self) -> Statistics {
        Statistics {
            cycles: self.core.cycle,
            instructions: self.core.instructions,
            sleeping_cycles: self.statistics.sleeping_cycles,
            sleeps: self.statistics.sleeps,
            lowest_sp: self.core.lowest_sp,
            vectors: self.interrupts.statistics[..self.device.vectors.len()].to_vec(),
            conversions: self.statistics.conversions,
            conversions_lost: self.statistics.conversions_lost,
            triggers_ignored: self.statistics.triggers_ignored,
            uart_bytes: self.statistics.uart_bytes,
            pin_edges: self.statistics.pin_edges,
        }
    }

    /// Odd accesses, once per place, and interrupts that do damage, once per vector, in the order of
    /// their first occurrence.
    pub fn reports(&self) -> &[Report] {
        &self.reports
    }

    /// Disassembles the instruction at a byte address.
    pub fn disassemble_at(&self, byte_address: u32) -> String {
        let flash = self.core.flash();
        let at = byte_address as usize / 2;
        let word = |i: usize| flash[(at + i) & (flash.len() - 1)];
        disassemble(&[word(0), word(1)])
    }

    /// The crash stop for `cause` at the program counter.
    pub(crate) fn crash(&self, cause: Cause) -> Stop {
        let pc = self.pc();
        Stop::Crash(Crash {
            pc,
            instruction: self.disassemble_at(pc),
            cause,
        })
    }
}
