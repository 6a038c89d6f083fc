//! Functions: the symbols of the program memory, as ranges that do not overlap.

use std::borrow::Cow;

use object::{Object, ObjectSymbol, SymbolKind, SymbolSection};

use super::ElfFile;

/// First address that is no program memory (AVR linkers put the data space there).
const END_OF_CODE: u64 = 0x80_0000;

/// A function and its code.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Function {
    /// Name, demangled.
    pub name: String,
    /// Name as in the file.
    pub symbol: String,
    /// Byte address of its first instruction.
    pub start: u32,
    /// Byte address behind its last instruction.
    pub end: u32,
}

/// A symbol that may be a function. Of several at one address the smallest `rank` wins.
struct Candidate<'a> {
    start: u64,
    /// A compiler's function; a global label of assembly; a weak one (an alias mostly).
    rank: u8,
    size: u64,
    name: &'a str,
}

/// Marks of the linker, which are no functions.
const MARKS: [&str; 9] = [
    "__ctors_start",
    "__ctors_end",
    "__dtors_start",
    "__dtors_end",
    "__trampolines_start",
    "__trampolines_end",
    "_etext",
    "__etext",
    "etext",
];

/// The functions of `file`. Global labels of assembly reach up to the next one, for what lies
/// between them mostly has local labels only.
pub(super) fn read(file: &ElfFile<'_>) -> Vec<Function> {
    let mut candidates: Vec<Candidate<'_>> = file.symbols().filter_map(candidate).collect();
    candidates.sort_by(|a, b| {
        (a.start, a.rank, a.size == 0, a.name).cmp(&(b.start, b.rank, b.size == 0, b.name))
    });
    candidates.dedup_by_key(|candidate| candidate.start);
    let last = code_end(file);
    let starts: Vec<u64> = candidates.iter().map(|candidate| candidate.start).collect();
    let next = starts.iter().skip(1).copied().chain([last]);
    let functions = candidates.iter().zip(next).map(|(candidate, next)| {
        let end = match candidate.size {
            size @ 1.. if candidate.rank == 0 => next.min(candidate.start.saturating_add(size)),
            _ => next,
        };
        Function {
            name: demangle(candidate.name),
            symbol: candidate.name.to_owned(),
            start: candidate.start as u32,
            end: end.max(candidate.start) as u32,
        }
    });
    functions
        .filter(|function| function.start < function.end)
        .collect()
}

fn candidate<'a>(
    symbol: object::read::elf::ElfSymbol32<'a, '_, object::LittleEndian>,
) -> Option<Candidate<'a>> {
    let name = symbol.name().ok().filter(|name| !name.is_empty())?;
    let is_placed = matches!(symbol.section(), SymbolSection::Section(_));
    if !is_placed || symbol.address() >= END_OF_CODE {
        return None;
    }
    let rank = match symbol.kind() {
        SymbolKind::Text => 0,
        SymbolKind::Unknown | SymbolKind::Label if symbol.is_weak() => 2,
        SymbolKind::Unknown | SymbolKind::Label if symbol.is_global() => 1,
        // Local labels of assembly are places within functions.
        _ => return None,
    };
    let is_mark = MARKS.contains(&name);
    (!is_mark).then_some(Candidate {
        start: symbol.address(),
        rank,
        size: symbol.size(),
        name,
    })
}

/// Byte address behind the last code.
fn code_end(file: &ElfFile<'_>) -> u64 {
    use object::{ObjectSection, SectionKind};
    let code = file
        .sections()
        .filter(|section| section.kind() == SectionKind::Text);
    let ends = code.map(|section| section.address().saturating_add(section.size()));
    ends.filter(|&end| end <= END_OF_CODE).max().unwrap_or(0)
}

/// A name as its language spells it (Rust, C++); others stay as they are.
pub fn demangle(name: &str) -> String {
    addr2line::demangle_auto(Cow::Borrowed(name), None).into_owned()
}
