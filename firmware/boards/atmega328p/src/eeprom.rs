//! Reads the settings from EEPROM at start-up.

use avr_device::atmega328p::EEPROM;
use cardan_firmware::calibration::Settings;
use cardan_spec::calibration::LEN;

/// The settings, whose image begins at address 0. Not inlined: the image need not stay on the stack.
#[inline(never)]
pub fn settings(eeprom: &EEPROM) -> Settings {
    let mut image = [0; LEN];
    let mut address: u16 = 0;
    for byte in &mut image {
        eeprom.eear().write(|w| w.set(address));
        eeprom.eecr().write(|w| w.eere().set_bit());
        *byte = eeprom.eedr().read().bits();
        address += 1;
    }
    Settings::from_image(&image)
}
