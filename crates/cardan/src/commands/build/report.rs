//! The result of `build`, as a document and as a table.

use std::fmt;

use serde::Serialize;

use super::measure::{Measured, Spread};
use crate::failure::Failure;
use crate::toolchain::{self, Built, Versions, hex_digest};

/// The JSON document.
#[derive(Serialize)]
pub(super) struct Document {
    toolchain: Versions,
    targets: Vec<TargetReport>,
}

/// One target.
#[derive(Serialize)]
pub(super) struct TargetReport {
    pub(super) target: &'static str,
    pub(super) images: Vec<ImageReport>,
}

/// One image.
#[derive(Serialize)]
pub(super) struct ImageReport {
    image: &'static str,
    file: String,
    bytes: usize,
    sha256: String,
    #[serde(flatten)]
    measured: Measured,
}

impl ImageReport {
    /// Image `name` of a target.
    pub(super) fn new(name: &'static str, built: &Built, measured: Measured) -> Self {
        Self {
            image: name,
            file: built.file.display().to_string(),
            bytes: built.elf.len(),
            sha256: hex_digest(&built.elf),
            measured,
        }
    }
}

impl Document {
    /// The document with the versions of the toolchain.
    pub(super) fn new(targets: Vec<TargetReport>) -> Result<Self, Failure> {
        let toolchain = toolchain::find().map_err(Failure::input)?.versions;
        Ok(Self { toolchain, targets })
    }
}

impl fmt::Display for Document {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<11} {:<7} {:>14} {:>13} {:>8}   {:>18}   {:>20}   {:>20}   {:>5}",
            "target",
            "image",
            "flash",
            "RAM",
            "stack",
            "sample interrupt",
            "solution",
            "without interrupts",
            "load"
        )?;
        for target in &self.targets {
            for image in &target.images {
                row(f, target.target, image)?;
            }
            if let [plain, tapped] = &target.images[..] {
                writeln!(f, "{}", cost(&plain.measured, &tapped.measured))?;
            }
        }
        writeln!(
            f,
            "Flash, RAM and stack in bytes; cycles as worst (mean). Stack and cycles are those of a \
             run with voltages\nover the whole range and nominal calibration: measured, not bounds."
        )?;
        write!(f, "{}", self.toolchain)
    }
}

fn row(f: &mut fmt::Formatter<'_>, target: &str, image: &ImageReport) -> fmt::Result {
    let m = &image.measured;
    let ram = m
        .ram_bytes
        .map_or("-".to_owned(), |ram| share(ram.into(), m.ram_size.into()));
    writeln!(
        f,
        "{target:<11} {:<7} {:>14} {ram:>13} {:>8}   {:>18}   {:>20}   {:>20}   {:>4.1}%",
        image.image,
        share(m.flash_bytes as u64, m.flash_size as u64),
        m.stack_bytes,
        spread(m.sample_interrupt_cycles),
        spread(m.solution_cycles),
        spread(m.solution_own_cycles),
        m.cpu_load * 100.0,
    )
}

fn share(part: u64, whole: u64) -> String {
    format!("{part} ({:.1}%)", part as f64 * 100.0 / whole as f64)
}

fn spread(spread: Option<Spread>) -> String {
    spread.map_or("-".to_owned(), |spread| {
        format!("{} ({:.0})", spread.max, spread.mean)
    })
}

/// What the taps cost, on average.
fn cost(plain: &Measured, tapped: &Measured) -> String {
    let more = |of: fn(&Measured) -> Option<Spread>| {
        let (plain, tapped) = (of(plain)?, of(tapped)?);
        Some(format!("{:.0}", tapped.mean - plain.mean))
    };
    let flash = tapped.flash_bytes.saturating_sub(plain.flash_bytes);
    let sample = more(|m| m.sample_interrupt_cycles).unwrap_or("-".to_owned());
    let solution = more(|m| m.solution_own_cycles).unwrap_or("-".to_owned());
    format!(
        "taps cost {flash} bytes of flash, {sample} cycles per sample interrupt and {solution} per \
         solution on average"
    )
}
