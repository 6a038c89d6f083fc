//! The wiring inside the chip, second part: what moves bytes and what keeps them. USART, SPI,
//! TWI, EEPROM, self-programming, watchdog.

use crate::environment::{Environment, Pin};
use crate::interrupts::vector;
use crate::machine::Machine;
use crate::peripherals::spm::{Operation, PROGRAM_US, SpecialRead};
use crate::peripherals::twi::Action;
use crate::peripherals::watchdog::TimeOut;
use crate::power::ResetCause;
use crate::schedule::Source;
use crate::stop::ReportKind;

/// Pin SS, on port B.
const SS: u8 = 2;
/// Byte address where the section begins that cannot be read while it is written.
const NRWW_BYTES: usize = 0x1000;

impl Machine {
    pub(crate) fn after_usart(&mut self, at: u64) {
        let requests = self.usart.requests();
        self.interrupts
            .request(vector::USART_RX, requests.receive, at);
        self.interrupts
            .request(vector::USART_UDRE, requests.empty, at);
        self.interrupts
            .request(vector::USART_TX, requests.transmit, at);
        self.schedule
            .set(Source::UsartTransmit, self.usart.next_event());
        self.schedule
            .set(Source::SerialLine, self.usart.line_event());
        let next_byte = self
            .system
            .serial
            .map(|serial| serial.start_cycle.max(at).max(self.usart.line_free_at()));
        let receive = self.usart.receive_event().or(next_byte);
        self.schedule.set(Source::UsartReceive, receive);
    }

    pub(crate) fn step_transmitter<E: Environment>(&mut self, at: u64, env: &mut E) {
        if let Some(frame) = self.usart.step(at) {
            self.statistics.uart_bytes += 1;
            env.uart_tx(at, frame as u8);
        }
        self.after_usart(at);
        if !self.usart.transmits() {
            self.update_port(2, at, env);
        }
    }

    /// The next bit appears on TXD.
    pub(crate) fn step_line<E: Environment>(&mut self, at: u64, env: &mut E) {
        self.usart.step_line();
        self.schedule
            .set(Source::SerialLine, self.usart.line_event());
        self.update_port(2, at, env);
    }

    /// A frame is complete, or the next one begins.
    pub(crate) fn step_receiver<E: Environment>(&mut self, at: u64, env: &mut E) {
        if self.usart.receive_event().is_some() {
            self.usart.end_receive();
        } else if let Some(serial) = self.system.serial.take() {
            // A byte for a receiver that is switched off is lost, as on the wire.
            self.usart.begin_receive(serial.byte, serial.ninth, at);
        }
        self.poll_serial(at, env);
        self.after_usart(at);
    }

    pub(crate) fn poll_serial<E: Environment>(&mut self, at: u64, env: &mut E) {
        if self.system.serial.is_none() && self.usart.receive_event().is_none() {
            self.system.serial = env.uart_rx(at);
        }
    }

    pub(crate) fn after_spi<E: Environment>(&mut self, at: u64, env: &mut E) {
        self.interrupts
            .request(vector::SPI_STC, self.spi.requests(), at);
        self.schedule.set(Source::Spi, self.spi.next_event());
        self.update_port(0, at, env);
    }

    pub(crate) fn step_spi<E: Environment>(&mut self, at: u64, env: &mut E) {
        self.spi.step();
        self.after_spi(at, env);
    }

    pub(crate) fn write_spi_data<E: Environment>(&mut self, value: u8, at: u64, env: &mut E) {
        let is_selected = self.is_selected(at, env);
        self.spi.check_mode_fault(is_selected);
        self.spi
            .write_data(value, at, |byte| env.spi_exchange(at, byte));
        self.after_spi(at, env);
    }

    /// SS is an input that the outside drives low. A floating pin does not count.
    pub(crate) fn is_selected<E: Environment>(&self, at: u64, env: &mut E) -> bool {
        self.ports[0].ddr >> SS & 1 == 0 && env.pin_level(at, Pin::b(SS)) == Some(false)
    }

    pub(crate) fn after_twi(&mut self, at: u64) {
        self.interrupts
            .request(vector::TWI, self.twi.requests(), at);
        self.schedule.set(Source::Twi, self.twi.next_event());
    }

    pub(crate) fn step_twi<E: Environment>(&mut self, at: u64, env: &mut E) {
        let Some(action) = self.twi.take_action() else {
            return;
        };
        let (mut ack, mut data) = (true, 0);
        match action {
            Action::Start => env.twi_start(at),
            Action::Stop => env.twi_stop(at),
            Action::Address(byte) => ack = env.twi_address(at, byte),
            Action::Write(byte) => ack = env.twi_write(at, byte),
            Action::Read(answer) => data = env.twi_read(at, answer),
        }
        self.twi.finish(action, ack, data, at);
        self.after_twi(at);
    }

    pub(crate) fn after_eeprom(&mut self, at: u64) {
        self.interrupts
            .request(vector::EE_READY, self.eeprom.requests(), at);
        self.schedule.set(Source::Eeprom, self.eeprom.next_event());
    }

    pub(crate) fn finish_eeprom(&mut self, at: u64) {
        self.eeprom.finish();
        self.after_eeprom(at);
    }

    pub(crate) fn after_watchdog(&mut self, at: u64) {
        self.interrupts
            .request(vector::WDT, self.watchdog.requests(), at);
        let hz = self.frequency_hz();
        self.schedule
            .set(Source::Watchdog, self.watchdog.next_event(hz));
    }

    pub(crate) fn time_out(&mut self, at: u64) {
        match self.watchdog.time_out(at) {
            TimeOut::Interrupt => self.after_watchdog(at),
            TimeOut::Reset => {
                self.pending_reset = Some(ResetCause::Watchdog);
                self.schedule.set(Source::Watchdog, None);
            }
        }
    }

    pub(crate) fn after_spm(&mut self, at: u64) {
        self.interrupts
            .request(vector::SPM_READY, self.spm.requests(at), at);
        self.schedule.set(Source::Spm, self.spm.next_event());
        self.core.lpm_in_machine = self.spm.redirects_lpm();
    }

    pub(crate) fn finish_spm(&mut self, at: u64) {
        self.spm.finish();
        self.after_spm(at);
    }

    /// The SPM instruction at the program counter. Works in the boot section only.
    pub(crate) fn self_program(&mut self) {
        let at = self.core.cycle;
        if self.core.pc < self.boot_start() {
            self.report(0, ReportKind::SpmOutsideBootSection);
            return;
        }
        let z = usize::from(self.core.pair(30)) & (self.device.flash_bytes - 1);
        let page_words = self.device.page_bytes / 2;
        match self.spm.operation(at) {
            Operation::Nothing => {}
            Operation::Fill => {
                let word = self.core.pair(0);
                self.spm.buffer.push((z / 2 % page_words, word));
            }
            Operation::EnableRww => self.spm.enable_rww(),
            Operation::Erase => self.program_page(z, &vec![0xFFFF; page_words]),
            Operation::Write => {
                let first = z / 2 / page_words * page_words;
                let mut page = self.core.flash()[first..first + page_words].to_vec();
                for (offset, word) in std::mem::take(&mut self.spm.buffer) {
                    // Programming clears bits only.
                    page[offset] &= word;
                }
                self.program_page(z, &page);
            }
        }
        self.after_spm(at);
    }

    fn program_page(&mut self, z: usize, words: &[u16]) {
        let is_rww = z < self.device.flash_bytes - NRWW_BYTES;
        let time = PROGRAM_US * self.frequency_hz() / 1_000_000;
        self.core
            .write_flash(z / 2 / words.len() * words.len(), words);
        self.spm.begin(self.core.cycle + time, is_rww);
        if !is_rww {
            // The processor executes from the section being programmed: it stands still.
            self.stall += time;
        }
    }

    /// The byte that LPM reads at `z`: program memory, or fuses, lock bits and signature within
    /// three cycles of the write to SPMCSR that asks for them.
    pub(crate) fn load_program_memory(&mut self, z: u16) -> u8 {
        let special = self.spm.special_read(self.core.cycle);
        self.core.lpm_in_machine = false;
        match special {
            None => self.core.flash_byte(z),
            Some(SpecialRead::FuseOrLock) => match z {
                0 => self.fuses.low,
                1 => 0xFF,
                2 => self.fuses.extended,
                _ => self.fuses.high,
            },
            Some(SpecialRead::Signature) => match z {
                1 => self.system.osccal,
                _ => self.device.signature[usize::from(z / 2).min(2)],
            },
        }
    }
}
