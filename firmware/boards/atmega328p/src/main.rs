//! The attitude sensor on the ATmega328P: interrupts, timers and pins around the shared firmware.
//!
//! Timer1 counts 0..=499 at the CPU clock (CTC, TOP = ICR1) and toggles OC1A (the 16 kHz carrier)
//! and OC1B (the strobe, a quarter period later). The same compare match B triggers the converter,
//! which samples and holds 259 cycles later; its interrupt re-arms the trigger, so that conversions
//! follow each other every 2000 cycles. Timer2 (CTC, TOP = OCR2A, a 128th of the clock) toggles OC2A,
//! the tilt channels' multiplexer, every 16,000 cycles and OC2B 12,032 cycles later, without any
//! instruction. The main loop sleeps until a block's sums are complete.
#![no_std]
#![no_main]
#![feature(abi_avr_interrupt, asm_experimental_arch)]

mod adc;
mod comparator;
mod eeprom;
mod memory;
mod shared;
mod solving;
mod taps;
mod usart;
mod watchdog;

use avr_device::atmega328p::Peripherals;
use cardan_firmware::averaging::Window;
use cardan_firmware::device::{Device, Solver, sample};
use cardan_spec::{ThirdTilt, timing};

use crate::adc::TimerTriggeredAdc;
use crate::taps::{ARITHMETIC, BoardTap};

#[panic_handler]
fn panic(_info: &core::panic::PanicInfo) -> ! {
    avr_device::interrupt::disable();
    loop {
        core::hint::spin_loop();
    }
}

#[avr_device::entry]
fn main() -> ! {
    // Taken once, before any interrupt is enabled: the handlers steal what they own.
    let Some(peripherals) = Peripherals::take() else { loop {} };
    watchdog::stop(&peripherals.CPU, &peripherals.WDT);
    let settings = eeprom::settings(&mut eeprom::Eeprom(peripherals.EEPROM));
    shared::initialise(settings.averaging);
    usart::initialise(&peripherals.USART0);
    let solving = solving::SolvingPin::new(peripherals.PORTB, &peripherals.PORTD);
    // Idle: the clocks of timers, converter and USART run on.
    peripherals.CPU.smcr().write(|w| w.sm().idle().se().set_bit());

    let has_comparator = settings.third_tilt == ThirdTilt::Comparator;
    let mut window = Window::new(&ARITHMETIC, settings.averaging);
    let solver = Solver::new(BoardTap, &settings);
    let mut device = Device::new(solver, usart::Line, solving);
    // Last, so that the first conversion's interrupt does not wait for the start-up.
    adc::initialise(&peripherals.ADC);
    prepare_turns(&peripherals.TC2);
    start_carrier(&peripherals.TC1);
    start_turns(&peripherals.TC2);
    // SAFETY: all state shared with interrupts is initialised above.
    unsafe { avr_device::interrupt::enable() };
    loop {
        if let Some(averages) = window.add(&ARITHMETIC, &shared::wait()) {
            device.solution(&averages, comparator::sign(has_comparator));
        }
    }
}

/// Timer1: mode 12 (CTC, TOP = ICR1), both outputs toggle on compare match, no prescaler. The mode
/// comes first: ICR1 can be written only in a mode that uses it as TOP (data sheet, 16.6.3).
fn start_carrier(timer: &avr_device::atmega328p::TC1) {
    timer.tccr1a().write(|w| w.com1a().match_toggle().com1b().match_toggle());
    timer.tccr1b().write(|w| w.wgm1().set(0b11));
    timer.icr1().write(|w| w.set(timing::HALF_CARRIER_CYCLES as u16 - 1));
    timer.ocr1a().write(|w| w.set(timing::CARRIER_COUNT));
    timer.ocr1b().write(|w| w.set(timing::STROBE_COUNT));
    timer.tccr1b().write(|w| w.wgm1().set(0b11).cs1().direct());
}

/// Timer2: mode 2 (CTC, TOP = OCR2A), both outputs toggle on compare match, no clock yet.
fn prepare_turns(timer: &avr_device::atmega328p::TC2) {
    timer.ocr2a().write(|w| w.set(timing::SELECT_COUNT));
    timer.ocr2b().write(|w| w.set(timing::SETTLED_COUNT));
    timer.tccr2a().write(|w| w.com2a().match_toggle().com2b().match_toggle().wgm2().ctc());
}

/// Clocks Timer2 by a prescaler that starts anew right after Timer1, so that each turn begins with an
/// edge of the carrier. The reset comes first: a tick before it would count.
#[inline(always)]
fn start_turns(timer: &avr_device::atmega328p::TC2) {
    timer.gtccr().write(|w| w.psrasy().set_bit());
    timer.tccr2b().write(|w| w.cs2().prescale_128());
}

// Conversion complete.
#[avr_device::interrupt(atmega328p)]
fn ADC() {
    // SAFETY: the state is initialised before interrupts are enabled, and the main loop takes its
    // view with interrupts disabled.
    let averager = unsafe { shared::averager() };
    sample(&ARITHMETIC, averager, &mut TimerTriggeredAdc::from_interrupt());
}

// Transmit buffer empty.
#[avr_device::interrupt(atmega328p)]
fn USART_UDRE() {
    usart::next_byte();
}
