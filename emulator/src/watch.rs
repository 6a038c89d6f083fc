//! Watches values while a machine runs: registers and memory, each change at its true cycle.

use crate::alu::Flags;
use crate::core::{Core, DATA};
use crate::machine::Machine;
use crate::observer::Moment;
use crate::peripherals::timer;
use crate::registers as io;

/// A value that can be watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Watched {
    /// Program counter, as byte address.
    ProgramCounter,
    /// Stack pointer.
    StackPointer,
    /// Status register.
    Status,
    /// Bytes of the data space from `address` on: general registers (0 to 31) or SRAM, the least
    /// significant first.
    Memory {
        /// Data address of the first byte.
        address: u16,
        /// Number of bytes, 1 to 8.
        bytes: u8,
    },
    /// An I/O register that keeps what the program writes ([`Machine::stored_register`]), or two
    /// of them, the least significant first.
    Register {
        /// Data address of the first.
        address: u16,
        /// Number of registers, 1 or 2.
        bytes: u8,
    },
}

/// A watched value has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// Cycle at whose beginning the new value is there.
    pub cycle: u64,
    /// Which of the watched values.
    pub index: usize,
    /// The new value.
    pub value: u64,
}

/// Notes the changes of some values ([`Machine::run_observed`]). What an instruction writes is
/// there at the end of the instruction.
#[derive(Clone, Debug)]
pub struct Watch {
    watched: Vec<Watched>,
    values: Vec<u64>,
    changes: Vec<Change>,
}

impl Watch {
    /// Watches `values` from now on.
    pub fn new(values: Vec<Watched>, machine: &Machine) -> Watch {
        let mut watch = Watch {
            values: vec![0; values.len()],
            watched: values,
            changes: Vec::new(),
        };
        watch.settled(machine);
        watch.changes.clear();
        watch
    }

    /// The values now, in the order in which they were given.
    pub fn values(&self) -> &[u64] {
        &self.values
    }

    /// The changes since the last call, in the order of their cycles.
    pub fn take_changes(&mut self) -> Vec<Change> {
        std::mem::take(&mut self.changes)
    }

    #[inline]
    pub(crate) fn instruction(&mut self, moment: &Moment<'_>) {
        for index in 0..self.watched.len() {
            let state = State {
                pc: moment.pc,
                sp: moment.sp,
                flags: moment.flags,
                data: moment.data,
            };
            if let Some(value) = state.value(self.watched[index]) {
                self.note(index, value, moment.cycle);
            }
        }
    }

    pub(crate) fn settled(&mut self, machine: &Machine) {
        let core: &Core = &machine.core;
        for index in 0..self.watched.len() {
            let state = State {
                pc: core.pc & core.pc_mask(),
                sp: core.sp,
                flags: core.flags,
                data: &core.data,
            };
            let value = match self.watched[index] {
                Watched::Register { address, bytes } => {
                    let byte = |i: u8| machine.stored_register(address.wrapping_add(i.into()));
                    (0..bytes.min(2))
                        .try_fold(0, |value, i| Some(value | u64::from(byte(i)?) << (8 * i)))
                }
                watched => state.value(watched),
            };
            if let Some(value) = value {
                self.note(index, value, core.cycle);
            }
        }
    }

    #[inline]
    fn note(&mut self, index: usize, value: u64, cycle: u64) {
        let before = std::mem::replace(&mut self.values[index], value);
        if before != value {
            self.changes.push(Change {
                cycle,
                index,
                value,
            });
        }
    }
}

/// What the core holds.
struct State<'a> {
    pc: u16,
    sp: u16,
    flags: Flags,
    data: &'a [u8; DATA],
}

impl State<'_> {
    /// A value of the core; `None` for what the core does not hold.
    #[inline]
    fn value(&self, watched: Watched) -> Option<u64> {
        Some(match watched {
            Watched::ProgramCounter => u64::from(self.pc) * 2,
            Watched::StackPointer => self.sp.into(),
            Watched::Status => self.flags.sreg().into(),
            Watched::Memory { address, bytes } => {
                let byte =
                    |i: u8| u64::from(self.data[usize::from(address.wrapping_add(i.into()))]);
                (0..bytes.min(8)).fold(0, |value, i| value | byte(i) << (8 * i))
            }
            Watched::Register { .. } => return None,
        })
    }
}

impl Machine {
    /// The content of an I/O register that keeps what the program writes to it; `None` for one
    /// that the hardware changes by itself, or whose reading has an effect, and for every other
    /// address. Reading it here has no effect.
    pub fn stored_register(&self, address: u16) -> Option<u8> {
        if let Some((number, register)) = crate::bus::timer_register(address) {
            return self.timers[number].stored(register);
        }
        Some(match address {
            0x24 | 0x27 | 0x2A => self.ports[usize::from(address - 0x24) / 3].ddr,
            0x25 | 0x28 | 0x2B => self.ports[usize::from(address - 0x25) / 3].port,
            io::GPIOR0 => self.system.gpior[0],
            io::GPIOR1 => self.system.gpior[1],
            io::GPIOR2 => self.system.gpior[2],
            io::EIMSK | io::PCICR | io::EICRA | io::PCMSK0..=io::PCMSK2 => {
                self.external.read(address)
            }
            io::SPCR => self.spi.read_control(),
            io::SMCR => self.system.smcr,
            io::MCUCR => self.system.mcucr,
            io::PRR => self.system.prr,
            io::OSCCAL => self.system.osccal,
            io::ADCSRB => self.adc.trigger_select(),
            io::ADMUX => self.adc.mux(),
            io::DIDR0 => self.system.didr[0],
            io::DIDR1 => self.system.didr[1],
            io::UCSR0C => self.usart.control_c(),
            io::UBRR0L => self.usart.baud() as u8,
            io::UBRR0H => (self.usart.baud() >> 8) as u8,
            _ => return None,
        })
    }
}

impl timer::Timer {
    /// A register that the program alone changes.
    fn stored(&self, register: timer::Register) -> Option<u8> {
        use timer::Register;
        Some(match register {
            Register::ControlA
            | Register::ControlB
            | Register::Mask
            | Register::CompareLow(_)
            | Register::CompareHigh(_) => self.clone().read(register),
            _ => return None,
        })
    }
}
