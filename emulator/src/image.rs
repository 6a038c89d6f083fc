//! Program images: what ELF and Intel HEX files hold for the chip.

use std::path::Path;

use crate::device::Device;
use crate::{elf, hex};

/// Contents of flash and EEPROM with their symbols.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image {
    /// Program memory from byte address 0 to the last byte used; gaps read 0xFF.
    pub flash: Vec<u8>,
    /// EEPROM from address 0 to the last byte given; empty if the file has none.
    pub eeprom: Vec<u8>,
    /// Fuse bytes (low, high, extended), if the file has a `.fuse` section.
    pub fuses: Option<[u8; 3]>,
    /// Named symbols in the order of their addresses; none in a HEX file.
    pub symbols: Vec<Symbol>,
}

/// Memory a symbol lies in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Memory {
    /// Program memory, byte address.
    Flash,
    /// Data space.
    Data,
    /// EEPROM.
    Eeprom,
}

/// A symbol of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Symbol {
    /// Name as in the file (not demangled).
    pub name: String,
    /// Memory it lies in.
    pub memory: Memory,
    /// Address within that memory, in bytes.
    pub address: u32,
    /// Size in bytes, 0 if the file gives none.
    pub size: u32,
}

impl Image {
    /// The symbol called `name`.
    pub fn symbol(&self, name: &str) -> Option<&Symbol> {
        self.symbols.iter().find(|symbol| symbol.name == name)
    }

    /// Reads an image from a file's bytes: ELF if they begin with its magic number, else Intel
    /// HEX. `file` is the name used in messages.
    pub fn parse(file: &str, bytes: &[u8], device: &Device) -> Result<Image, LoadError> {
        let image = if bytes.starts_with(b"\x7fELF") {
            elf::parse(bytes, device)
        } else {
            hex::parse(bytes, device)
        };
        image.map_err(|problem| LoadError {
            file: file.to_owned(),
            problem,
        })
    }

    /// Reads an image file.
    pub fn read(path: &Path, device: &Device) -> Result<Image, LoadError> {
        let file = path.display().to_string();
        match std::fs::read(path) {
            Ok(bytes) => Image::parse(&file, &bytes, device),
            Err(error) => Err(LoadError {
                file,
                problem: LoadProblem::Unreadable(error.to_string()),
            }),
        }
    }
}

/// A file that is no image for the device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {problem}")]
pub struct LoadError {
    /// Name of the file.
    pub file: String,
    /// What is wrong with it.
    pub problem: LoadProblem,
}

/// What is wrong with an image file: place, expectation and mend.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LoadProblem {
    /// The file cannot be read.
    #[error("cannot be read: {0}; check the path and its permissions")]
    Unreadable(String),
    /// The file has no bytes.
    #[error("is empty; expected an ELF file or Intel HEX text: build the program again")]
    Empty,
    /// Neither ELF nor HEX.
    #[error(
        "is neither an ELF file nor Intel HEX text; expected the linker's output (.elf) or `avr-objcopy -O ihex` (.hex)"
    )]
    UnknownFormat,
    /// The ELF structure is broken.
    #[error("is a damaged or truncated ELF file ({0}); build or copy it again")]
    BadElf(String),
    /// Not for an AVR.
    #[error(
        "is an ELF file for machine {0}; expected AVR (83): compile for the chip, for example with `avr-gcc -mmcu=atmega328p`"
    )]
    WrongMachine(u16),
    /// 64-bit or big endian.
    #[error("is not a 32-bit little-endian ELF file, which AVR programs are; compile for the chip")]
    WrongClass,
    /// Object file or library.
    #[error("is not linked (ELF type {0}); expected an executable: pass it through the linker")]
    NotExecutable(u16),
    /// Nothing to program into flash.
    #[error("holds nothing for the program memory; expected at least one loadable section")]
    NoProgram,
    /// Does not fit.
    #[error(
        "{memory} is too small: the file needs bytes up to {end:#x}, the {device} has {size:#x}; choose another --mcu or make the program smaller"
    )]
    TooLarge {
        /// `flash` or `EEPROM`.
        memory: &'static str,
        /// One past the last byte needed.
        end: u64,
        /// Device name.
        device: &'static str,
        /// Size of the memory.
        size: u64,
    },
    /// A section at an address that is no memory of the chip.
    #[error("has loadable data at {0:#x}, which is no memory of the chip; check the linker script")]
    UnknownRegion(u64),
    /// A bad line of Intel HEX.
    #[error("line {line}: {reason}; expected Intel HEX records such as :00000001FF")]
    BadHex {
        /// Line number from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// The end record is missing.
    #[error("has no end-of-file record (:00000001FF): the file is truncated; copy it again")]
    HexNotEnded,
}

/// Copies `bytes` to `address` of a growing memory of at most `size` bytes.
pub(crate) fn place(
    memory: &mut Vec<u8>,
    address: u64,
    bytes: &[u8],
    (name, size, device): (&'static str, usize, &'static str),
) -> Result<(), LoadProblem> {
    let end = address.saturating_add(bytes.len() as u64);
    if end > size as u64 {
        return Err(LoadProblem::TooLarge {
            memory: name,
            end,
            device,
            size: size as u64,
        });
    }
    let (start, end) = (address as usize, end as usize);
    if memory.len() < end {
        memory.resize(end, 0xFF);
    }
    memory[start..end].copy_from_slice(bytes);
    Ok(())
}
