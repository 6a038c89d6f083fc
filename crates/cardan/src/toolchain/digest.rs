//! A digest of all that an image is made from. Shared with this package's build script, so that a program
//! knows the firmware sources that its native firmware was compiled from.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

/// The reference board.
pub(crate) const REFERENCE: &str = "firmware/boards/atmega328p";
/// Files and folders that go into an image beside the board's own. The workspace's manifest only
/// gives the versions that the board's lock file pins.
const SHARED: [&str; 4] = ["firmware", "crates/units", "crates/spec", "crates/datapath"];
/// Folders that hold nothing that goes into an image: other boards, the example in C, committed
/// images, build output, tests and what they remember.
const EXCEPT: [&str; 6] = [
    "boards",
    "c",
    "images",
    "target",
    "tests",
    "proptest-regressions",
];

/// All sources of a board in `folders` (its own and those it shares), by name.
///
/// # Errors
/// The folder that cannot be read, and why.
pub(crate) fn files(
    workspace: &Path,
    folders: &[&str],
) -> Result<Vec<PathBuf>, (PathBuf, io::Error)> {
    let mut files = Vec::new();
    for folder in SHARED.iter().chain(folders) {
        let folder = workspace.join(folder);
        collect(&folder, &mut files).map_err(|error| (folder, error))?;
    }
    files.sort();
    Ok(files)
}

/// SHA-256 over the names and contents of [`files`], as hexadecimal digits.
///
/// # Errors
/// The file or folder that cannot be read, and why.
pub(crate) fn of(workspace: &Path, folders: &[&str]) -> Result<String, (PathBuf, io::Error)> {
    let mut digest = Sha256::new();
    for file in files(workspace, folders)? {
        let name = file.strip_prefix(workspace).unwrap_or(&file);
        let bytes = fs::read(&file).map_err(|error| (file.clone(), error))?;
        let head = format!("{} {}\n", name.display(), bytes.len());
        digest.update(head.as_bytes());
        digest.update(&bytes);
    }
    let digits = digest.finalize();
    Ok(digits.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// All files under `folder` that go into an image.
pub(crate) fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if path.is_file() {
            files.push(path);
        } else if !EXCEPT.contains(&name.as_str()) {
            collect(&path, files)?;
        }
    }
    Ok(())
}
