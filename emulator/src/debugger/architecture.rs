//! The AVR as GDB sees it: r0 to r31 and SREG (one byte each), SP (two bytes), PC (four, a byte
//! address). Source: `avr-tdep.c` of GDB, registers 0 to 34.

use std::num::NonZeroUsize;

use gdbstub::arch::{Arch, RegId, Registers};

/// Number of the status register, of SP and of PC.
const SREG: usize = 32;
const SP: usize = 33;
const PC: usize = 34;
/// Bytes of all registers.
const BYTES: usize = 39;

/// The architecture.
#[derive(Debug)]
pub(super) enum Avr {}

impl Arch for Avr {
    type Usize = u32;
    type Registers = AvrRegisters;
    type BreakpointKind = usize;
    type RegId = Register;
}

/// All registers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct AvrRegisters {
    pub(super) general: [u8; 32],
    pub(super) sreg: u8,
    pub(super) sp: u16,
    pub(super) pc: u32,
}

impl Registers for AvrRegisters {
    type ProgramCounter = u32;

    fn pc(&self) -> u32 {
        self.pc
    }

    fn gdb_serialize(&self, mut write_byte: impl FnMut(Option<u8>)) {
        let bytes = self.general.iter().copied().chain([self.sreg]);
        let bytes = bytes
            .chain(self.sp.to_le_bytes())
            .chain(self.pc.to_le_bytes());
        bytes.for_each(|byte| write_byte(Some(byte)));
    }

    fn gdb_deserialize(&mut self, bytes: &[u8]) -> Result<(), ()> {
        let bytes: &[u8; BYTES] = bytes.try_into().map_err(|_| ())?;
        self.general.copy_from_slice(&bytes[..SREG]);
        self.sreg = bytes[SREG];
        self.sp = u16::from_le_bytes([bytes[33], bytes[34]]);
        self.pc = u32::from_le_bytes([bytes[35], bytes[36], bytes[37], bytes[38]]);
        Ok(())
    }
}

/// One register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Register {
    General(u8),
    Sreg,
    Sp,
    Pc,
}

impl RegId for Register {
    fn from_raw_id(id: usize) -> Option<(Register, Option<NonZeroUsize>)> {
        let (register, bytes) = match id {
            0..SREG => (Register::General(id as u8), 1),
            SREG => (Register::Sreg, 1),
            SP => (Register::Sp, 2),
            PC => (Register::Pc, 4),
            _ => return None,
        };
        Some((register, NonZeroUsize::new(bytes)))
    }
}
