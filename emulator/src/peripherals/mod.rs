//! Peripherals: plain state machines in processor cycles. None of them knows the bus, the
//! environment or another peripheral; [`crate::machine`] wires them.
//!
//! All are lazy: a peripheral knows up to which cycle its state is valid, is brought forward when
//! somebody looks at it, and names the next cycle at which something happens that others can see.
//! A register write in cycle `t` takes effect at the clock edge that ends the cycle, `t + 1`.

pub(crate) mod adc;
pub(crate) mod comparator;
pub(crate) mod eeprom;
pub(crate) mod external;
pub(crate) mod port;
pub(crate) mod prescaler;
pub(crate) mod spi;
pub(crate) mod spm;
pub(crate) mod timer;
pub(crate) mod timer_mode;
#[cfg(test)]
mod timer_tests;
pub(crate) mod twi;
pub(crate) mod usart;
pub(crate) mod watchdog;
