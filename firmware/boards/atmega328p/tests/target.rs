//! On-target tests: the firmware's own code, compiled for the controller, on the controller.
//!
//! Each test's name and result go out on the serial line (115200 8N1, double speed), in the form of
//! Rust's own tests; the program ends at BREAK with the exit code in r24: 0, or 101 if a test failed.
//! `cargo test` runs it in the emulator (see `.cargo/config.toml`).
#![no_std]
#![no_main]
#![feature(asm_experimental_arch)]

mod kernels;
#[path = "../../../tests/target/mod.rs"]
mod target;

use avr_device::atmega328p::{Peripherals, USART0};
use cardan_firmware::calibration::Settings;
use cardan_firmware::frame::{Frame, crc16};
use target::EXPECTED;

/// Exit code of a test program in which a test failed.
const FAILED: u8 = 101;

/// A test: returns whether all is well.
type Test = fn() -> bool;

const TESTS: [(&str, Test); 11] = [
    ("the_checksum_is_the_published_one", checksum),
    ("a_frame_has_the_bytes_of_its_layout", frame),
    ("a_text_line_gives_hundredths_of_degrees", text),
    ("a_calibration_image_is_read_back_and_a_damaged_one_refused", calibration),
    ("products_of_16_bits_equal_the_hosts", || target::products() == EXPECTED.products),
    ("longer_products_equal_the_hosts", || target::long_products() == EXPECTED.long_products),
    ("quotients_equal_the_hosts", || target::quotients() == EXPECTED.quotients),
    ("square_roots_equal_the_hosts", || target::roots() == EXPECTED.roots),
    ("sums_shifts_and_limits_equal_the_hosts", || target::sums() == EXPECTED.sums),
    ("kernels_equal_their_definition", kernels::equal_their_definition),
    ("solutions_of_recorded_codes_equal_the_hosts", solutions),
];

#[avr_device::entry]
fn main() -> ! {
    let Some(peripherals) = Peripherals::take() else { exit(FAILED) };
    let line = Line::new(peripherals.USART0);
    line.say("running ");
    line.number(TESTS.len() as u16);
    line.say(" tests\n");
    let mut failed = 0;
    for (name, test) in TESTS {
        line.say("test ");
        line.say(name);
        let is_good = test();
        line.say(if is_good { " ... ok\n" } else { " ... FAILED\n" });
        failed += u16::from(!is_good);
    }
    line.say(if failed == 0 { "test result: ok. " } else { "test result: FAILED. " });
    line.number(TESTS.len() as u16 - failed);
    line.say(" passed; ");
    line.number(failed);
    line.say(" failed\n");
    line.finish();
    exit(if failed == 0 { 0 } else { FAILED })
}

fn checksum() -> bool {
    crc16(b"123456789") == 0x29b1
}

fn frame() -> bool {
    let frame = Frame {
        sequence: 0x0102,
        averages: [1, -1, 0, 0x7f00, 0],
        third: false,
        angles: [-32768, 256, 0],
        flags: 0x55,
    };
    // Words little endian, COBS, the checksum: by hand and by Python's `binascii.crc_hqx`.
    let wire = [
        4, 2, 1, 1, 3, 0xff, 0xff, 1, 1, 2, 0x7f, 2, 0x80, 2, 1, 1, 2, 0x55, 3, 0x29, 0x67, 0,
    ];
    frame.encode()[..] == wire
}

fn text() -> bool {
    let frame = Frame {
        sequence: 7,
        averages: [0; 5],
        third: false,
        angles: [16384, -32768, 1],
        flags: 0x41,
    };
    frame.text()[..] == *b"7 9000 -18000 1 0x0041\r\n"
}

fn calibration() -> bool {
    let mut image = target::eeprom();
    let is_read = Settings::from_image(&image) == target::SETTINGS;
    image[20] ^= 1;
    is_read && Settings::from_image(&image).uncalibrated
}

fn solutions() -> bool {
    target::solutions(|number, frame| EXPECTED.frames.get(number) == Some(frame))
}

/// The serial line, polled.
struct Line(USART0);

impl Line {
    fn new(usart: USART0) -> Self {
        usart.ubrr0().write(|w| unsafe { w.bits(16) });
        usart.ucsr0a().write(|w| w.u2x0().set_bit());
        usart.ucsr0b().write(|w| w.txen0().set_bit());
        Self(usart)
    }

    fn byte(&self, byte: u8) {
        while self.0.ucsr0a().read().udre0().bit_is_clear() {}
        self.0.udr0().write(|w| unsafe { w.bits(byte) });
    }

    fn say(&self, text: &str) {
        text.bytes().for_each(|byte| self.byte(byte));
    }

    fn number(&self, number: u16) {
        if number >= 10 {
            self.number(number / 10);
        }
        self.byte(b'0' + (number % 10) as u8);
    }

    /// Waits until the last byte is out.
    fn finish(&self) {
        self.0.ucsr0a().modify(|_, w| w.txc0().set_bit());
        self.byte(b'\n');
        while self.0.ucsr0a().read().txc0().bit_is_clear() {}
    }
}

/// Ends the program: the exit code is in r24 where a C `main` returns it.
fn exit(code: u8) -> ! {
    // SAFETY: nothing runs after BREAK.
    unsafe { core::arch::asm!("cli", "break", "2: rjmp 2b", in("r24") code, options(noreturn)) }
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo) -> ! {
    // SAFETY: whoever had it does not come back.
    let line = Line::new(unsafe { Peripherals::steal() }.USART0);
    line.say("\npanicked");
    if let Some(place) = info.location() {
        line.say(" at ");
        line.say(place.file());
        line.say(":");
        line.number(place.line() as u16);
    }
    line.finish();
    exit(FAILED)
}
