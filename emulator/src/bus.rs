//! The I/O bus: register addresses to peripherals.
//!
//! `at` is the cycle of the access; events up to it have been carried out. A write takes effect
//! at the edge that ends its cycle.

use crate::environment::Environment;
use crate::machine::Machine;
use crate::peripherals::timer::Register;
use crate::registers as io;
use crate::stop::{Cause, Report, ReportKind};
use crate::system::power;

/// Power reduction bit of each timer.
const TIMER_POWER: [u8; 3] = [power::TIMER0, power::TIMER1, power::TIMER2];

/// Timer and register at a data address.
pub(crate) fn timer_register(address: u16) -> Option<(usize, Register)> {
    Some(match address {
        io::TIFR0 => (0, Register::Flags),
        io::TIFR1 => (1, Register::Flags),
        io::TIFR2 => (2, Register::Flags),
        io::TIMSK0 => (0, Register::Mask),
        io::TIMSK1 => (1, Register::Mask),
        io::TIMSK2 => (2, Register::Mask),
        io::TCCR0A => (0, Register::ControlA),
        io::TCCR0B => (0, Register::ControlB),
        io::TCNT0 => (0, Register::CountLow),
        io::OCR0A => (0, Register::CompareLow(0)),
        io::OCR0B => (0, Register::CompareLow(1)),
        io::TCCR1A => (1, Register::ControlA),
        io::TCCR1B => (1, Register::ControlB),
        io::TCCR1C => (1, Register::ControlC),
        io::TCNT1L => (1, Register::CountLow),
        io::TCNT1H => (1, Register::CountHigh),
        io::ICR1L => (1, Register::CaptureLow),
        io::ICR1H => (1, Register::CaptureHigh),
        io::OCR1AL => (1, Register::CompareLow(0)),
        io::OCR1AH => (1, Register::CompareHigh(0)),
        io::OCR1BL => (1, Register::CompareLow(1)),
        io::OCR1BH => (1, Register::CompareHigh(1)),
        io::TCCR2A => (2, Register::ControlA),
        io::TCCR2B => (2, Register::ControlB),
        io::TCNT2 => (2, Register::CountLow),
        io::OCR2A => (2, Register::CompareLow(0)),
        io::OCR2B => (2, Register::CompareLow(1)),
        _ => return None,
    })
}

impl Machine {
    /// Reads the I/O register at a data address.
    pub(crate) fn read_io<E: Environment>(&mut self, address: u16, at: u64, env: &mut E) -> u8 {
        if let Some((number, register)) = timer_register(address) {
            self.sync_timer(number, at, env);
            return self.timers[number].read(register);
        }
        if self.is_powered_down(address) {
            self.report(address, ReportKind::PoweredDown);
            return 0;
        }
        match address {
            io::PINB..=io::PORTD => self.read_port(address, at, env),
            io::GPIOR0 => self.system.gpior[0],
            io::GPIOR1 => self.system.gpior[1],
            io::GPIOR2 => self.system.gpior[2],
            io::EECR..=io::EEARH => self.eeprom.read(address, at),
            io::GTCCR => self.read_gtccr(),
            io::PCIFR | io::EIFR | io::EIMSK | io::PCICR | io::EICRA | io::PCMSK0..=io::PCMSK2 => {
                self.external.read(address)
            }
            io::SPCR => self.spi.read_control(),
            io::SPSR => self.spi.read_status(),
            io::SPDR => {
                let byte = self.spi.read_data();
                self.after_spi(at, env);
                byte
            }
            io::ACSR => {
                let output = self.comparison(at, env);
                self.comparator.begin(output);
                self.compare_inputs(at, env);
                self.comparator.read()
            }
            io::SPMCSR => self.spm.read(at),
            io::WDTCSR => self.watchdog.read(at),
            io::TWBR..=io::TWAMR => self.twi.read(address - io::TWBR),
            io::ASSR => 0,
            io::SMCR => self.system.smcr,
            io::MCUSR => self.system.mcusr,
            io::MCUCR => self.system.mcucr,
            io::SPL => self.core.sp as u8,
            io::SPH => (self.core.sp >> 8) as u8,
            io::SREG => self.core.flags.sreg(),
            io::CLKPR => self.system.read_clkpr(at),
            io::PRR => self.system.prr,
            io::OSCCAL => self.system.osccal,
            io::ADCL => self.adc.read_low(),
            io::ADCH => self.adc.read_high(),
            io::ADCSRA => self.adc.read_control(),
            io::ADCSRB => self.adc.trigger_select(),
            io::ADMUX => self.adc.mux(),
            io::DIDR0 => self.system.didr[0],
            io::DIDR1 => self.system.didr[1],
            io::UCSR0A..=io::UDR0 => self.read_usart(address, at),
            _ => self.read_unmodelled(address),
        }
    }

    /// Writes the I/O register at a data address with effect at cycle `edge`.
    pub(crate) fn write_io<E: Environment>(
        &mut self,
        address: u16,
        value: u8,
        edge: u64,
        env: &mut E,
    ) {
        if let Some((number, register)) = timer_register(address) {
            self.write_timer(number, register, value, edge, env);
            return;
        }
        if self.is_powered_down(address) {
            self.report(address, ReportKind::PoweredDown);
            return;
        }
        match address {
            io::PINB..=io::PORTD => self.write_port(address, value, edge, env),
            io::GPIOR0 => {
                self.system.gpior[0] = value;
                let end = usize::from(self.device.ram_end());
                env.strobe(edge, value, &self.core.data[..=end]);
            }
            io::GPIOR1 => self.system.gpior[1] = value,
            io::GPIOR2 => self.system.gpior[2] = value,
            io::EECR..=io::EEARH => {
                let hz = self.frequency_hz();
                let is_blocked = self.spm.is_busy();
                self.stall += self.eeprom.write(address, value, edge, hz, is_blocked);
                self.after_eeprom(edge);
            }
            io::GTCCR => self.write_gtccr(value, edge, env),
            io::SMCR => self.system.smcr = value & 0x0F,
            io::MCUSR => {
                self.system.mcusr &= value;
                let is_forced = self.watchdog_is_forced();
                self.watchdog.force(is_forced);
                self.after_watchdog(edge);
            }
            io::MCUCR => {
                self.system.write_mcucr(value, edge);
                self.look_at_pins(edge, env);
            }
            io::SPL => self.core.sp = self.core.sp & 0xFF00 | u16::from(value),
            io::SPH => self.core.sp = self.core.sp & 0x00FF | u16::from(value) << 8,
            io::SREG => self.set_sreg_delayed(value),
            io::CLKPR => self.write_clkpr(value, edge, env),
            io::PCIFR | io::EIFR | io::EIMSK | io::PCICR | io::EICRA | io::PCMSK0..=io::PCMSK2 => {
                self.external.write(address, value);
                self.update_watch(edge, env);
                self.after_external(edge, env);
            }
            io::SPCR..=io::SPDR => self.write_spi(address, value, edge, env),
            io::ACSR => self.write_comparator(value, edge, env),
            io::SPMCSR => {
                self.spm.write(value, edge);
                self.after_spm(edge);
            }
            io::WDTCSR => {
                self.watchdog.write(value, edge);
                self.after_watchdog(edge);
            }
            io::TWBR..=io::TWAMR => {
                self.twi.write(address - io::TWBR, value, edge);
                self.after_twi(edge);
            }
            io::PRR => self.write_power(value, edge, env),
            io::OSCCAL => self.system.osccal = value,
            io::ADCL | io::ADCH => {}
            io::ADCSRA | io::ADCSRB | io::ADMUX => self.write_adc(address, value, edge, env),
            io::DIDR0 => self.system.didr[0] = value,
            io::DIDR1 => self.system.didr[1] = value & 3,
            io::UCSR0A..=io::UDR0 => self.write_usart(address, value, edge, env),
            _ => self.write_unmodelled(address, value),
        }
    }

    /// Whether the register belongs to a serial module that PRR has switched off.
    fn is_powered_down(&self, address: u16) -> bool {
        let module = match address {
            io::UCSR0A..=io::UDR0 => power::USART,
            io::SPCR..=io::SPDR => power::SPI,
            io::TWBR..=io::TWAMR => power::TWI,
            _ => return false,
        };
        self.system.is_off(module)
    }

    /// Notes an odd access once per place.
    pub(crate) fn report(&mut self, address: u16, kind: ReportKind) {
        let report = Report {
            pc: self.pc(),
            address,
            kind,
        };
        if !self.reports.contains(&report) {
            self.reports.push(report);
        }
    }

    fn read_unmodelled(&mut self, address: u16) -> u8 {
        if self.device.register_name(address).is_none() {
            self.report(address, ReportKind::ReadReserved);
        }
        // Flags of a module that is switched off are clear.
        0
    }

    /// Registers of what is not modelled (asynchronous Timer2): zero switches it off.
    fn write_unmodelled(&mut self, address: u16, value: u8) {
        let Some(register) = self.device.register_name(address) else {
            self.report(address, ReportKind::WriteReserved);
            return;
        };
        if value != 0 {
            self.fault = Some(Cause::NotModelled {
                register,
                what: "the function of this register",
            });
        }
    }

    fn read_port<E: Environment>(&mut self, address: u16, at: u64, env: &mut E) -> u8 {
        let port = usize::from(address - io::PINB) / 3;
        match (address - io::PINB) % 3 {
            0 => self.read_pins(port, at, env),
            1 => self.ports[port].ddr,
            _ => self.ports[port].port,
        }
    }

    fn write_port<E: Environment>(&mut self, address: u16, value: u8, edge: u64, env: &mut E) {
        let port = usize::from(address - io::PINB) / 3;
        // Port C has seven pins; writes to bit 7 have no effect.
        let value = if port == 1 { value & 0x7F } else { value };
        match (address - io::PINB) % 3 {
            0 => self.ports[port].port ^= value,
            1 => self.ports[port].ddr = value,
            _ => self.ports[port].port = value,
        }
        self.update_port(port, edge, env);
    }

    fn write_timer<E: Environment>(
        &mut self,
        number: usize,
        register: Register,
        value: u8,
        edge: u64,
        env: &mut E,
    ) {
        self.fire_events(edge, env);
        self.sync_timer(number, edge, env);
        if self.system.is_off(TIMER_POWER[number]) {
            self.report(0, ReportKind::PoweredDown);
            return;
        }
        self.timers[number].write(register, value);
        self.after_timer(number, edge, env);
        if register == Register::ControlB {
            self.update_watch(edge, env);
        }
        if self.timers[number].is_reserved_mode() {
            self.report(0, ReportKind::ReservedSetting);
        }
    }

    fn read_gtccr(&self) -> u8 {
        let sync = u8::from(self.prescaler_sync.is_held());
        let t2 = u8::from(self.prescaler_t2.is_held());
        (sync | t2) << 7 | t2 << 1 | sync
    }

    /// GTCCR: bit 7 TSM, bit 1 PSRASY, bit 0 PSRSYNC.
    fn write_gtccr<E: Environment>(&mut self, value: u8, edge: u64, env: &mut E) {
        self.fire_events(edge, env);
        for number in 0..3 {
            self.sync_timer(number, edge, env);
        }
        let hold = value & 0x80 != 0;
        for (bit, prescaler) in [(1, &mut self.prescaler_sync), (2, &mut self.prescaler_t2)] {
            if !hold {
                prescaler.release(edge);
            }
            if value & bit != 0 {
                prescaler.reset(edge, hold);
            }
        }
        for number in 0..3 {
            self.after_timer(number, edge, env);
        }
    }

    /// The interrupt vectors begin at 0 or at the boot section (IVSEL).
    pub(crate) fn vector_base(&self) -> u16 {
        if self.system.mcucr & 2 != 0 {
            self.boot_start()
        } else {
            0
        }
    }

    fn write_clkpr<E: Environment>(&mut self, value: u8, edge: u64, env: &mut E) {
        let old_hz = self.frequency_hz();
        if self.system.write_clkpr(value, edge) {
            let hz = self.frequency_hz();
            self.watchdog.rescale(edge, old_hz, hz);
            self.eeprom.rescale(edge, old_hz, hz);
            self.after_watchdog(edge);
            self.after_eeprom(edge);
            env.clock_changed(edge, hz);
        }
    }

    fn write_spi<E: Environment>(&mut self, address: u16, value: u8, edge: u64, env: &mut E) {
        self.fire_events(edge, env);
        match address {
            io::SPCR => {
                let is_selected = self.is_selected(edge, env);
                self.spi.write_control(value, is_selected);
                if self.spi.is_slave() && !is_selected {
                    let what = "SPI as a slave";
                    self.fault = Some(Cause::NotModelled {
                        register: "SPCR",
                        what,
                    });
                }
                self.after_spi(edge, env);
            }
            io::SPSR => self.spi.write_status(value),
            _ => self.write_spi_data(value, edge, env),
        }
    }

    fn write_comparator<E: Environment>(&mut self, value: u8, edge: u64, env: &mut E) {
        self.comparator.write(value);
        let output = self.comparison(edge, env);
        self.comparator.begin(output);
        self.compare_inputs(edge, env);
        self.update_watch(edge, env);
    }

    fn write_power<E: Environment>(&mut self, value: u8, edge: u64, env: &mut E) {
        self.fire_events(edge, env);
        for number in 0..3 {
            self.sync_timer(number, edge, env);
        }
        self.system.prr = value & 0xEF;
        for (number, module) in TIMER_POWER.into_iter().enumerate() {
            let off = self.system.is_off(module);
            self.timers[number].freeze(off);
            self.after_timer(number, edge, env);
        }
        let busy_adc = self.adc.is_busy() && self.system.is_off(power::ADC);
        let busy_usart = self.usart.is_sending() && self.system.is_off(power::USART);
        let busy_spi = self.spi.is_busy() && self.system.is_off(power::SPI);
        let busy_twi = self.twi.is_busy() && self.system.is_off(power::TWI);
        if busy_adc || busy_usart || busy_spi || busy_twi {
            let what = "switching off a module that is busy";
            self.fault = Some(Cause::NotModelled {
                register: "PRR",
                what,
            });
        }
    }

    fn write_adc<E: Environment>(&mut self, address: u16, value: u8, edge: u64, env: &mut E) {
        self.fire_events(edge, env);
        if self.system.is_off(power::ADC) {
            self.report(address, ReportKind::PoweredDown);
            return;
        }
        let trigger = self.adc.trigger_source();
        match address {
            io::ADCSRA => self.adc.write_control(value, edge),
            io::ADCSRB => self.adc.write_trigger_select(value),
            _ => self.adc.write_mux(value),
        }
        if address == io::ADMUX && (value >> 6 == 2 || (9..=13).contains(&(value & 15))) {
            self.report(address, ReportKind::ReservedSetting);
        }
        self.after_adc(edge);
        if self.adc.trigger_source() != trigger {
            for number in 0..2 {
                self.sync_timer(number, edge, env);
            }
            self.watch_trigger();
            for number in 0..2 {
                self.after_timer(number, edge, env);
            }
        }
        self.update_trigger(edge, env);
    }

    fn read_usart(&mut self, address: u16, at: u64) -> u8 {
        match address {
            io::UCSR0A => self.usart.read_status(),
            io::UCSR0B => self.usart.read_control_b(),
            io::UCSR0C => self.usart.control_c(),
            io::UBRR0L => self.usart.baud() as u8,
            io::UBRR0H => (self.usart.baud() >> 8) as u8,
            io::UDR0 => {
                let byte = self.usart.read_data();
                self.after_usart(at);
                byte
            }
            _ => self.read_unmodelled(address),
        }
    }

    fn write_usart<E: Environment>(&mut self, address: u16, value: u8, edge: u64, env: &mut E) {
        self.fire_events(edge, env);
        match address {
            io::UCSR0A => self.usart.write_status(value),
            io::UCSR0B => self.usart.write_control_b(value, edge),
            io::UCSR0C => {
                self.usart.write_control_c(value);
                if value & 0xC0 == 0xC0 {
                    let what = "USART as SPI master";
                    self.fault = Some(Cause::NotModelled {
                        register: "UCSR0C",
                        what,
                    });
                }
            }
            io::UBRR0L => self.usart.write_baud(false, value, edge),
            io::UBRR0H => self.usart.write_baud(true, value, edge),
            io::UDR0 => {
                if !self.usart.transmits() {
                    self.report(address, ReportKind::TransmitterOff);
                }
                self.usart.write_data(value, edge);
            }
            _ => self.write_unmodelled(address, value),
        }
        self.after_usart(edge);
        self.update_port(2, edge, env);
    }
}
