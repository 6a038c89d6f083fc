//! The firmware's sources: where they are, and a digest of all that an image is made from.

use std::path::{Path, PathBuf};

use super::{BOARDS, Board, digest, unusable};
use crate::failure::Failure;

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

/// The checkout that the current folder lies in, if it lies in one.
pub(crate) fn here() -> Option<PathBuf> {
    let marker = Path::new(BOARDS[0].folder).join("Cargo.toml");
    let here = std::env::current_dir().ok()?;
    let found = here.ancestors().find(|at| at.join(&marker).is_file())?;
    found.canonicalize().ok()
}

/// SHA-256 over the names and contents of all sources of `board`, as hexadecimal digits.
pub(super) fn digest(workspace: &Path, board: &Board) -> Result<String, Failure> {
    let folders: Vec<&str> = board.shared.iter().copied().chain([board.folder]).collect();
    digest::of(workspace, &folders)
        .map_err(|(place, error)| unusable(&place, "cannot be read", &error))
}

/// The same of the reference board in the checkout that the user stands in; none outside one.
pub(crate) fn digest_here() -> Option<(PathBuf, String)> {
    let checkout = here()?;
    let digest = digest(&checkout, &BOARDS[0]).ok()?;
    Some((checkout, digest))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::digest::collect;

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
