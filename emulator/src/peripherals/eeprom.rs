//! EEPROM (data sheet section 8.4): read at once, write in the time of its own oscillator.

use crate::registers::{EEARH, EEARL, EECR, EEDR};

const EERE: u8 = 1;
const EEPE: u8 = 2;
const EEMPE: u8 = 4;
const EERIE: u8 = 8;
/// Programming times by EEPM1:0 in microseconds: erase and write, erase only, write only.
const PROGRAM_US: [u64; 4] = [3400, 1800, 1800, 3400];
/// Cycles within which EEPE must follow EEMPE.
const MASTER_WINDOW: u64 = 4;

/// Cycles for which an access halts the processor before its next instruction.
pub(crate) const READ_HALT: u64 = 4;
/// The same after starting a write.
pub(crate) const WRITE_HALT: u64 = 2;

/// EEPROM contents and control.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Eeprom {
    pub(crate) bytes: Vec<u8>,
    address: u16,
    data: u8,
    control: u8,
    master_until: u64,
    /// End of the programming under way.
    busy_until: Option<u64>,
}

impl Eeprom {
    pub(crate) fn new(size: usize) -> Eeprom {
        Eeprom {
            bytes: vec![0xFF; size],
            address: 0,
            data: 0,
            control: 0,
            master_until: 0,
            busy_until: None,
        }
    }

    /// Reset of the registers; the contents stay, and a write under way is completed.
    pub(crate) fn reset(&mut self) {
        let bytes = std::mem::take(&mut self.bytes);
        *self = Eeprom {
            bytes,
            ..Eeprom::new(0)
        };
    }

    pub(crate) fn next_event(&self) -> Option<u64> {
        self.busy_until
    }

    /// The programming has ended.
    pub(crate) fn finish(&mut self) {
        self.busy_until = None;
    }

    /// The processor clock changes: the time left stays.
    pub(crate) fn rescale(&mut self, at: u64, old_hz: u64, new_hz: u64) {
        if let Some(until) = &mut self.busy_until {
            let left = u128::from(until.saturating_sub(at)) * u128::from(new_hz);
            *until = at + (left / u128::from(old_hz)) as u64;
        }
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.busy_until.is_some()
    }

    /// EE_READY is a level.
    pub(crate) fn requests(&self) -> bool {
        self.control & EERIE != 0 && self.busy_until.is_none()
    }

    pub(crate) fn read(&self, register: u16, at: u64) -> u8 {
        match register {
            EEARL => self.address as u8,
            EEARH => (self.address >> 8) as u8,
            EEDR => self.data,
            _ => {
                let master = if at < self.master_until { EEMPE } else { 0 };
                let busy = if self.busy_until.is_some() { EEPE } else { 0 };
                self.control & 0x38 | master | busy
            }
        }
    }

    /// Writes a register with effect at cycle `at`; returns the cycles the processor halts.
    /// `hz` is the processor clock; `blocked`: SPM is busy, so a write cannot start.
    pub(crate) fn write(
        &mut self,
        register: u16,
        value: u8,
        at: u64,
        hz: u64,
        blocked: bool,
    ) -> u64 {
        let last = self.bytes.len() as u16 - 1;
        match register {
            EEARL => self.address = (self.address & 0xFF00 | u16::from(value)) & last,
            EEARH => self.address = (self.address & 0x00FF | u16::from(value) << 8) & last,
            EEDR => self.data = value,
            EECR => return self.write_control(value, at, hz, blocked),
            _ => {}
        }
        0
    }

    fn write_control(&mut self, value: u8, at: u64, hz: u64, blocked: bool) -> u64 {
        let armed = at <= self.master_until && self.master_until > 0;
        // EEPM can be changed only while nothing is being programmed.
        self.control = value & if self.is_busy() { EERIE } else { EERIE | 0x30 }
            | if self.is_busy() {
                self.control & 0x30
            } else {
                0
            };
        if value & EEPE != 0 && armed && !self.is_busy() && !blocked {
            self.program(at, hz);
            return WRITE_HALT;
        }
        if value & EEMPE != 0 && value & EEPE == 0 {
            self.master_until = at + MASTER_WINDOW;
        }
        if value & EERE != 0 && !self.is_busy() {
            self.data = self.bytes[usize::from(self.address)];
            return READ_HALT;
        }
        0
    }

    fn program(&mut self, at: u64, hz: u64) {
        let mode = usize::from(self.control >> 4 & 3);
        let cell = &mut self.bytes[usize::from(self.address)];
        *cell = match mode {
            1 => 0xFF,
            2 => *cell & self.data,
            _ => self.data,
        };
        self.master_until = 0;
        self.busy_until = Some(at + (PROGRAM_US[mode] * hz).div_ceil(1_000_000));
    }
}
