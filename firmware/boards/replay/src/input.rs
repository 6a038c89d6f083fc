//! The recorded codes: [`FILE`], little-endian.
//!
//! First the settings as they stand in EEPROM (`cardan_spec::calibration`), then 16-bit items to
//! the end of the file: a conversion (bits 0..=9 the code, bit 15 set if it was triggered late), or,
//! with bit 14 set, a byte that the serial line received (bits 0..=7), or, with bit 13 set, what a third
//! tilt axis at the comparator tells from here on (bits 0..=7: the sign of gravity along body z, 1 upright,
//! -1 upside down). Conversions are of four channels in turn, or of five where the settings say that the
//! third axis is measured.

use core::ffi::CStr;

use cardan_spec::calibration::LEN;
use semihosting::fs::File;
use semihosting::io::{self, Read};

use crate::Recorded;

/// Its name, in the simulator's working folder.
pub const FILE: &CStr = c"replay.in";
/// Marks a conversion that was triggered late.
const LATE: u16 = 1 << 15;
/// Marks a received byte.
const RECEIVED: u16 = 1 << 14;
/// Marks what the comparator tells.
const THIRD_TILT: u16 = 1 << 13;
/// The code's bits.
const CODE: u16 = (1 << 10) - 1;
/// Bytes that are asked for at a time.
const BLOCK: usize = 128;

/// What comes next.
pub enum Item {
    /// A conversion.
    Conversion(Recorded),
    /// A received byte.
    Received(u8),
    /// What the comparator tells.
    ThirdTilt(i8),
}

/// The open file.
pub struct Input {
    file: File,
    block: [u8; BLOCK],
    next: usize,
    len: usize,
}

impl Input {
    /// Opens it.
    pub fn open() -> io::Result<Self> {
        Ok(Self {
            file: File::open(FILE)?,
            block: [0; BLOCK],
            next: 0,
            len: 0,
        })
    }

    /// The settings, which come first.
    pub fn settings(&mut self) -> io::Result<[u8; LEN]> {
        let mut image = [0; LEN];
        for byte in &mut image {
            *byte = self.byte()?.ok_or(io::ErrorKind::UnexpectedEof)?;
        }
        Ok(image)
    }

    /// The next item, none at the end.
    pub fn next(&mut self) -> io::Result<Option<Item>> {
        let Some(low) = self.byte()? else {
            return Ok(None);
        };
        let high = self.byte()?.ok_or(io::ErrorKind::UnexpectedEof)?;
        let word = u16::from_le_bytes([low, high]);
        Ok(Some(if word & RECEIVED != 0 {
            Item::Received(low)
        } else if word & THIRD_TILT != 0 {
            Item::ThirdTilt(low.cast_signed())
        } else {
            Item::Conversion(Recorded {
                code: word & CODE,
                late: word & LATE != 0,
            })
        }))
    }

    fn byte(&mut self) -> io::Result<Option<u8>> {
        if self.next == self.len {
            self.len = self.file.read(&mut self.block)?;
            self.next = 0;
        }
        let byte = self.block.get(self.next).filter(|_| self.next < self.len);
        self.next += usize::from(byte.is_some());
        Ok(byte.copied())
    }
}
