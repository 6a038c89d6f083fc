//! The results: [`FILE`], little-endian records that begin with 16 bits.
//!
//! | first 16 bits | then | meaning |
//! |---|---|---|
//! | 0xffff | u8 length, so many bytes | the serial line sent them: a frame, or a line of text |
//! | 0xfffe | u32 | the end: bytes of stack at its deepest |
//! | anything else | i32 | the node of that index took this raw word (tapped builds) |
//!
//! A file without the end record is that of a program that did not come to its end.

use core::ffi::CStr;

use semihosting::fs::File;
use semihosting::io::{self, Write};

/// Its name, in the simulator's working folder.
pub const FILE: &CStr = c"replay.out";
/// Begins a sent message.
const SENT: u16 = 0xffff;
/// Begins the last record.
const END: u16 = 0xfffe;
/// Bytes that are written at a time.
const BLOCK: usize = 128;

/// The open file.
pub struct Output {
    file: File,
    block: [u8; BLOCK],
    len: usize,
    /// The first failure: whoever writes a node value cannot return it.
    result: io::Result<()>,
}

impl Output {
    /// Creates it.
    pub fn create() -> io::Result<Self> {
        Ok(Self {
            file: File::create(FILE)?,
            block: [0; BLOCK],
            len: 0,
            result: Ok(()),
        })
    }

    /// A node took a raw word.
    #[cfg(feature = "taps")]
    pub fn node(&mut self, index: usize, raw: i32) {
        self.put(&(index as u16).to_le_bytes());
        self.put(&raw.to_le_bytes());
    }

    /// The serial line sent a message of at most 255 bytes.
    pub fn sent(&mut self, bytes: &[u8]) {
        self.put(&SENT.to_le_bytes());
        self.put(&[bytes.len() as u8]);
        self.put(bytes);
    }

    /// Writes the end; the first failure, if there was one.
    pub fn finish(&mut self, stack_bytes: u32) -> io::Result<()> {
        self.put(&END.to_le_bytes());
        self.put(&stack_bytes.to_le_bytes());
        self.flush();
        core::mem::replace(&mut self.result, Ok(()))
    }

    fn put(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            if self.len == BLOCK {
                self.flush();
            }
            if let Some(slot) = self.block.get_mut(self.len) {
                *slot = byte;
                self.len += 1;
            }
        }
    }

    fn flush(&mut self) {
        if self.result.is_ok() {
            self.result = self.file.write_all(&self.block[..self.len]);
        }
        self.len = 0;
    }
}
