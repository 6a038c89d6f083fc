//! The EEPROM, which keeps the settings.

use avr_device::atmega328p::EEPROM;
use cardan_firmware::calibration::Settings;
use cardan_firmware::hal::Memory;
use cardan_spec::calibration::LEN;

/// The EEPROM's first 256 bytes.
pub struct Eeprom(pub EEPROM);

impl Memory for Eeprom {
    #[inline(never)]
    fn read(&mut self, address: u8) -> u8 {
        self.wait();
        self.0.eear().write(|w| w.set(address.into()));
        self.0.eecr().write(|w| w.eere().set_bit());
        self.0.eedr().read().bits()
    }

    /// Call with interrupts disabled: the write enable follows the master enable within four cycles
    /// (data sheet, 8.6.3).
    fn write(&mut self, address: u8, byte: u8) {
        self.wait();
        self.0.eear().write(|w| w.set(address.into()));
        self.0.eedr().write(|w| w.set(byte));
        self.0.eecr().write(|w| w.eempe().set_bit());
        self.0.eecr().write(|w| w.eempe().set_bit().eepe().set_bit());
    }
}

impl Eeprom {
    /// Until the byte before is stored.
    fn wait(&self) {
        while self.0.eecr().read().eepe().bit_is_set() {}
    }
}

/// The settings, whose image begins at address 0. Not inlined: the image need not stay on the stack.
#[inline(never)]
pub fn settings(eeprom: &mut Eeprom) -> Settings {
    let mut image = [0; LEN];
    let mut address = 0;
    for byte in &mut image {
        *byte = eeprom.read(address);
        address += 1;
    }
    Settings::from_image(&image)
}
