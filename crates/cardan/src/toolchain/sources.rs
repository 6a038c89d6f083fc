//! The firmware's sources: where they are, and a digest of all that an image is made from.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::{BOARDS, Board, unusable};
use crate::failure::Failure;

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

/// The workspace: the one that the current folder lies in, else the one we were built from.
pub(crate) fn workspace() -> Result<PathBuf, Failure> {
    let marker = Path::new(BOARDS[0].folder).join("Cargo.toml");
    let here = std::env::current_dir().unwrap_or_default();
    let ours = Path::new(env!("CARGO_MANIFEST_DIR"));
    let found = here
        .ancestors()
        .chain(ours.ancestors())
        .find(|at| at.join(&marker).is_file());
    let found = found.and_then(|folder| folder.canonicalize().ok());
    found.ok_or_else(|| {
        Failure::input(format!(
            "the firmware's sources ({}) are not here; run this inside a checkout of the \
             repository",
            BOARDS[0].folder
        ))
    })
}

/// SHA-256 over the names and contents of all sources of `board`, as hexadecimal digits.
pub(super) fn digest(workspace: &Path, board: &Board) -> Result<String, Failure> {
    let mut files = Vec::new();
    for folder in SHARED.iter().chain(board.shared).chain([&board.folder]) {
        let folder = workspace.join(folder);
        collect(&folder, &mut files)
            .map_err(|error| unusable(&folder, "cannot be read", &error))?;
    }
    files.sort();
    let mut digest = Sha256::new();
    for file in files {
        let name = file.strip_prefix(workspace).unwrap_or(&file);
        let bytes = fs::read(&file).map_err(|error| unusable(&file, "cannot be read", &error))?;
        let head = format!("{} {}\n", name.display(), bytes.len());
        digest.update(head.as_bytes());
        digest.update(&bytes);
    }
    Ok(super::record::hex(&digest.finalize()))
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tests_what_they_remember_and_c_are_no_sources_of_an_image() {
        let folder = std::env::temp_dir().join(format!("cardan-sources-{}", std::process::id()));
        let files = [
            "src/lib.rs",
            "tests/a.rs",
            "c/attitude.c",
            "src/tests/b.rs",
            "proptest-regressions/c.txt",
        ];
        for file in files {
            let file = folder.join(file);
            fs::create_dir_all(file.parent().unwrap_or(&folder)).expect("a temporary folder");
            fs::write(file, "").expect("a temporary folder");
        }
        let mut found = Vec::new();
        let collected = collect(&folder, &mut found);
        fs::remove_dir_all(&folder).expect("it is ours");
        collected.expect("readable");
        assert_eq!(found, [folder.join("src/lib.rs")]);
    }
}
