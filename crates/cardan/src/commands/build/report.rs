//! The result of `build`, as a document and as a table.

use std::fmt;

use serde::Serialize;

use super::left_out::LeftOut;
use super::measure::{Measured, Spread};
use crate::toolchain::{Built, Places, Versions, hex_digest};

/// The JSON document.
#[derive(Serialize)]
pub(super) struct Document {
    /// Of the first target.
    toolchain: Option<Versions>,
    /// What was built, and where.
    #[serde(flatten)]
    places: Places,
    targets: Vec<TargetReport>,
    /// Targets that were not built, and why.
    not_built: Vec<LeftOut>,
}

/// One target.
#[derive(Serialize)]
pub(super) struct TargetReport {
    pub(super) target: &'static str,
    pub(super) toolchain: Versions,
    /// The command that runs an image, without the image, where that is not this program.
    pub(super) runner: Option<Vec<String>>,
    /// What could not be measured.
    pub(super) remarks: Vec<String>,
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
    /// The document of all targets.
    pub(super) fn new(places: Places, targets: Vec<TargetReport>, not_built: Vec<LeftOut>) -> Self {
        let toolchain = targets.first().map(|target| target.toolchain.clone());
        Self {
            toolchain,
            places,
            targets,
            not_built,
        }
    }
}

impl fmt::Display for Document {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<13} {:<7} {:>14} {:>13} {:>8}   {:>18}   {:>20}   {:>20}   {:>5}",
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
        let mut notes: Vec<String> = Vec::new();
        for target in &self.targets {
            for image in &target.images {
                row(f, target.target, image)?;
                third_axis(f, target.target, image)?;
            }
            if let [plain, tapped] = &target.images[..] {
                writeln!(f, "{}", cost(&plain.measured, &tapped.measured))?;
            }
            let toolchain = format!("{}: {}", target.target, target.toolchain);
            notes.extend(target.remarks.iter().cloned().chain([toolchain]));
        }
        writeln!(
            f,
            "Flash, RAM and stack in bytes; cycles as worst (mean). Stack and cycles are those of a \
             run with voltages\nover the whole range and nominal calibration: measured, not bounds."
        )?;
        if self.targets.iter().any(|target| target.runner.is_some()) {
            writeln!(
                f,
                "Programs for QEMU keep the firmware's state on the stack, and hold what reads codes \
                 from and writes\nresults to files of the host."
            )?;
        }
        notes.extend(self.not_built.iter().map(|one| format!("not built: {one}")));
        write!(f, "{}", notes.join("\n"))
    }
}

fn row(f: &mut fmt::Formatter<'_>, target: &str, image: &ImageReport) -> fmt::Result {
    let m = &image.measured;
    let ram = m
        .ram_bytes
        .map_or("-".to_owned(), |ram| share(ram.into(), m.ram_size.into()));
    writeln!(
        f,
        "{target:<13} {:<7} {:>14} {ram:>13} {:>8}   {:>18}   {:>20}   {:>20}   {:>5}",
        image.image,
        share(m.flash_bytes as u64, m.flash_size as u64),
        m.stack_bytes
            .map_or("-".to_owned(), |bytes| bytes.to_string()),
        spread(m.sample_interrupt_cycles),
        spread(m.solution_cycles),
        spread(m.solution_own_cycles),
        m.cpu_load
            .map_or("-".to_owned(), |load| format!("{:.1}%", load * 100.0)),
    )
}

/// The run of a device that measures its third tilt axis.
fn third_axis(f: &mut fmt::Formatter<'_>, target: &str, image: &ImageReport) -> fmt::Result {
    let Some(run) = &image.measured.measured_third_axis else {
        return Ok(());
    };
    writeln!(
        f,
        "{target:<13} {:<36} {:>8}   {:>18}   {:>20}   {:>20}   {:>5}",
        format!("{}, third tilt axis measured", image.image),
        run.stack_bytes,
        spread(run.sample_interrupt_cycles),
        spread(run.solution_cycles),
        spread(run.solution_own_cycles),
        format!("{:.1}%", run.cpu_load * 100.0),
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
    let sample = more(|m| m.sample_interrupt_cycles);
    let solution = more(|m| m.solution_own_cycles);
    match (sample, solution) {
        (Some(sample), Some(solution)) => format!(
            "taps cost {flash} bytes of flash, {sample} cycles per sample interrupt and {solution} \
             per solution on average"
        ),
        _ => format!("taps cost {flash} bytes of flash"),
    }
}
