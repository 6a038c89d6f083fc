//! Cycle-accurate emulator of an 8-bit AVR microcontroller (ATmega328P).
//!
//! A [`Machine`] is one chip: core, memories, peripherals and a schedule of coming events, all in
//! processor cycles. It does no I/O and is a plain value: a clone is a snapshot, and the same
//! inputs give the same outputs on every host. The world around it is an [`Environment`]: it
//! receives pin edges, serial bytes, conversions and strobes with their cycles, and is asked for
//! pin levels and analog voltages at the exact cycle at which the chip looks.
//!
//! ```
//! use cardan_emulator::{ATMEGA328P, Environment, Machine, Stop};
//!
//! #[derive(Default)]
//! struct Terminal(Vec<u8>);
//! impl Environment for Terminal {
//!     fn uart_tx(&mut self, _cycle: u64, byte: u8) {
//!         self.0.push(byte);
//!     }
//! }
//!
//! let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
//! // ldi r16, 8; sts UCSR0B, r16; ldi r16, 'A'; sts UDR0, r16; rjmp .-2
//! machine.write_flash(0, &[0xE008, 0x9300, 0x00C1, 0xE401, 0x9300, 0x00C6, 0xCFFF]);
//! let mut terminal = Terminal::default();
//! assert_eq!(machine.run(&mut terminal, 1_000_000), Stop::Halt);
//! assert_eq!((terminal.0.as_slice(), machine.cycle()), (&b"A"[..], 6));
//! ```
//!
//! Timing rules follow the data sheet (DS40002061) and the instruction set manual (DS40002198);
//! each peripheral's file names its sections and says what is not modelled. A program that uses
//! what is not modelled stops with [`Cause::NotModelled`]: nothing is silently wrong.

mod alu;
mod bus;
mod contexts;
mod core;
mod debugger;
mod device;
mod disassembler;
mod elf;
pub mod engine;
mod environment;
mod execute;
mod fuses;
mod fusion;
mod hex;
mod image;
mod interpreter;
mod interrupts;
mod isa;
mod machine;
mod observer;
mod peripherals;
mod power;
mod profile;
mod registers;
mod schedule;
mod stimulus;
mod stop;
mod symbols;
mod system;
mod traps;
mod watch;
mod wiring;
mod wiring_pins;
mod wiring_serial;

pub use contexts::{InterruptDamage, RegisterState};
pub use debugger::{Debugger, SessionError, State};
pub use device::{ATMEGA328P, Device};
pub use disassembler::disassemble;
pub use environment::{
    AnalogInput, Conversion, Environment, ParsePinError, Pin, PortDrive, SerialByte, Unconnected,
};
pub use fuses::Fuses;
pub use image::{Image, LoadError, LoadProblem, Memory, Symbol};
pub use interrupts::VectorStatistics;
pub use machine::{Machine, Statistics, Supply};
pub use observer::Observers;
pub use power::ResetCause;
pub use profile::{
    Distribution, FunctionCost, LineCost, LoadWindow, PlaceCost, Profile, Report as ProfileReport,
    StackPeak, Totals, VectorCost, Window,
};
pub use stimulus::{Stimulus, StimulusError};
pub use stop::{Cause, Crash, Report, ReportKind, Stop};
pub use symbols::{Frame, Function, Row, Symbols, demangle, shortened};
pub use watch::{Change, Watch, Watched};
