//! Input files, opened and read within bounds: only regular files, and never more than is asked for.

use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::FileTypeExt as _;
use std::path::Path;

/// Largest scenario or corner file in bytes.
pub(crate) const MOST_TEXT: u64 = 16 << 20;

/// Opens a regular file.
///
/// # Errors
/// The system's; a folder, a pipe or a device, which could be endless, or be read only once.
pub fn open(path: &Path) -> io::Result<File> {
    // Looked at before it is opened: opening a pipe waits for somebody to write to it.
    check(&std::fs::metadata(path)?)?;
    let file = File::open(path)?;
    check(&file.metadata()?)?;
    Ok(file)
}

fn check(there: &std::fs::Metadata) -> io::Result<()> {
    let kind = there.file_type();
    let what = if kind.is_file() {
        return Ok(());
    } else if kind.is_dir() {
        "it is a folder; expected a file"
    } else if kind.is_fifo() {
        "it is a pipe, which can be read only once; write it to a file first"
    } else {
        "it is a device or socket; expected a file"
    };
    Err(io::Error::other(what))
}

/// The content of a regular file of at most `most` bytes.
///
/// # Errors
/// As [`open`]; a larger file.
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let what = format!("it is larger than {most} bytes, the most that is read");
        return Err(io::Error::other(what));
    }
    Ok(bytes)
}

/// The same, as text in UTF-8.
///
/// # Errors
/// As [`read`]; no text.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let bytes = read(path, most)?;
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = 1 + error.as_bytes()[..at]
            .iter()
            .filter(|&&byte| byte == b'\n')
            .count();
        let what = format!("line {line} is no text in UTF-8; save it in that encoding");
        io::Error::other(what)
    })
}
