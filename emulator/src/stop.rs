//! Why a run ended.

use std::fmt;

use crate::contexts::sreg_names;

/// Why [`crate::Machine::run`] returned.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The cycle limit is reached.
    Limit,
    /// SLEEP with interrupts disabled and no watchdog that could wake the chip (or, in a run
    /// without a limit, asleep with no event left to come).
    Sleep,
    /// BREAK without a debugger. The program counter stands behind it.
    Break,
    /// A jump to itself with interrupts disabled. Cycle and program counter are those of the
    /// first arrival; bytes in the transmitter have been delivered.
    Halt,
    /// The environment asked for it.
    Requested,
    /// The program did what the chip cannot do, or what is not modelled.
    Crash(Crash),
}

/// A crash and its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Crash {
    /// Byte address of the instruction.
    pub pc: u32,
    /// The instruction, disassembled.
    pub instruction: String,
    /// What happened.
    pub cause: Cause,
}

/// What went wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The word is not an instruction of this chip.
    InvalidOpcode {
        /// The word.
        word: u16,
    },
    /// A push or pop outside SRAM.
    StackOutOfMemory {
        /// Stack pointer before the access.
        sp: u16,
    },
    /// A jump, call or return beyond the end of flash.
    PcOutOfMemory {
        /// Byte address of the target.
        target: u32,
    },
    /// A load or store beyond the end of SRAM.
    BadAddress {
        /// Data address.
        address: u16,
        /// Whether it was a store.
        is_store: bool,
    },
    /// The program uses a function of the chip that the emulator does not model.
    NotModelled {
        /// Name of the register.
        register: &'static str,
        /// The function.
        what: &'static str,
    },
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Cause::InvalidOpcode { word: 0xFFFF } => {
                write!(f, "erased flash (0xffff) executed as an instruction")
            }
            Cause::InvalidOpcode { word } => write!(f, "invalid opcode {word:#06x}"),
            Cause::StackOutOfMemory { sp } => write!(f, "stack outside SRAM (SP = {sp:#06x})"),
            Cause::PcOutOfMemory { target } => {
                write!(f, "jump beyond the end of flash (target {target:#07x})")
            }
            Cause::BadAddress { address, is_store } => {
                let verb = if *is_store { "store to" } else { "load from" };
                write!(
                    f,
                    "{verb} data address {address:#06x}, beyond the end of SRAM"
                )
            }
            Cause::NotModelled { register, what } => {
                write!(f, "{what} ({register}) is not modelled by this emulator")
            }
        }
    }
}

impl fmt::Display for Crash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "at {:#06x} `{}`: {}",
            self.pc, self.instruction, self.cause
        )
    }
}

/// Something odd that the program does; reported once per place, or once per interrupt vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Report {
    /// Byte address of the instruction.
    pub pc: u32,
    /// Data address accessed; 0 where the kind has none.
    pub address: u16,
    /// What is odd about the access.
    pub kind: ReportKind,
}

/// Kind of a [`Report`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReportKind {
    /// Read where the chip has no register; it reads 0.
    ReadReserved,
    /// Write where the chip has no register; it has no effect.
    WriteReserved,
    /// A reserved setting of a register.
    ReservedSetting,
    /// Access to a module that PRR has switched off.
    PoweredDown,
    /// SPM outside the boot section has no effect.
    SpmOutsideBootSection,
    /// UDR0 written while the transmitter is off: the byte waits until TXEN is set.
    TransmitterOff,
    /// An interrupt handler returned with other registers or another SREG than it found, for the
    /// first time; [`crate::Machine::interrupt_damage`] tells more.
    InterruptDamage {
        /// Name of the vector.
        vector: &'static str,
        /// Registers changed: bit n is rn.
        registers: u32,
        /// Bits of SREG changed.
        sreg: u8,
    },
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self.kind {
            ReportKind::ReadReserved => "read of an address without a register",
            ReportKind::WriteReserved => "write to an address without a register",
            ReportKind::ReservedSetting => "reserved setting of the register",
            ReportKind::SpmOutsideBootSection => "SPM outside the boot section has no effect",
            ReportKind::TransmitterOff => "write while the transmitter is off (TXEN = 0): it waits",
            ReportKind::PoweredDown => "access to a module switched off in PRR",
            ReportKind::InterruptDamage {
                vector,
                registers,
                sreg,
            } => return show_damage(f, self.pc, vector, registers, sreg),
        };
        write!(
            f,
            "at {:#06x}: {what} (data address {:#04x})",
            self.pc, self.address
        )
    }
}

fn show_damage(
    f: &mut fmt::Formatter<'_>,
    pc: u32,
    vector: &str,
    registers: u32,
    sreg: u8,
) -> fmt::Result {
    write!(
        f,
        "at {pc:#06x}: interrupt {vector} does not return what it found:"
    )?;
    let mut separator = "";
    for number in (0..32).filter(|number| registers >> number & 1 != 0) {
        write!(f, "{separator} r{number}")?;
        separator = ",";
    }
    if sreg != 0 {
        write!(f, "{separator} SREG ({})", sreg_names(sreg))?;
    }
    write!(f, " changed")
}
