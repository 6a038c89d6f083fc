//! Files of the command line, in one place: outputs are there whole or as they were before, are
//! checked before the work begins, and inputs are read within bounds.

mod plan;
mod whole;

use std::path::Path;

pub(crate) use plan::Plan;
pub(crate) use whole::Whole;

use crate::failure::Failure;

/// Writes `content` to `file`, the value of `option`: whole, or not at all.
///
/// # Errors
/// Every failure to write, up to the last byte's way to the disk.
pub(crate) fn write_whole(
    option: &str,
    file: &Path,
    content: impl AsRef<[u8]>,
) -> Result<(), Failure> {
    use std::io::Write as _;
    let written = Whole::create(file).and_then(|mut whole| {
        whole.write_all(content.as_ref())?;
        whole.commit()
    });
    written.map_err(|error| unwritten(option, file, &error))
}

/// Writes files into a folder, which is made if it is not there.
///
/// # Errors
/// As [`write_whole`]; a folder that cannot be made.
pub(crate) fn write_into(
    option: &str,
    folder: &Path,
    name: &str,
    content: impl AsRef<[u8]>,
) -> Result<std::path::PathBuf, Failure> {
    make_folder(option, folder)?;
    let file = folder.join(name);
    write_whole(option, &file, content)?;
    Ok(file)
}

/// Makes a folder and those above it.
///
/// # Errors
/// It cannot be made.
pub(crate) fn make_folder(option: &str, folder: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| {
        let shown = folder.display();
        Failure::input(format!(
            "{option} {shown}: cannot be made: {error}; give another folder"
        ))
    })
}

/// A file that could not be written, with what the system says.
pub(crate) fn unwritten(option: &str, file: &Path, error: &std::io::Error) -> Failure {
    let mend = match error.kind() {
        std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => {
            "make room, or give a file on another disk"
        }
        std::io::ErrorKind::BrokenPipe => "nobody reads it any more",
        _ => "give a file in a folder that can be written to",
    };
    Failure::input(format!(
        "{option} {}: cannot be written: {error}; {mend}",
        file.display()
    ))
}

/// Largest input that is read into memory.
pub(crate) const MOST_BYTES: u64 = 1 << 30;

/// The content of a regular file of at most [`MOST_BYTES`].
///
/// # Errors
/// It is none, is larger, or cannot be read; the message names it.
pub(crate) fn read(file: &Path) -> Result<Vec<u8>, Failure> {
    cardan_scenario::source::read(file, MOST_BYTES).map_err(|error| unread(file, &error))
}

/// The same, as text in UTF-8.
///
/// # Errors
/// As [`read`]; no text.
pub(crate) fn read_text(file: &Path) -> Result<String, Failure> {
    cardan_scenario::source::read_text(file, MOST_BYTES).map_err(|error| unread(file, &error))
}

fn unread(file: &Path, error: &std::io::Error) -> Failure {
    Failure::input(format!("{}: cannot be read: {error}", file.display()))
}
