//! The installed tree as it lies in the package.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::{MAINTAINER, VERSION, done, read};
use crate::licences;
use crate::shell::{command, first_line, output, root, run};

/// Folders whose files make firmware images.
const SOURCES: [&str; 4] = ["firmware", "crates/units", "crates/spec", "crates/datapath"];
/// Members of the workspace among them.
const MEMBERS: &str =
    "members = [\"firmware\", \"crates/units\", \"crates/spec\", \"crates/datapath\"]";
/// Where the package's documents lie.
const DOC: &str = "usr/share/doc/cardan";

/// A folder being filled; all of its files get one time.
pub(super) struct Tree {
    folder: PathBuf,
    epoch: u64,
}

impl Tree {
    pub(super) fn new(folder: PathBuf, epoch: u64) -> Self {
        Self { folder, epoch }
    }

    /// The place of `name` in it.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Writes a file.
    pub(super) fn write(&self, name: &str, content: impl AsRef<[u8]>) -> Result<(), String> {
        let file = self.path(name);
        let failed = |error: std::io::Error| format!("{}: {error}", file.display());
        fs::create_dir_all(file.parent().unwrap_or(&file)).map_err(failed)?;
        fs::write(&file, content).map_err(failed)
    }

    /// Compresses a file that was written, as Debian wants it of pages and changelogs.
    fn gzip(&self, name: &str) -> Result<(), String> {
        let file = self.path(name).display().to_string();
        done(
            run(command("gzip", &["--no-name", "--best", "--force", &file]))?,
            "gzip",
        )
    }

    /// Sets mode and time of every file: they must not depend on the user's mask and clock.
    pub(super) fn finish(&self) -> Result<(), String> {
        let time = SystemTime::UNIX_EPOCH + Duration::from_secs(self.epoch);
        let program = self.path("usr/bin/cardan");
        each(&self.folder, &mut |path| {
            let mode = if path.is_dir() || path == program {
                0o755
            } else {
                0o644
            };
            fs::set_permissions(path, fs::Permissions::from_mode(mode))?;
            fs::File::open(path)?.set_modified(time)
        })
    }

    /// Size of what is in `name`, in KiB.
    pub(super) fn kibibytes(&self, name: &str) -> Result<u64, String> {
        let mut bytes = 0;
        each(&self.path(name), &mut |path| {
            bytes += if path.is_file() {
                fs::metadata(path)?.len()
            } else {
                0
            };
            Ok(())
        })?;
        Ok(bytes.div_ceil(1024))
    }

    /// Check sums of all installed files.
    pub(super) fn md5sums(&self) -> Result<String, String> {
        let mut names = Vec::new();
        each(&self.path("usr"), &mut |path| {
            if path.is_file() {
                let name = path.strip_prefix(&self.folder).unwrap_or(path);
                names.push(name.display().to_string());
            }
            Ok(())
        })?;
        names.sort();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let mut sums = command("md5sum", &names);
        sums.current_dir(&self.folder);
        output(sums)
    }
}

/// Does `what` to a folder's content and to the folder.
fn each(folder: &Path, what: &mut dyn FnMut(&Path) -> std::io::Result<()>) -> Result<(), String> {
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_dir() {
            each(&path, what)?;
        } else {
            what(&path).map_err(failed)?;
        }
    }
    what(folder).map_err(failed)
}

/// Puts program, pages, completions, documents, examples and the firmware's sources into the tree.
pub(super) fn fill(tree: &Tree, program: &Path) -> Result<(), String> {
    let bytes = fs::read(program).map_err(|error| format!("{}: {error}", program.display()))?;
    tree.write("usr/bin/cardan", bytes)?;
    let said = |arguments: &[&str]| output(command(program, arguments));
    for (shell, file) in [
        ("bash", "usr/share/bash-completion/completions/cardan"),
        ("zsh", "usr/share/zsh/vendor-completions/_cardan"),
        ("fish", "usr/share/fish/vendor_completions.d/cardan.fish"),
    ] {
        tree.write(file, said(&["completions", shell])?)?;
    }
    let pages = tree.path("usr/share/man/man1");
    said(&["man", "--quiet", "--out", &pages.display().to_string()])?;
    let mut names = Vec::new();
    each(&pages, &mut |path| {
        names.extend(path.is_file().then(|| path.to_owned()));
        Ok(())
    })?;
    for page in names {
        let name = page.strip_prefix(&tree.folder).unwrap_or(&page);
        tree.gzip(&name.display().to_string())?;
    }
    documents(tree)?;
    for folder in SOURCES {
        copy(tree, folder, "usr/share/cardan/sources")?;
    }
    tree.write("usr/share/cardan/sources/Cargo.toml", manifest()?)
}

fn documents(tree: &Tree) -> Result<(), String> {
    for name in ["README.md", "LICENSE-MIT", "LICENSE-APACHE"] {
        tree.write(&format!("{DOC}/{name}"), read(name)?)?;
    }
    copy(tree, "docs", DOC)?;
    copy(tree, "examples", DOC)?;
    let list = format!("{DOC}/THIRD-PARTY-LICENCES");
    tree.write(&list, licences::list()?)?;
    tree.write(&format!("{DOC}/copyright"), copyright()?)?;
    let changes = format!("{DOC}/changelog");
    let date = format!("--date=@{}", tree.epoch);
    let date = first_line("date".as_ref(), &["--utc", "--rfc-email", &date], "")
        .ok_or("date gives no date")?;
    let own = read("CHANGELOG.md")?;
    tree.write(&format!("{DOC}/CHANGELOG.md"), own)?;
    let entry = format!(
        "cardan ({VERSION}) unstable; urgency=medium\n\n  * Release {VERSION}: see CHANGELOG.md.\n\n -- \
         {MAINTAINER}  {date}\n"
    );
    tree.write(&changes, entry)?;
    tree.gzip(&changes)
}

/// Debian's copyright file: our own licences; those of the crates stand in the list.
fn copyright() -> Result<String, String> {
    let mit = String::from_utf8_lossy(&read("LICENSE-MIT")?).into_owned();
    let indented: Vec<String> = mit
        .lines()
        .map(|line| {
            if line.is_empty() {
                " .".to_owned()
            } else {
                format!(" {line}")
            }
        })
        .collect();
    Ok(format!(
        "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\nUpstream-Name: cardan\n\
         Comment: Crates that are linked into the program: THIRD-PARTY-LICENCES beside this file.\n\n\
         Files: *\nCopyright: the Cardan authors\nLicense: MIT or Apache-2.0\n\n\
         License: MIT\n{}\n\nLicense: Apache-2.0\n On Debian systems the full text is in\n \
         /usr/share/common-licenses/Apache-2.0.\n",
        indented.join("\n")
    ))
}

/// The workspace's manifest with the members that are there.
fn manifest() -> Result<String, String> {
    let text = String::from_utf8_lossy(&read("Cargo.toml")?).into_owned();
    let unexpected =
        "Cargo.toml: expected the lists `members` and `default-members` of the workspace";
    let (head, rest) = text.split_once("members = [").ok_or(unexpected)?;
    let (_, rest) = rest.split_once("]\n").ok_or(unexpected)?;
    let rest: Vec<&str> = rest
        .lines()
        .filter(|line| !line.starts_with("default-members"))
        .collect();
    Ok(format!("{head}{MEMBERS}\n{}\n", rest.join("\n")))
}

/// Copies a folder of the workspace with all below it, except committed images and what somebody has built
/// beside the sources.
fn copy(tree: &Tree, folder: &str, into: &str) -> Result<(), String> {
    let failed = |error: std::io::Error| format!("{folder}: {error}");
    for entry in fs::read_dir(root().join(folder)).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let inner = format!("{folder}/{name}");
        // Cargo marks its target folders.
        let is_made = name == "images" || path.join("CACHEDIR.TAG").is_file();
        if path.is_dir() && !is_made {
            copy(tree, &inner, into)?;
        } else if path.is_file() && !name.ends_with(".elf") && !name.ends_with(".o") {
            tree.write(&format!("{into}/{inner}"), read(&inner)?)?;
        }
    }
    Ok(())
}
