//! Measures an image of a board that QEMU runs: the program paints its stack and tells how much it
//! used. QEMU counts no cycles.
//!
//! The codes are those of the reference board's measurement. Files: `firmware/boards/replay`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use cardan_spec::calibration::LEN;
use cardan_spec::frame::COMMAND_TEXT;
use cardan_spec::timing::{BLOCK_CONVERSIONS, WARM_UP_BLOCKS};
use cardan_spec::{CHANNELS, REFERENCE_V};

use super::measure::{Measured, SOLUTIONS, TEXT_SOLUTIONS, voltage};
use crate::failure::Failure;
use crate::toolchain::{self, Built};

/// Marks a byte that the serial line receives.
const RECEIVED: u16 = 1 << 14;
/// Begins the last record of the results; the stack follows.
const END: u16 = 0xfffe;
/// Steps of the converter.
const CODES: f64 = 1024.0;
/// A run takes a tenth of a second; after this it hangs.
const PATIENCE: Duration = Duration::from_secs(60);

/// Sizes of the image, and its stack if `runner` can be started. What is missing is added to
/// `remarks`.
pub(super) fn measure(
    built: &Built,
    runner: &[String],
    remarks: &mut Vec<String>,
) -> Result<Measured, Failure> {
    let name = built.file.display().to_string();
    let sizes = toolchain::sizes(&name, &built.elf)?;
    let stack = match stack(&built.file, runner)? {
        Some(bytes) => Some(bytes),
        None => {
            let program = runner.first().map_or("", String::as_str);
            let remark = format!(
                "{program} cannot be started: the stack is not measured; `cardan doctor` says how \
                 to install it"
            );
            if !remarks.contains(&remark) {
                remarks.push(remark);
            }
            None
        }
    };
    Ok(Measured {
        flash_bytes: sizes.flash,
        flash_size: sizes.flash_size,
        ram_bytes: Some(sizes.ram),
        ram_size: sizes.ram_size,
        stack_bytes: stack,
        sample_interrupt_cycles: None,
        solution_cycles: None,
        solution_own_cycles: None,
        cpu_load: None,
        measured_third_axis: None,
    })
}

/// Bytes of stack that the program tells; none if the runner is not there.
fn stack(image: &Path, runner: &[String]) -> Result<Option<u32>, Failure> {
    let Some((program, arguments)) = runner.split_first() else {
        return Ok(None);
    };
    let folder = Folder::new(image)?;
    let input = folder.0.join("replay.in");
    fs::write(&input, recording()).map_err(|error| unusable(&input, &error))?;
    let started = Command::new(program)
        .args(arguments)
        .arg(image)
        .current_dir(&folder.0)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn();
    let Ok(child) = started else {
        return Ok(None);
    };
    ended(child, image)?;
    let output = folder.0.join("replay.out");
    let results = fs::read(&output).map_err(|error| unusable(&output, &error))?;
    let told = results.last_chunk().and_then(|last: &[u8; 6]| {
        let (mark, stack) = last.split_first_chunk()?;
        let is_end = u16::from_le_bytes(*mark) == END;
        is_end.then_some(u32::from_le_bytes(stack.try_into().ok()?))
    });
    told.map(Some)
        .ok_or_else(|| stopped(image, "its results have no end"))
}

/// The settings of an erased EEPROM (a solution per block), binary solutions, and then solutions as
/// text.
fn recording() -> Vec<u8> {
    let mut bytes = vec![0xff; LEN];
    let binary = WARM_UP_BLOCKS as u64 + SOLUTIONS;
    for solution in 0..binary + TEXT_SOLUTIONS {
        if solution == binary {
            bytes.extend((RECEIVED | u16::from(COMMAND_TEXT)).to_le_bytes());
        }
        for conversion in 0..BLOCK_CONVERSIONS {
            let channel = (conversion % CHANNELS) as u8;
            let share = voltage(solution, channel) / REFERENCE_V;
            let code = (share * CODES).min(CODES - 1.0) as u16;
            bytes.extend(code.to_le_bytes());
        }
    }
    bytes
}

/// Waits for the program's end.
fn ended(mut child: Child, image: &Path) -> Result<(), Failure> {
    let begin = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(status)) => return Err(stopped(image, &status)),
            Ok(None) if begin.elapsed() < PATIENCE => thread::sleep(Duration::from_millis(5)),
            Ok(None) => {
                // It may have ended just now.
                let _ = child.kill();
                let _ = child.wait();
                return Err(stopped(image, "it does not end"));
            }
            Err(error) => return Err(stopped(image, &error)),
        }
    }
}

fn stopped(image: &Path, how: &(impl std::fmt::Display + ?Sized)) -> Failure {
    Failure::input(format!(
        "{}: the image does not run to be measured: {how}",
        image.display()
    ))
}

fn unusable(file: &Path, error: &std::io::Error) -> Failure {
    Failure::input(format!("{}: {error}", file.display()))
}

/// A folder beside the image, for one run.
struct Folder(PathBuf);

impl Folder {
    fn new(image: &Path) -> Result<Self, Failure> {
        let folder = image.with_extension(format!("run-{}", std::process::id()));
        fs::create_dir_all(&folder).map_err(|error| unusable(&folder, &error))?;
        Ok(Self(folder))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left lies in the target folder.
        let _ = fs::remove_dir_all(&self.0);
    }
}
