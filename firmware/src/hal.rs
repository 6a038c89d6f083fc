//! What the device needs from a board beyond `embedded-hal`.
//!
//! `embedded-hal` 1.0 covers digital pins ([`embedded_hal::digital::OutputPin`] for the solving
//! pin); a converter that is triggered by a timer and a byte-wise serial transmitter it does not.

use cardan_units::AdcCode;

/// A converter whose conversions a timer triggers, seen from its interrupt.
pub trait TriggeredAdc {
    /// The finished conversion's result.
    fn result(&mut self) -> AdcCode;
    /// Chooses the input of the next conversion. Call before it is triggered.
    fn select(&mut self, channel: u8);
    /// Lets the next timer event trigger a conversion again. Returns false if one was missed: the
    /// trigger had fired again before it was re-armed.
    fn rearm(&mut self) -> bool;
}

/// Transmits bytes in the background.
pub trait Serial {
    /// Starts sending `bytes` if nothing is being sent. Returns false (and sends nothing) otherwise.
    fn send(&mut self, bytes: &[u8]) -> bool;
    /// A byte that has been received, if any.
    fn receive(&mut self) -> Option<u8>;
    /// New settings are announced ([`crate::exchange`]). A board that keeps none ignores it, as here.
    fn take_settings(&mut self) {}
}

/// The serial line while nothing else is done: byte by byte, waiting.
pub trait Bytes {
    /// Waits for a byte.
    fn read(&mut self) -> u8;
    /// Waits until `byte` can go out.
    fn write(&mut self, byte: u8);
}

/// Memory that keeps the settings while the power is off.
pub trait Memory {
    /// The byte at `address`.
    fn read(&mut self, address: u8) -> u8;
    /// Waits until `byte` can be stored.
    fn write(&mut self, address: u8, byte: u8);
}
