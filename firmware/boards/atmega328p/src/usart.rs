//! The serial line: a frame goes out in the background, byte by byte from its interrupt.

use avr_device::atmega328p::{Peripherals, USART0};
use cardan_firmware::exchange;
use cardan_firmware::hal::{Bytes, Serial};
use cardan_spec::timing;

use crate::eeprom::Eeprom;
use crate::watchdog;

/// Longest message: a text line.
const CAPACITY: usize = cardan_firmware::frame::TEXT_LEN;

struct Outgoing {
    bytes: [u8; CAPACITY],
    next: u8,
    len: u8,
}

static mut OUTGOING: Outgoing = Outgoing { bytes: [0; CAPACITY], next: 0, len: 0 };

/// 115200 8N1 with double speed; transmitter and receiver on.
pub fn initialise(usart: &USART0) {
    usart.ubrr0().write(|w| unsafe { w.bits(timing::UBRR) });
    usart.ucsr0a().write(|w| w.u2x0().set_bit());
    usart.ucsr0c().write(|w| w.ucsz0().chr8());
    usart.ucsr0b().write(|w| w.txen0().set_bit().rxen0().set_bit());
}

/// The line as the main loop sees it.
pub struct Line;

impl Serial for Line {
    fn send(&mut self, bytes: &[u8]) -> bool {
        // SAFETY: the interrupt is the only other user of OUTGOING, and it is enabled only below,
        // once the message is complete, and disables itself after the last byte.
        let usart = unsafe { Peripherals::steal() }.USART0;
        if usart.ucsr0b().read().udrie0().bit_is_set() {
            return false;
        }
        let outgoing = unsafe { &mut *(&raw mut OUTGOING) };
        let mut len = 0;
        for (slot, byte) in outgoing.bytes.iter_mut().zip(bytes) {
            *slot = *byte;
            len += 1;
        }
        outgoing.next = 0;
        outgoing.len = len;
        usart.ucsr0b().write(|w| w.txen0().set_bit().rxen0().set_bit().udrie0().set_bit());
        true
    }

    fn receive(&mut self) -> Option<u8> {
        // SAFETY: only the main loop reads the receiver.
        let usart = unsafe { Peripherals::steal() }.USART0;
        let received = usart.ucsr0a().read().rxc0().bit_is_set();
        received.then(|| usart.udr0().read().bits())
    }

    /// The watchdog restarts the chip, afterwards or when the host falls silent. Not inlined: the image
    /// need not lie on the main loop's stack.
    #[inline(never)]
    fn take_settings(&mut self) {
        // SAFETY: nothing else runs from here on.
        let peripherals = unsafe { Peripherals::steal() };
        while peripherals.USART0.ucsr0b().read().udrie0().bit_is_set() {}
        avr_device::interrupt::disable();
        watchdog::start(&peripherals.WDT);
        exchange::take_settings(self, &mut Eeprom(peripherals.EEPROM));
        loop {}
    }
}

impl Bytes for Line {
    fn read(&mut self) -> u8 {
        loop {
            if let Some(byte) = self.receive() {
                avr_device::asm::wdr();
                return byte;
            }
        }
    }

    fn write(&mut self, byte: u8) {
        // SAFETY: the transmit interrupt is disabled.
        let usart = unsafe { Peripherals::steal() }.USART0;
        while usart.ucsr0a().read().udre0().bit_is_clear() {}
        usart.udr0().write(|w| unsafe { w.bits(byte) });
    }
}

/// The interrupt: one byte, or the end.
#[inline(always)]
pub fn next_byte() {
    // SAFETY: see `Line::send`.
    let outgoing = unsafe { &mut *(&raw mut OUTGOING) };
    let usart = unsafe { Peripherals::steal() }.USART0;
    match outgoing.bytes.get(usize::from(outgoing.next)) {
        Some(&byte) if outgoing.next < outgoing.len => {
            usart.udr0().write(|w| unsafe { w.bits(byte) });
            outgoing.next += 1;
        }
        _ => {
            usart.ucsr0b().write(|w| w.txen0().set_bit().rxen0().set_bit());
        }
    }
}
