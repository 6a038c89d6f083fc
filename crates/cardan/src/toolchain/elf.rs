//! What the ELF file of a board on QEMU tells of its size.
//!
//! (Images of the reference board are read by the emulator's loader, which knows AVR's memories.)

use object::{Object as _, ObjectSection as _, ObjectSymbol as _, SectionFlags, elf};

use crate::failure::Failure;

/// Bytes of each memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sizes {
    /// Code, constants and initial values.
    pub(crate) flash: usize,
    /// Memory for them.
    pub(crate) flash_size: usize,
    /// Static data.
    pub(crate) ram: u32,
    /// Memory for it and the stack.
    pub(crate) ram_size: u32,
}

/// The sizes of the program in the bytes of file `name`: the link script names them by symbols.
pub(crate) fn sizes(name: &str, bytes: &[u8]) -> Result<Sizes, Failure> {
    let file = parse(name, bytes)?;
    let symbol = |symbol| address(name, &file, symbol);
    let allocated = file.sections().filter(|section| match section.flags() {
        SectionFlags::Elf { sh_flags } => sh_flags & u64::from(elf::SHF_ALLOC) != 0,
        _ => false,
    });
    let flash = allocated.map(|section| section.file_range().map_or(0, |(_, len)| len));
    let number = |value: u64| {
        usize::try_from(value).map_err(|_| Failure::input(format!("{name}: {value} bytes")))
    };
    let narrow = |value: u64| {
        u32::try_from(value).map_err(|_| Failure::input(format!("{name}: {value} bytes of RAM")))
    };
    let data = symbol("__sheap")?.saturating_sub(symbol("__sdata")?);
    Ok(Sizes {
        flash: number(flash.sum())?,
        flash_size: number(symbol("CARDAN_FLASH_BYTES")?)?,
        ram: narrow(data)?,
        ram_size: narrow(symbol("CARDAN_RAM_BYTES")?)?,
    })
}

fn parse<'a>(name: &str, bytes: &'a [u8]) -> Result<object::File<'a>, Failure> {
    object::File::parse(bytes)
        .map_err(|error| Failure::input(format!("{name}: no ELF file: {error}; build it again")))
}

fn address(name: &str, file: &object::File<'_>, symbol: &str) -> Result<u64, Failure> {
    let found = file.symbols().find(|found| found.name() == Ok(symbol));
    found.map(|symbol| symbol.address()).ok_or_else(|| {
        Failure::input(format!(
            "{name}: no symbol {symbol}; expected a board's link script to define it"
        ))
    })
}
