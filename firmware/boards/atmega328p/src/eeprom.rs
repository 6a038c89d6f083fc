//! Reads the calibration from EEPROM at start-up.

use avr_device::atmega328p::EEPROM;
use cardan_spec::calibration::LEN;

/// The calibration image, from address 0.
pub fn calibration(eeprom: &EEPROM) -> [u8; LEN] {
    let mut image = [0; LEN];
    let mut address: u16 = 0;
    for byte in &mut image {
        eeprom.eear().write(|w| w.set(address));
        eeprom.eecr().write(|w| w.eere().set_bit());
        *byte = eeprom.eedr().read().bits();
        address += 1;
    }
    image
}
