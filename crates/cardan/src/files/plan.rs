//! What a command reads and writes, checked before its work begins.

use std::fs;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use rustix::fs::{Access, access};

use super::whole::{destination, folder, is_direct};
use crate::failure::Failure;

/// Inputs and outputs of a command, with the options that name them.
#[derive(Debug, Default)]
pub(crate) struct Plan {
    inputs: Vec<(&'static str, PathBuf)>,
    outputs: Vec<(&'static str, PathBuf)>,
    folders: Vec<(&'static str, PathBuf, &'static [&'static str])>,
}

impl Plan {
    /// A file that is read.
    pub(crate) fn input(mut self, option: &'static str, file: Option<&Path>) -> Self {
        let file = file.map(|file| (option, file.to_owned()));
        self.inputs.extend(file);
        self
    }

    /// A file that is written.
    pub(crate) fn output(mut self, option: &'static str, file: Option<&Path>) -> Self {
        let file = file.map(|file| (option, file.to_owned()));
        self.outputs.extend(file);
        self
    }

    /// A folder into which files of these names are written.
    pub(crate) fn folder(
        mut self,
        option: &'static str,
        folder: Option<&Path>,
        files: &'static [&'static str],
    ) -> Self {
        let folder = folder.map(|folder| (option, folder.to_owned(), files));
        self.folders.extend(folder);
        self
    }

    /// Checks everything that can be known before the work.
    ///
    /// # Errors
    /// An output whose folder is missing or cannot be written to, that is a folder, is
    /// write-protected, is an input, or is meant by two options.
    pub(crate) fn check(self) -> Result<(), Failure> {
        let mut outputs = self.outputs;
        for (option, folder, files) in self.folders {
            if let Some((other, _)) = outputs.iter().find(|(_, file)| is_same(file, &folder)) {
                let what = format!("is the file that {other} writes; give a folder");
                return Err(refused(option, &folder, &what));
            }
            let refused = |what: String| refused(option, &folder, &what);
            check_folder(&folder).map_err(refused)?;
            // Nothing can be in the way in a folder that is still to be made.
            if folder.exists() {
                outputs.extend(files.iter().map(|file| (option, folder.join(file))));
            }
        }
        for (at, (option, file)) in outputs.iter().enumerate() {
            let refused = |what: String| refused(option, file, &what);
            check_file(file).map_err(refused)?;
            for (input, other) in &self.inputs {
                if is_same(file, other) {
                    let what = format!("is the input of {input}; give another file");
                    return Err(refused(what));
                }
            }
            for (other, twin) in &outputs[..at] {
                if is_same(file, twin) && !is_direct(file) {
                    let what = format!("is what {other} writes, too; give another file");
                    return Err(refused(what));
                }
            }
        }
        Ok(())
    }
}

fn refused(option: &str, path: &Path, what: &str) -> Failure {
    Failure::input(format!("{option} {}: {what}", path.display()))
}

fn check_file(file: &Path) -> Result<(), String> {
    if file.as_os_str().is_empty() {
        return Err("is empty; give the name of a file".to_owned());
    }
    let is_named_folder = file.as_os_str().as_encoded_bytes().ends_with(b"/");
    if file.is_dir() || is_named_folder {
        return Err("is a folder; give the name of a file in it".to_owned());
    }
    let protected = "cannot be written to; change its permissions, or give another file";
    if let Ok(there) = fs::metadata(file) {
        let kind = there.file_type();
        if kind.is_socket() || kind.is_block_device() {
            return Err("is no file; give the name of a file".to_owned());
        }
        access(file, Access::WRITE_OK).map_err(|error| format!("{protected}: {error}"))?;
    }
    if is_direct(file) {
        let is_there = file.exists();
        return is_there
            .then_some(())
            .ok_or_else(|| "is not there; give the name of a file".to_owned());
    }
    let real = destination(file);
    let folder = folder(&real);
    let shown = folder.display();
    if !folder.exists() {
        return Err(format!(
            "cannot be written: its folder {shown} is not there; make it: mkdir -p {shown}"
        ));
    }
    if !folder.is_dir() {
        return Err(format!("{shown} is no folder; give a file in a folder"));
    }
    probe(folder).map_err(|error| {
        format!("its folder {shown} cannot be written to: {error}; give a file in another")
    })
}

fn check_folder(path: &Path) -> Result<(), String> {
    if path.as_os_str().is_empty() {
        return Err("is empty; give the name of a folder".to_owned());
    }
    let above = path.ancestors().find(|above| above.exists());
    let above = above.filter(|above| !above.as_os_str().is_empty());
    let above = above.unwrap_or(Path::new("."));
    if !above.is_dir() {
        let shown = above.display();
        return Err(format!("{shown} is no folder; give another one"));
    }
    if path.is_symlink() && !path.exists() {
        return Err("is a link that leads nowhere; remove it, or make its folder".to_owned());
    }
    probe(above).map_err(|error| {
        let shown = above.display();
        format!("{shown} cannot be written to: {error}; give another folder")
    })
}

/// Makes a file without a name, which vanishes by itself.
fn probe(folder: &Path) -> std::io::Result<()> {
    tempfile::tempfile_in(folder).map(drop)
}

/// Both names lead to one file; or would, if it were there.
fn is_same(one: &Path, other: &Path) -> bool {
    match (fs::metadata(one), fs::metadata(other)) {
        (Ok(one), Ok(other)) => {
            one.is_file() && (one.dev(), one.ino()) == (other.dev(), other.ino())
        }
        (Err(_), Err(_)) => place(one) == place(other),
        _ => false,
    }
}

fn place(file: &Path) -> Option<PathBuf> {
    let file = destination(file);
    let folder = folder(&file);
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    Some(folder.join(file.file_name()?))
}
