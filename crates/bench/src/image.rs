//! Firmware images and the tables by which they tell what they compute (spec: taps).

use cardan_datapath::{Format, NodeInfo, Overflow, Rounding, format_table_len};
use cardan_emulator::{ATMEGA328P, Image, LoadError};
use cardan_spec::taps;
use object::{Object as _, ObjectSection as _, ObjectSymbol as _};

/// An image with its tables.
#[derive(Clone, Debug)]
pub struct Firmware {
    /// What is loaded.
    pub image: Image,
    /// Where it came from, for messages.
    pub name: String,
    /// Its format table, if it carries one.
    pub formats: Option<FormatTable>,
    /// Digest of the sources that it was made of, if it tells.
    pub sources: Option<String>,
    /// Address of the tap table in the data space, if it has taps.
    pub taps: Option<TapTable>,
    /// What is written into the EEPROM instead of the bench's own calibration.
    pub eeprom: Option<EepromImage>,
}

/// Content of the EEPROM from address 0, as read from a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EepromImage {
    /// The file, for messages.
    pub name: String,
    /// Bytes.
    pub bytes: Vec<u8>,
}

/// The format table of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FormatTable {
    /// Hash over names and formats.
    pub hash: u64,
    /// Formats by node index.
    pub formats: Vec<Format>,
}

/// The tap table of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TapTable {
    /// Data address of node 0's word.
    pub address: usize,
    /// Number of words.
    pub len: usize,
}

/// Why an image is not usable.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// It cannot be read.
    #[error(transparent)]
    Load(#[from] LoadError),
    /// Its tables are damaged.
    #[error(
        "{file}: symbol {symbol}: {problem}; build the image again (`cardan build`, with \
         --wordlengths where formats are to differ)"
    )]
    Table {
        /// File.
        file: String,
        /// Symbol.
        symbol: &'static str,
        /// What is wrong.
        problem: String,
    },
}

impl Firmware {
    /// Reads an image from the bytes of file `name`.
    ///
    /// # Errors
    /// Not an AVR program, or damaged tables.
    pub fn parse(name: &str, bytes: &[u8]) -> Result<Self, ImageError> {
        let image = Image::parse(name, bytes, &ATMEGA328P)?;
        let formats = FormatTable::of(name, bytes)?;
        let sources = content_of(name, bytes, taps::SOURCES_SYMBOL)?;
        let digits = |found: &[u8]| String::from_utf8_lossy(found).into_owned();
        let taps = image.symbol(taps::TABLE_SYMBOL).map(|symbol| TapTable {
            address: symbol.address as usize,
            len: symbol.size as usize / 4,
        });
        Ok(Self {
            image,
            name: name.to_owned(),
            formats,
            sources: sources.as_deref().map(digits),
            taps,
            eeprom: None,
        })
    }

    /// Checks that the image computes in `nodes`' formats.
    ///
    /// # Errors
    /// The first disagreement with both sides.
    pub fn check_formats(&self, nodes: &[NodeInfo], hash: u64) -> Result<(), ImageError> {
        let Some(table) = &self.formats else {
            return Ok(());
        };
        if table.hash == hash {
            return Ok(());
        }
        let fail = |problem| ImageError::Table {
            file: self.name.clone(),
            symbol: taps::FORMATS_SYMBOL,
            problem,
        };
        if table.formats.len() != nodes.len() {
            return Err(fail(format!(
                "the image has {} nodes, the native firmware {}",
                table.formats.len(),
                nodes.len()
            )));
        }
        let differing = nodes
            .iter()
            .zip(&table.formats)
            .find(|(node, format)| node.format != **format);
        Err(fail(differing.map_or_else(
            || {
                format!(
                    "hash {:016x}, native {hash:016x}: the nodes' names differ",
                    table.hash
                )
            },
            |(node, format)| {
                format!(
                    "node '{}' is {} in the image and {} natively",
                    node.name,
                    describe(*format),
                    describe(node.format)
                )
            },
        )))
    }
}

/// A format in words.
#[must_use]
pub fn describe(format: Format) -> String {
    format!(
        "{} bits with {} fractional ({}, {})",
        format.word,
        format.frac,
        format.rounding.name(),
        format.overflow.name()
    )
}

impl FormatTable {
    /// The format table in the bytes of program `name`, of any board; none if it carries none, or
    /// if the file has no symbols. It lies in flash, or in a section that is not loaded.
    ///
    /// # Errors
    /// A damaged file or table.
    pub fn of(name: &str, bytes: &[u8]) -> Result<Option<Self>, ImageError> {
        let Some(content) = content_of(name, bytes, taps::FORMATS_SYMBOL)? else {
            return Ok(None);
        };
        Self::read(&content)
            .map(Some)
            .map_err(|problem| ImageError::Table {
                file: name.to_owned(),
                symbol: taps::FORMATS_SYMBOL,
                problem: problem.to_owned(),
            })
    }

    fn read(bytes: &[u8]) -> Result<Self, &'static str> {
        const CUT: &str = "is cut short";
        let (head, rest) = bytes.split_at_checked(format_table_len(0)).ok_or(CUT)?;
        let (hash, count) = head.split_at(8);
        let hash = hash
            .iter()
            .rev()
            .fold(0, |hash, &byte| hash << 8 | u64::from(byte));
        let count = usize::from(count[0]) | usize::from(count[1]) << 8;
        let rows = rest.get(..4 * count).ok_or(CUT)?;
        let formats = rows.chunks_exact(4).map(|row| {
            let rounding = Rounding::ALL.get(usize::from(row[2]))?.0;
            let overflow = Overflow::ALL.get(usize::from(row[3]))?.0;
            let word = u32::from(row[0]);
            (1..=64)
                .contains(&word)
                .then(|| Format::new(word, row[1].into(), rounding, overflow))
        });
        let formats = formats
            .collect::<Option<Vec<_>>>()
            .ok_or("holds a word length or mode that does not exist")?;
        Ok(Self { hash, formats })
    }
}

/// What `symbol` names in the bytes of program `name`; none if there is no such symbol, or if the file has
/// none at all. It lies in flash, or in a section that is not loaded.
fn content_of(
    name: &str,
    bytes: &[u8],
    symbol: &'static str,
) -> Result<Option<Vec<u8>>, ImageError> {
    let fail = |problem: &str| ImageError::Table {
        file: name.to_owned(),
        symbol,
        problem: problem.to_owned(),
    };
    if !bytes.starts_with(&object::elf::ELFMAG) {
        return Ok(None);
    }
    let file = object::File::parse(bytes).map_err(|error| fail(&error.to_string()))?;
    let Some(found) = file.symbol_by_name(symbol) else {
        return Ok(None);
    };
    let section = found
        .section_index()
        .and_then(|index| file.section_by_index(index).ok())
        .ok_or_else(|| fail("lies in no section"))?;
    let start = found.address().wrapping_sub(section.address());
    let content = section
        .data()
        .ok()
        .and_then(|data| data.get(usize::try_from(start).ok()?..))
        .ok_or_else(|| fail("lies beyond its section"))?;
    let length = usize::try_from(found.size()).unwrap_or(usize::MAX);
    // Without a size (assembler by hand), all that follows.
    let content = match length {
        0 => content,
        _ => content.get(..length).unwrap_or(content),
    };
    Ok(Some(content.to_vec()))
}
