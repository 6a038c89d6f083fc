//! ELF loader. AVR linkers put the memories side by side in one address space: flash at 0, data
//! at 0x800000, EEPROM at 0x810000, fuses at 0x820000, lock bits at 0x830000, signature at
//! 0x840000. What is programmed is each segment's bytes at its load address.

use object::elf::{EM_AVR, ET_EXEC, FileHeader32, PT_LOAD, SHF_ALLOC};
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Endianness, LittleEndian, Object, ObjectSection, ObjectSymbol, SectionFlags};

use crate::device::Device;
use crate::image::{Image, LoadProblem, Memory, Symbol, place};

const DATA: u64 = 0x80_0000;
const EEPROM: u64 = 0x81_0000;
const FUSES: u64 = 0x82_0000;
const LOCK: u64 = 0x83_0000;
const END: u64 = 0x90_0000;

pub(crate) fn parse(bytes: &[u8], device: &Device) -> Result<Image, LoadProblem> {
    let broken = |error: object::Error| LoadProblem::BadElf(error.to_string());
    check_identity(bytes)?;
    let header = FileHeader32::<Endianness>::parse(bytes).map_err(broken)?;
    let endian = header.endian().map_err(broken)?;
    if header.e_machine(endian) != EM_AVR {
        return Err(LoadProblem::WrongMachine(header.e_machine(endian)));
    }
    if header.e_type(endian) != ET_EXEC {
        return Err(LoadProblem::NotExecutable(header.e_type(endian)));
    }
    let mut image = Image::default();
    for segment in header.program_headers(endian, bytes).map_err(broken)? {
        if segment.p_type(endian) != PT_LOAD || segment.p_filesz(endian) == 0 {
            continue;
        }
        let data = segment.data(endian, bytes).map_err(|()| {
            LoadProblem::BadElf("a segment lies beyond the end of the file".to_owned())
        })?;
        place_segment(&mut image, u64::from(segment.p_paddr(endian)), data, device)?;
    }
    if image.flash.is_empty() {
        return Err(LoadProblem::NoProgram);
    }
    image.symbols = symbols(bytes)?;
    Ok(image)
}

/// Class and byte order, which stand at fixed places of the first bytes.
fn check_identity(bytes: &[u8]) -> Result<(), LoadProblem> {
    match (bytes.get(4), bytes.get(5)) {
        (Some(1), Some(1)) => Ok(()),
        (None, _) | (_, None) => Err(LoadProblem::BadElf(
            "the file ends within its header".to_owned(),
        )),
        _ => Err(LoadProblem::WrongClass),
    }
}

fn place_segment(
    image: &mut Image,
    address: u64,
    data: &[u8],
    device: &Device,
) -> Result<(), LoadProblem> {
    let flash = ("flash", device.flash_bytes, device.name);
    let eeprom = ("EEPROM", device.eeprom_bytes, device.name);
    match address {
        0..DATA => place(&mut image.flash, address, data, flash),
        EEPROM..FUSES => place(&mut image.eeprom, address - EEPROM, data, eeprom),
        FUSES..LOCK => {
            let mut fuses = [0xFF; 3];
            let count = data.len().min(3);
            fuses[..count].copy_from_slice(&data[..count]);
            image.fuses = Some(fuses);
            Ok(())
        }
        // Lock bits and signature say nothing about what the program does.
        LOCK..END => Ok(()),
        _ => Err(LoadProblem::UnknownRegion(address)),
    }
}

fn symbols(bytes: &[u8]) -> Result<Vec<Symbol>, LoadProblem> {
    let broken = |error: object::Error| LoadProblem::BadElf(error.to_string());
    let file = object::read::elf::ElfFile32::<LittleEndian>::parse(bytes).map_err(broken)?;
    // (Addresses in sections that are not loaded are offsets in the file.)
    let is_loaded = |index| {
        let section = file.section_by_index(index).map(|section| section.flags());
        !matches!(section, Ok(SectionFlags::Elf { sh_flags }) if sh_flags & u64::from(SHF_ALLOC) == 0)
    };
    let mut found: Vec<Symbol> = file
        .symbols()
        .filter(|symbol| symbol.is_definition() || symbol.section_index().is_some())
        .filter(|symbol| symbol.section_index().is_none_or(is_loaded))
        .filter_map(|symbol| {
            let name = symbol.name().ok().filter(|name| !name.is_empty())?;
            let (memory, base) = match symbol.address() {
                0..DATA => (Memory::Flash, 0),
                DATA..EEPROM => (Memory::Data, DATA),
                EEPROM..FUSES => (Memory::Eeprom, EEPROM),
                _ => return None,
            };
            Some(Symbol {
                name: name.to_owned(),
                memory,
                address: (symbol.address() - base) as u32,
                size: symbol.size() as u32,
            })
        })
        .collect();
    found.sort_by(|a, b| (a.memory, a.address, &a.name).cmp(&(b.memory, b.address, &b.name)));
    Ok(found)
}
