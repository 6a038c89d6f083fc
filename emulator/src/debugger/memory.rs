//! The debugger's one address space over the chip's memories.

use std::ops::Range;

use super::chip::Chip;
use crate::environment::Environment;

/// Data space: general registers, I/O registers, SRAM.
pub(super) const DATA: Range<u32> = 0x80_0000..0x81_0000;
const EEPROM: Range<u32> = 0x81_0000..0x82_0000;
const FUSES: u32 = 0x82_0000;

/// An access outside the chip's memories, or one that the chip cannot take.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct NoMemory;

impl<E: Environment> Chip<E> {
    /// Reads from `address` on; returns how many bytes there are.
    pub(super) fn read_memory(&mut self, address: u32, to: &mut [u8]) -> Result<usize, NoMemory> {
        if DATA.contains(&address) {
            return self.read_data((address - DATA.start) as u16, to);
        }
        let fuses = self.machine.fuses();
        let fuses = [fuses.low, fuses.high, fuses.extended];
        let flash: Vec<u8>;
        let (bytes, offset) = if address >= FUSES {
            (&fuses[..], address - FUSES)
        } else if address >= EEPROM.start {
            (self.machine.eeprom(), address - EEPROM.start)
        } else {
            let words = self.machine.flash();
            let first = words.len().min(address as usize / 2);
            let last = words.len().min(first + to.len() / 2 + 2);
            flash = words[first..last]
                .iter()
                .flat_map(|word| word.to_le_bytes())
                .collect();
            (&flash[..], address % 2)
        };
        let there = bytes
            .get(offset as usize..)
            .filter(|there| !there.is_empty());
        let there = there.ok_or(NoMemory)?;
        let count = there.len().min(to.len());
        to[..count].copy_from_slice(&there[..count]);
        Ok(count)
    }

    fn read_data(&mut self, address: u16, to: &mut [u8]) -> Result<usize, NoMemory> {
        let left = (u32::from(self.machine.device().ram_end()) + 1).checked_sub(address.into());
        let left = left.filter(|&left| left > 0).ok_or(NoMemory)?;
        let count = (left as usize).min(to.len());
        let addresses = address..address + count as u16;
        to[..count].copy_from_slice(&self.machine.peek(addresses, &mut self.environment));
        Ok(count)
    }

    /// Writes from `address` on.
    pub(super) fn write_memory(&mut self, address: u32, from: &[u8]) -> Result<(), NoMemory> {
        for (offset, &byte) in (0..).zip(from) {
            let address = address.checked_add(offset).ok_or(NoMemory)?;
            self.write_byte(address, byte)?;
        }
        Ok(())
    }

    fn write_byte(&mut self, address: u32, byte: u8) -> Result<(), NoMemory> {
        if DATA.contains(&address) {
            let address = (address - DATA.start) as u16;
            if address > self.machine.device().ram_end() {
                return Err(NoMemory);
            }
            let written = self.machine.poke(address, byte, &mut self.environment);
            return written.map_err(|_| NoMemory);
        }
        if EEPROM.contains(&address) {
            let cell = self
                .machine
                .eeprom_mut()
                .get_mut((address - EEPROM.start) as usize);
            *cell.ok_or(NoMemory)? = byte;
            return Ok(());
        }
        let index = address as usize / 2;
        let word = *self.machine.flash().get(index).ok_or(NoMemory)?;
        let mut bytes = word.to_le_bytes();
        bytes[address as usize % 2] = byte;
        self.machine
            .write_flash(index, &[u16::from_le_bytes(bytes)]);
        Ok(())
    }
}
