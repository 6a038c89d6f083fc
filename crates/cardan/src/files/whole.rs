//! A file being written: beside its place first, then put there in one step.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

/// Links that are followed to the file that is meant.
const MOST_LINKS: usize = 40;
/// Permissions of a new file, before the user's mask.
const NEW: u32 = 0o666;

/// A file that appears when it is complete. Until then an old one stays as it is; if it is dropped
/// before, nothing is left. The temporary file has a name that nobody can guess and is created anew,
/// so that it never follows a link that somebody laid.
///
/// What is no regular file (a pipe, a terminal, `/dev/full`) is written directly.
#[derive(Debug)]
pub(crate) struct Whole(Target);

#[derive(Debug)]
enum Target {
    Direct(File),
    Beside {
        part: NamedTempFile,
        file: PathBuf,
    },
    /// It is in its place.
    Done,
}

impl Whole {
    /// Begins to write `file`.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn create(file: &Path) -> io::Result<Self> {
        if is_direct(file) {
            // A descriptor of ours may lead to a file that holds something already.
            let direct = OpenOptions::new().append(true).open(file)?;
            return Ok(Self(Target::Direct(direct)));
        }
        let file = destination(file);
        let part = Builder::new()
            .prefix(".cardan-")
            .suffix(".partial")
            .permissions(Permissions::from_mode(NEW))
            .tempfile_in(folder(&file))?;
        if let Ok(old) = fs::metadata(&file) {
            part.as_file().set_permissions(old.permissions())?;
        }
        Ok(Self(Target::Beside { part, file }))
    }

    /// The folder in which a file comes to be; none for what is written directly.
    pub(crate) fn folder_of(file: &Path) -> Option<PathBuf> {
        (!is_direct(file)).then(|| folder(&destination(file)).to_owned())
    }

    /// Puts the file in its place. What a disk refuses only now is an error too.
    ///
    /// # Errors
    /// The system's; the old file is as it was.
    pub(crate) fn commit(&mut self) -> io::Result<()> {
        match std::mem::replace(&mut self.0, Target::Done) {
            Target::Done => Ok(()),
            Target::Direct(mut file) => file.flush(),
            Target::Beside { part, file } => {
                match part.as_file().sync_all() {
                    // Some file systems have nothing to synchronise.
                    Err(error) if error.kind() == io::ErrorKind::Unsupported => {}
                    synchronised => synchronised?,
                }
                part.persist(file).map_err(|error| error.error)?;
                Ok(())
            }
        }
    }
}

impl Write for Whole {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.0 {
            Target::Direct(file) => file.write(bytes),
            Target::Beside { part, .. } => part.write(bytes),
            Target::Done => Err(io::Error::other("the file is complete")),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.0 {
            Target::Direct(file) => file.flush(),
            Target::Beside { part, .. } => part.flush(),
            Target::Done => Ok(()),
        }
    }
}

/// True for what cannot be replaced by another file: pipes, devices, our own descriptors.
pub(super) fn is_direct(file: &Path) -> bool {
    let is_descriptor = ["/dev/stdout", "/dev/stderr", "/dev/fd", "/proc"];
    let is_descriptor = is_descriptor.iter().any(|start| file.starts_with(start));
    is_descriptor || fs::metadata(file).is_ok_and(|there| !there.is_file() && !there.is_dir())
}

/// The file that a link leads to, whether it is there or not: the link itself stays.
pub(super) fn destination(file: &Path) -> PathBuf {
    let mut file = file.to_owned();
    for _ in 0..MOST_LINKS {
        match fs::read_link(&file) {
            Ok(next) => file = folder(&file).join(next),
            Err(_) => break,
        }
    }
    file
}

/// The folder of a file.
pub(super) fn folder(file: &Path) -> &Path {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("a folder").flatten();
        let mut names: Vec<_> = entries
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn an_old_file_stays_until_the_new_one_is_complete_and_nothing_is_left_of_a_failure() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("dump.csv");
        fs::write(&file, "old").expect("written");
        fs::set_permissions(&file, Permissions::from_mode(0o640)).expect("ours");
        let mut whole = Whole::create(&file).expect("created");
        whole.write_all(b"ne").expect("written");
        assert_eq!(fs::read(&file).expect("there"), b"old");
        drop(whole);
        assert_eq!(names(folder.path()), ["dump.csv"]);
        let mut whole = Whole::create(&file).expect("created");
        whole.write_all(b"new").expect("written");
        whole.commit().expect("put in its place");
        assert_eq!(fs::read(&file).expect("there"), b"new");
        let mode = fs::metadata(&file).expect("there").permissions().mode();
        assert_eq!(mode & 0o777, 0o640);
        assert_eq!(names(folder.path()), ["dump.csv"]);
    }

    #[test]
    fn a_link_stays_and_what_it_leads_to_is_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let (link, other) = (folder.path().join("link"), folder.path().join("victim"));
        for there in [false, true] {
            if there {
                fs::write(folder.path().join("real"), "old").expect("written");
            }
            let _ = fs::remove_file(&link);
            std::os::unix::fs::symlink("real", &link).expect("linked");
            // A link where an older version put its temporary file.
            fs::write(&other, "kept").expect("written");
            let partial = folder.path().join("real.partial");
            let _ = fs::remove_file(&partial);
            std::os::unix::fs::symlink(&other, &partial).expect("linked");
            let mut whole = Whole::create(&link).expect("created");
            whole.write_all(b"new").expect("written");
            whole.commit().expect("put in its place");
            assert!(link.is_symlink());
            assert_eq!(fs::read(folder.path().join("real")).expect("there"), b"new");
            assert_eq!(fs::read(&other).expect("there"), b"kept");
        }
    }
}
