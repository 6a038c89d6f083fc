//! Images of other formats that were built before: taken only if they are what was built.

use std::fs;
use std::path::{Path, PathBuf};

use super::record::hex_digest;
use crate::failure::Failure;
use crate::files::write_whole;

/// The image, unless it is missing, or not what its seal says: then it is built again.
pub(super) fn read(file: &Path) -> Option<Vec<u8>> {
    let (elf, sum) = (fs::read(file).ok()?, fs::read(seal_of(file)).ok()?);
    (sum == hex_digest(&elf).as_bytes()).then_some(elf)
}

/// Writes down what the image is.
///
/// # Errors
/// It cannot be written.
pub(super) fn seal(file: &Path, elf: &[u8]) -> Result<(), Failure> {
    write_whole("image", &seal_of(file), hex_digest(elf))
}

fn seal_of(file: &Path) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(".sha256");
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damaged_image_is_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("tapped-1.elf");
        assert_eq!(read(&file), None);
        fs::write(&file, b"\x7fELF image").expect("written");
        assert_eq!(read(&file), None, "without a seal");
        seal(&file, b"\x7fELF image").expect("written");
        assert_eq!(read(&file).as_deref(), Some(&b"\x7fELF image"[..]));
        for damaged in [&b""[..], b"\x7fELF imagf", b"\x7fELF ima"] {
            fs::write(&file, damaged).expect("written");
            assert_eq!(read(&file), None);
        }
    }
}
