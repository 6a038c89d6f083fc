//! Intel HEX loader.

use ihex::{Reader, ReaderError, Record};

use crate::device::Device;
use crate::image::{Image, LoadProblem, place};

pub(crate) fn parse(bytes: &[u8], device: &Device) -> Result<Image, LoadProblem> {
    if bytes.is_empty() {
        return Err(LoadProblem::Empty);
    }
    let text = std::str::from_utf8(bytes).map_err(|_| LoadProblem::UnknownFormat)?;
    if text.trim().is_empty() {
        return Err(LoadProblem::Empty);
    }
    if !text.trim_start().starts_with(':') {
        return Err(LoadProblem::UnknownFormat);
    }
    let mut image = Image::default();
    let mut base = 0u64;
    let mut is_ended = false;
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() {
            continue;
        }
        let bad = |reason: String| LoadProblem::BadHex {
            line: index + 1,
            reason,
        };
        if is_ended {
            return Err(bad("a record after the end-of-file record".to_owned()));
        }
        match record(line).map_err(bad)? {
            Record::Data { offset, value } => {
                let flash = ("flash", device.flash_bytes, device.name);
                place(&mut image.flash, base + u64::from(offset), &value, flash)?;
            }
            Record::ExtendedSegmentAddress(segment) => base = u64::from(segment) << 4,
            Record::ExtendedLinearAddress(upper) => base = u64::from(upper) << 16,
            Record::StartSegmentAddress { .. } | Record::StartLinearAddress(_) => {}
            Record::EndOfFile => is_ended = true,
        }
    }
    if !is_ended {
        return Err(LoadProblem::HexNotEnded);
    }
    if image.flash.is_empty() {
        return Err(LoadProblem::NoProgram);
    }
    Ok(image)
}

/// One record, or the reason why the line is none.
fn record(line: &str) -> Result<Record, String> {
    match Reader::new(line).next() {
        Some(Ok(record)) => Ok(record),
        Some(Err(error)) => Err(reason(&error)),
        None => Err("no record".to_owned()),
    }
}

fn reason(error: &ReaderError) -> String {
    error.to_string()
}
