//! The watchdog: restarts the chip after new settings.

use avr_device::atmega328p::{CPU, WDT};
use cardan_spec::frame;

// WDP = 6: 128 K cycles of its 128 kHz oscillator.
const _: () = assert!(frame::SETTINGS_PAUSE_MS == 1000);

/// Restarts the chip a second after it was last reset (WDR). Call with interrupts disabled: the new
/// value follows the change enable within four cycles (data sheet, 11.9.2).
pub fn start(watchdog: &WDT) {
    avr_device::asm::wdr();
    watchdog.wdtcsr().write(|w| w.wdce().set_bit().wde().set_bit());
    watchdog.wdtcsr().write(|w| w.wde().set_bit().wdpl().cycles_128k());
}

/// Stops it. After a restart by the watchdog it runs on, at its shortest time, until its flag is
/// cleared (data sheet, 11.8).
pub fn stop(cpu: &CPU, watchdog: &WDT) {
    avr_device::asm::wdr();
    cpu.mcusr().write(|w| unsafe { w.bits(0) });
    watchdog.wdtcsr().write(|w| w.wdce().set_bit().wde().set_bit());
    watchdog.wdtcsr().write(|w| unsafe { w.bits(0) });
}
