//! What a program calls its places: functions, source files and lines, inlined calls.
//!
//! Read from an ELF file next to its [`Image`](crate::Image); the machine itself never needs it.
//! Missing or damaged debug information is no error: places then have fewer names, and
//! [`Symbols::problem`] says why.

mod functions;
mod lines;

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use addr2line::Context;
use gimli::{Dwarf, EndianArcSlice, LittleEndian};
use object::{Object, ObjectSection};

pub use self::functions::{Function, demangle};
use self::lines::Lines;
pub use self::lines::Row;

type Reader = EndianArcSlice<LittleEndian>;
type ElfFile<'a> = object::read::elf::ElfFile32<'a, object::LittleEndian>;

/// Names of the places of a program. Empty for a HEX file.
#[derive(Default)]
pub struct Symbols {
    functions: Vec<Function>,
    lines: Lines,
    /// For inlined calls; `None` without usable debug information.
    context: Option<Context<Reader>>,
    problem: Option<String>,
}

/// One level of a place: the innermost function comes first, then those it was inlined into.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Name of the function, demangled.
    pub function: Option<String>,
    /// Source file as the debug information spells it.
    pub file: Option<String>,
    /// Line from 1.
    pub line: Option<u32>,
}

impl Symbols {
    /// Reads the names from a program's file.
    pub fn parse(bytes: &[u8]) -> Symbols {
        if !bytes.starts_with(b"\x7fELF") {
            return Symbols {
                problem: Some("not an ELF file: it holds no names".to_owned()),
                ..Symbols::default()
            };
        }
        let file = match ElfFile::parse(bytes) {
            Ok(file) => file,
            Err(error) => {
                return Symbols {
                    problem: Some(format!("no symbols: {error}")),
                    ..Symbols::default()
                };
            }
        };
        let functions = functions::read(&file);
        let has_vectors = functions
            .first()
            .is_some_and(|first| first.start == 0 && first.symbol == "__vectors");
        let mut symbols = Symbols {
            functions,
            ..Symbols::default()
        };
        let dwarf = match dwarf(&file) {
            Ok(Some(dwarf)) => Arc::new(dwarf),
            Ok(None) => {
                symbols.problem = Some(undebugged(&file).to_owned());
                return symbols;
            }
            Err(error) => {
                symbols.problem = Some(format!("damaged debug information: {error}"));
                return symbols;
            }
        };
        let (lines, damage) = Lines::read(&dwarf, has_vectors);
        symbols.lines = lines;
        let context = Context::from_arc_dwarf(dwarf);
        let damage = damage.or(context.as_ref().err().copied());
        symbols.problem = damage.map(|error| format!("damaged debug information: {error}"));
        if symbols.problem.is_none() && symbols.lines.rows.is_empty() {
            symbols.problem = Some(undebugged(&file).to_owned());
        }
        symbols.context = context.ok();
        symbols
    }

    /// Why some names are missing, if it is known.
    pub fn problem(&self) -> Option<&str> {
        self.problem.as_deref()
    }

    /// All functions, in the order of their addresses; they do not overlap.
    pub fn functions(&self) -> &[Function] {
        &self.functions
    }

    /// The rows of the line table, in the order of their addresses; they do not overlap.
    pub fn rows(&self) -> &[Row] {
        &self.lines.rows
    }

    /// The path of a source file, by the number in a [`Row`].
    pub fn file(&self, number: usize) -> &str {
        self.lines.files.get(number).map_or("", String::as_str)
    }

    /// All source files.
    pub fn files(&self) -> &[String] {
        &self.lines.files
    }

    /// The function at a byte address.
    pub fn function_at(&self, address: u32) -> Option<&Function> {
        let after = self
            .functions
            .partition_point(|function| function.start <= address);
        let function = self.functions.get(after.checked_sub(1)?)?;
        (address < function.end).then_some(function)
    }

    /// Source file and line at a byte address.
    pub fn line_at(&self, address: u32) -> Option<(&str, u32)> {
        let row = self.lines.at(address)?;
        Some((self.file(row.file), row.line))
    }

    /// All levels of a place: inlined functions first, then the one they were inlined into. Empty
    /// if nothing is known.
    pub fn frames_at(&self, address: u32) -> Vec<Frame> {
        let function = self.function_at(address);
        let line = self.line_at(address);
        if line.is_some()
            && let Some(frames) = self.inlined(address, function)
        {
            return frames;
        }
        if function.is_none() && line.is_none() {
            return Vec::new();
        }
        vec![Frame {
            function: function.map(|function| function.name.clone()),
            file: line.map(|(file, _)| file.to_owned()),
            line: line.map(|(_, line)| line),
        }]
    }

    /// The levels that the debug information knows, if they end in `function`: functions that the
    /// linker has dropped keep their debug information, at address 0.
    fn inlined(&self, address: u32, function: Option<&Function>) -> Option<Vec<Frame>> {
        let found = self.context.as_ref()?.find_frames(u64::from(address));
        let mut found = found.skip_all_loads().ok()?;
        let mut frames = Vec::new();
        let mut outermost = None;
        while let Ok(Some(frame)) = found.next() {
            let name = frame.function.as_ref();
            let raw = name.and_then(|name| name.raw_name().ok().map(|raw| raw.into_owned()));
            frames.push(Frame {
                function: raw.as_deref().map(demangle),
                file: frame
                    .location
                    .as_ref()
                    .and_then(|at| at.file.map(str::to_owned)),
                line: frame.location.as_ref().and_then(|at| at.line),
            });
            outermost = raw;
        }
        let expected = function.map(|function| function.symbol.as_str());
        (outermost.as_deref() == expected && expected.is_some()).then_some(frames)
    }

    /// The place of a byte address for people: function and source line, as far as they are known.
    /// Paths below `base` are shown relative to it.
    pub fn describe(&self, address: u32, base: &Path) -> Option<String> {
        let frames = self.frames_at(address);
        let shown: Vec<String> = frames
            .iter()
            .map(|frame| Described(frame, base).to_string())
            .collect();
        (!shown.is_empty()).then(|| shown.join(", inlined into "))
    }
}

impl fmt::Debug for Symbols {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Symbols")
            .field("functions", &self.functions.len())
            .field("rows", &self.lines.rows.len())
            .field("problem", &self.problem)
            .finish_non_exhaustive()
    }
}

struct Described<'a>(&'a Frame, &'a Path);

impl fmt::Display for Described<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Described(frame, base) = self;
        if let Some(function) = &frame.function {
            write!(f, "{function}")?;
        }
        match (&frame.function, &frame.file) {
            (Some(_), Some(_)) => f.write_str(" ")?,
            (_, None) => return Ok(()),
            _ => {}
        }
        let file = frame.file.as_deref().unwrap_or_default();
        write!(f, "({}", shortened(file, base))?;
        match frame.line {
            Some(line) => write!(f, ":{line})"),
            None => f.write_str(")"),
        }
    }
}

/// `path` relative to `base` if it lies below it, else as it is.
pub fn shortened<'a>(path: &'a str, base: &Path) -> &'a str {
    let below = Path::new(path).strip_prefix(base).ok();
    let below = below.and_then(Path::to_str);
    below.filter(|below| !below.is_empty()).unwrap_or(path)
}

/// Why there are no source lines.
fn undebugged(file: &ElfFile<'_>) -> &'static str {
    if file.section_by_name(".stab").is_some() {
        "its debug information has the old format stabs: compile with -gdwarf-4 (avr-gcc 5 writes \
         stabs for -g) for source lines"
    } else {
        "no debug information: compile with -gdwarf-4 (Rust: debug = true) for source lines"
    }
}

/// The debug sections; `None` if the file has no line table.
fn dwarf(file: &ElfFile<'_>) -> Result<Option<Dwarf<Reader>>, object::Error> {
    if file.section_by_name(".debug_line").is_none() {
        return Ok(None);
    }
    let load = |id: gimli::SectionId| -> Result<Reader, object::Error> {
        let section = file.section_by_name(id.name());
        let data = match section {
            Some(section) => section.data()?,
            None => &[],
        };
        Ok(Reader::new(Arc::from(data), LittleEndian))
    };
    Dwarf::load(load).map(Some)
}
