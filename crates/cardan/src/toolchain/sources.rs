//! A digest of all that an image is made from.

use std::path::Path;

use super::{BOARDS, Board, Checkout, digest, unusable};
use crate::failure::Failure;

/// SHA-256 over the names and contents of all sources of `board`, as hexadecimal digits.
pub(super) fn digest(workspace: &Path, board: &Board) -> Result<String, Failure> {
    let folders: Vec<&str> = board.shared.iter().copied().chain([board.folder]).collect();
    digest::of(workspace, &folders)
        .map_err(|(place, error)| unusable(&place, "cannot be read", &error))
}

/// The same of the reference board in `checkout`; none where it cannot be read.
pub(crate) fn reference_digest(checkout: &Checkout) -> Option<String> {
    digest(checkout.root(), &BOARDS[0]).ok()
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
