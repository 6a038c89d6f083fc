//! The program under test: its image, and the names of its places.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use cardan_emulator::{Device, Image, Machine, ProfileReport, Symbols};

use super::profile::Document;
use crate::failure::Failure;
use crate::files;

/// A program's file.
pub(super) struct Program {
    bytes: Vec<u8>,
    image: Image,
    /// Read when first asked for: most runs need no names.
    symbols: OnceCell<Symbols>,
    /// Folder that paths are shown relative to.
    base: PathBuf,
}

impl Program {
    /// Reads `file`, an ELF file or Intel HEX text.
    pub(super) fn read(file: &Path, device: &Device) -> Result<Self, Failure> {
        let bytes = files::read(file)?;
        let name = file.display().to_string();
        let image = Image::parse(&name, &bytes, device).map_err(Failure::input)?;
        Ok(Self {
            bytes,
            image,
            symbols: OnceCell::new(),
            base: std::env::current_dir().unwrap_or_default(),
        })
    }

    /// What is programmed.
    pub(super) fn image(&self) -> &Image {
        &self.image
    }

    /// The names.
    pub(super) fn symbols(&self) -> &Symbols {
        self.symbols.get_or_init(|| Symbols::parse(&self.bytes))
    }

    /// `, in FUNCTION (FILE:LINE)`, or nothing if nothing is known of the place.
    pub(super) fn place(&self, pc: u32) -> String {
        let place = self.symbols().describe(pc, &self.base);
        place.map_or(String::new(), |place| format!(", in {place}"))
    }

    /// The document of a profile.
    pub(super) fn profile(&self, report: &ProfileReport, machine: &Machine) -> Document {
        Document::new(report, machine, &self.image, self.symbols(), &self.base)
    }
}
