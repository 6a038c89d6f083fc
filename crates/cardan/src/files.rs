//! Output files: there whole, or as they were before.

use std::fs;
use std::io;
use std::path::Path;

use crate::failure::Failure;

/// Writes `content` to `file`: beside it first, then renamed, so that no half-written file is left
/// behind. What is no regular file (a pipe, a terminal) is written directly.
pub(crate) fn write_whole(file: &Path, content: impl AsRef<[u8]>) -> Result<(), Failure> {
    let written = match fs::metadata(file) {
        Ok(there) if !there.is_file() => fs::write(file, &content),
        _ => replace(file, content.as_ref()),
    };
    written
        .map_err(|error| Failure::input(format!("{}: cannot be written: {error}", file.display())))
}

fn replace(file: &Path, content: &[u8]) -> io::Result<()> {
    let mut partial = file.as_os_str().to_owned();
    partial.push(".partial");
    let written = fs::write(&partial, content).and_then(|()| fs::rename(&partial, file));
    if written.is_err() {
        // Nothing more can be done about a leftover that cannot be removed.
        let _ = fs::remove_file(&partial);
    }
    written
}
