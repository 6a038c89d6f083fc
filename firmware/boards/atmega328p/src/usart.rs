//! The serial line: a frame goes out in the background, byte by byte from its interrupt.

use avr_device::atmega328p::{Peripherals, USART0};
use cardan_firmware::hal::Serial;
use cardan_spec::timing;

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
