//! The solving pin, and the directions of the pins that timers drive.

use core::convert::Infallible;

use avr_device::atmega328p::{PORTB, PORTD};
use embedded_hal::digital::{ErrorType, OutputPin};

/// PB5: high while a solution is computed.
pub struct SolvingPin {
    port: PORTB,
}

impl SolvingPin {
    /// Makes PB1 (OC1A), PB2 (OC1B), PB3 (OC2A), PD3 (OC2B) and PB5 outputs.
    pub fn new(port: PORTB, other: &PORTD) -> Self {
        port.ddrb()
            .write(|w| w.pb1().set_bit().pb2().set_bit().pb3().set_bit().pb5().set_bit());
        other.ddrd().write(|w| w.pd3().set_bit());
        Self { port }
    }
}

impl ErrorType for SolvingPin {
    type Error = Infallible;
}

impl OutputPin for SolvingPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.port.portb().modify(|_, w| w.pb5().clear_bit());
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.port.portb().modify(|_, w| w.pb5().set_bit());
        Ok(())
    }
}
