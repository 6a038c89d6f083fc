//! The files of `--profile-out`.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use cardan_emulator::{Machine, ProfileReport, Symbols};

use super::profile::Document;
use crate::failure::Failure;
use crate::files::write_whole;

/// The folder of the files.
pub(super) struct Folder(PathBuf);

impl Folder {
    /// What may be written into it.
    pub(super) const FILES: [&str; 4] = ["profile.json", "folded.txt", "listing.txt", "lcov.info"];

    /// Makes the folder if it is not there: before a long run, and not after it.
    pub(super) fn create(path: &Path) -> Result<Self, Failure> {
        fs::create_dir_all(path).map_err(|error| failure(path, &error))?;
        Ok(Self(path.to_owned()))
    }

    /// Writes all files.
    pub(super) fn write(
        &self,
        document: &Document,
        report: &ProfileReport,
        machine: &Machine,
        symbols: &Symbols,
    ) -> Result<(), Failure> {
        let json = serde_json::to_string_pretty(document)
            .map_err(|error| Failure::input(format!("profile.json: {error}")))?;
        self.file("profile.json", &(json + "\n"))?;
        self.file("folded.txt", &report.folded())?;
        self.file("listing.txt", &listing(report, machine, symbols))?;
        if !report.lines.is_empty() {
            self.file("lcov.info", &report.lcov(symbols))?;
        }
        Ok(())
    }

    fn file(&self, name: &str, content: &str) -> Result<(), Failure> {
        write_whole("--profile-out", &self.0.join(name), content)
    }
}

/// Every instruction executed: how often, its cycles, address and disassembly, below its function
/// and source line.
fn listing(report: &ProfileReport, machine: &Machine, symbols: &Symbols) -> String {
    let mut text = format!(
        "{:>12} {:>14}  address  instruction\n",
        "executed", "cycles"
    );
    let (mut function, mut line) = (None, None);
    for place in &report.places {
        let here = symbols
            .function_at(place.pc)
            .map(|function| function.name.as_str());
        if here != function {
            function = here;
            line = None;
            // Writing into a String cannot fail.
            let _ = writeln!(text, "\n{}:", here.unwrap_or("(no symbol)"));
        }
        let at = symbols.line_at(place.pc);
        if at != line {
            line = at;
            if let Some((file, number)) = at {
                let _ = writeln!(text, "; {file}:{number}");
            }
        }
        let instruction = machine.disassemble_at(place.pc);
        let _ = writeln!(
            text,
            "{:>12} {:>14}  {:#06x}   {instruction}",
            place.count, place.cycles, place.pc
        );
    }
    text
}

fn failure(path: &Path, error: &std::io::Error) -> Failure {
    Failure::input(format!(
        "--profile-out: {} cannot be written: {error}; expected a folder that exists or can be \
         made",
        path.display()
    ))
}
