//! What lies outside the chip: pins, analog inputs, serial line, taps.
//!
//! All times are processor cycles since reset. Calls come in the order of their cycles (of two
//! effects in one cycle, in the order in which the chip produces them), except
//! [`Environment::pin_level`], which may look back one cycle (the pin synchroniser).

use std::fmt;
use std::str::FromStr;

use crate::power::ResetCause;

/// A digital pin: port B, C or D and bit.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Pin(u8);

impl Pin {
    /// Pins that [`Pin::index`] numbers.
    pub const COUNT: usize = 24;

    /// Pin `bit` (0 to 7) of port `port` (0: B, 1: C, 2: D); `None` if there is no such pin.
    pub const fn new(port: u8, bit: u8) -> Option<Pin> {
        if port < 3 && bit < 8 {
            Some(Pin(port * 8 + bit))
        } else {
            None
        }
    }

    pub(crate) const fn at(port: usize, bit: u8) -> Pin {
        Pin(port as u8 * 8 + bit)
    }

    /// Port B pin `bit`; `bit` is taken modulo 8.
    pub const fn b(bit: u8) -> Pin {
        Pin(bit & 7)
    }

    /// Port C pin `bit`; `bit` is taken modulo 8.
    pub const fn c(bit: u8) -> Pin {
        Pin(8 + (bit & 7))
    }

    /// Port D pin `bit`; `bit` is taken modulo 8.
    pub const fn d(bit: u8) -> Pin {
        Pin(16 + (bit & 7))
    }

    /// Number of the pin: 8 * port + bit, port 0 being B.
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// Port number, 0 being B.
    pub const fn port(self) -> usize {
        self.0 as usize / 8
    }

    /// Bit within the port.
    pub const fn bit(self) -> u8 {
        self.0 % 8
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "P{}{}", ['B', 'C', 'D'][self.port()], self.bit())
    }
}

impl fmt::Debug for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

/// A text that names no pin.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("`{0}` is not a pin: expected PB0 to PB7, PC0 to PC7 or PD0 to PD7")]
pub struct ParsePinError(String);

impl FromStr for Pin {
    type Err = ParsePinError;

    fn from_str(text: &str) -> Result<Pin, ParsePinError> {
        let bytes = text.as_bytes();
        let found = match bytes {
            [b'P' | b'p', port, bit @ b'0'..=b'7'] => {
                let port = port.to_ascii_uppercase().wrapping_sub(b'B');
                Pin::new(port, bit - b'0')
            }
            _ => None,
        };
        found.ok_or_else(|| ParsePinError(text.to_owned()))
    }
}

/// What a port does to its pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PortDrive {
    /// It drives this level.
    Output(bool),
    /// Its pull-up is on.
    PullUp,
}

/// An input of the analog multiplexer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AnalogInput {
    /// Pin ADC0 to ADC7.
    Pin(u8),
    /// The on-chip temperature sensor.
    Temperature,
    /// The on-chip 1.1 V bandgap reference.
    Bandgap,
    /// 0 V.
    Ground,
    /// Positive input of the analog comparator, pin PD6.
    Ain0,
    /// Negative input of the analog comparator, pin PD7.
    Ain1,
}

/// One finished conversion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conversion {
    /// ADSC was written, the trigger flag rose, or the conversion before ended (free running).
    pub trigger_cycle: u64,
    /// Rising ADC clock edge that began it; multiplexer and reference are locked from here.
    pub start_cycle: u64,
    /// Sample-and-hold instant.
    pub hold_cycle: u64,
    /// ADIF is set and the result readable.
    pub done_cycle: u64,
    /// Input converted.
    pub input: AnalogInput,
    /// Result, 0 to 1023.
    pub code: u16,
    /// Held voltage, in volts.
    pub volts: f64,
    /// Reference voltage, in volts.
    pub reference_volts: f64,
    /// The result was lost: ADCL had been read and ADCH not yet.
    pub discarded: bool,
    /// The result replaced one that the program had not read.
    pub overwrote_unread: bool,
}

/// A byte on its way to the receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SerialByte {
    /// Cycle of the falling edge of the start bit; one that lies in the past counts as now.
    pub start_cycle: u64,
    /// Data bits.
    pub byte: u8,
    /// Ninth data bit, for 9-bit frames.
    pub ninth: bool,
}

/// The world around the chip. Every method has a default that suits an unconnected chip.
///
/// Calls are statically dispatched; an environment pays only for what it overrides.
pub trait Environment {
    /// Whether [`Environment::pin_edge`] shall report every bit of the serial line on pin PD1.
    /// Without it the pin stays high, and a byte costs a tenth of the events.
    const SERIAL_EDGES: bool = false;

    /// The same for an environment that knows it only at run time: asked when a run begins.
    fn shows_serial_edges(&self) -> bool {
        Self::SERIAL_EDGES
    }

    /// An output pin changed to `level` at `cycle`. Pins start low.
    fn pin_edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        let _ = (cycle, pin, level);
    }

    /// Level that the outside drives on a pin during `cycle`; `None`: floating.
    fn pin_level(&mut self, cycle: u64, pin: Pin) -> Option<bool> {
        let _ = (cycle, pin);
        None
    }

    /// Voltage of an analog input in volts, asked at the exact sample-and-hold cycle. The default
    /// is 0 V on the pins and 0.314 V on the temperature sensor (25 degrees, table 24-2).
    fn analog(&mut self, cycle: u64, input: AnalogInput) -> f64 {
        let _ = cycle;
        if input == AnalogInput::Temperature {
            0.314
        } else {
            0.0
        }
    }

    /// A conversion has ended.
    fn conversion(&mut self, event: Conversion) {
        let _ = event;
    }

    /// The trigger flag rose at `cycle` while a conversion was under way: no conversion follows.
    fn trigger_ignored(&mut self, cycle: u64) {
        let _ = cycle;
    }

    /// The stop bit of a transmitted frame ended at `cycle`. `byte` holds data bits 0 to 7.
    fn uart_tx(&mut self, cycle: u64, byte: u8) {
        let _ = (cycle, byte);
    }

    /// Next byte on the receive line, taken out of the environment's queue. Asked when a run
    /// begins, when the frame before is complete and at [`Environment::next_input`].
    fn uart_rx(&mut self, cycle: u64) -> Option<SerialByte> {
        let _ = cycle;
        None
    }

    /// The program wrote `value` to GPIOR0. `data` is the data space from address 0 to the end of
    /// SRAM; I/O registers in it (0x20 to 0xFF) read 0.
    fn strobe(&mut self, cycle: u64, value: u8, data: &[u8]) {
        let _ = (cycle, value, data);
    }

    /// The SPI master begins to send `byte` at `cycle`; the answer is what MISO brings meanwhile.
    /// An open line reads 0xFF.
    fn spi_exchange(&mut self, cycle: u64, byte: u8) -> u8 {
        let _ = (cycle, byte);
        0xFF
    }

    /// A START (or repeated START) on the two-wire bus.
    fn twi_start(&mut self, cycle: u64) {
        let _ = cycle;
    }

    /// The master has sent an address byte (7 bits of address, then 1 for reading). Returns
    /// whether a slave acknowledges.
    fn twi_address(&mut self, cycle: u64, address: u8) -> bool {
        let _ = (cycle, address);
        false
    }

    /// The master has sent a data byte. Returns whether the slave acknowledges.
    fn twi_write(&mut self, cycle: u64, byte: u8) -> bool {
        let _ = (cycle, byte);
        false
    }

    /// The byte that the addressed slave sends; `acknowledged`: the master wants another one.
    fn twi_read(&mut self, cycle: u64, acknowledged: bool) -> u8 {
        let _ = (cycle, acknowledged);
        0xFF
    }

    /// A STOP on the two-wire bus.
    fn twi_stop(&mut self, cycle: u64) {
        let _ = cycle;
    }

    /// The chip's own port drives an analog input, or pulls it up, while its voltage is taken at `cycle`. What
    /// it drives is the voltage then (data sheet, section 14.2.6: the digital driver is not switched off);
    /// what a pull-up of 20 to 50 kilohms makes of the outside's voltage depends on the outside, and is not
    /// computed.
    fn analog_driven(&mut self, cycle: u64, input: AnalogInput, by: PortDrive) {
        let _ = (cycle, input, by);
    }

    /// The processor clock changes to `hz` at `cycle` (clock prescaler). From here on a cycle
    /// lasts 1 / `hz` seconds.
    fn clock_changed(&mut self, cycle: u64, hz: u64) {
        let _ = (cycle, hz);
    }

    /// The chip is reset at `cycle`; all pins become inputs. The program begins later, after the
    /// start-up delay.
    fn reset(&mut self, cycle: u64, cause: ResetCause) {
        let _ = (cycle, cause);
    }

    /// The next cycle after `cycle` at which the environment changes a pin level or a comparator
    /// input, or has a serial byte to offer; `None`: no such change is planned.
    fn next_input(&self, cycle: u64) -> Option<u64> {
        let _ = cycle;
        None
    }

    /// Asks the machine to stop at the next instruction boundary. It is asked when the processor
    /// comes back to the machine; after an edge that no one inside the chip looks at, that may be up
    /// to 4096 cycles later.
    fn stop_requested(&self) -> bool {
        false
    }
}

/// A chip with nothing connected.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unconnected;

impl Environment for Unconnected {}
