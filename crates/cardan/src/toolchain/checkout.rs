//! Which firmware sources are meant. Written to is only the checkout that the user stands in or names;
//! sources that came with the program are read, and what is built of them goes into the user's cache.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::BOARDS;
use crate::failure::Failure;

/// Sources of the package that a program is installed from, seen from the program's own folder.
const INSTALLED: &str = "../share/cardan/sources";
/// Name of the reference board's package: by it a checkout is recognised.
const PACKAGE: &str = "cardan-atmega328p";
/// The deployed formats, in a checkout.
const WORDLENGTHS: &str = "firmware/wordlengths.toml";

/// Firmware sources, and why these.
#[derive(Clone, Debug)]
pub(crate) struct Checkout {
    root: PathBuf,
    origin: Origin,
}

/// Why these sources are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Origin {
    /// `--checkout` names them.
    Named,
    /// The current folder lies in them.
    Around,
    /// They came with this program.
    Bundled,
}

/// The sources of a build as its JSON document names them.
#[derive(Serialize)]
pub(crate) struct Places {
    /// Root of the firmware sources.
    sources: PathBuf,
    /// Where the build writes.
    build_folder: PathBuf,
}

impl Checkout {
    /// The sources to read: what `named` (`--checkout`) says, else the checkout around the current folder,
    /// else the sources that came with this program.
    ///
    /// # Errors
    /// None of them, or a named folder that is no checkout.
    pub(crate) fn to_read(named: Option<&Path>) -> Result<Self, Failure> {
        if let Some(own) = Self::own(named)? {
            return Ok(own);
        }
        bundled().ok_or_else(|| {
            Failure::input(format!(
                "no firmware sources: neither the current folder nor one above it is a checkout of Cardan's \
                 repository ({}), and none came with this program; change into one, or name it with \
                 --checkout DIR",
                Path::new(BOARDS[0].folder).join("Cargo.toml").display()
            ))
        })
    }

    /// The sources to write to, for the option `purpose`: what `named` says, else the checkout around the
    /// current folder.
    ///
    /// # Errors
    /// The user stands in no checkout, or names a folder that is none.
    pub(crate) fn to_write(named: Option<&Path>, purpose: &str) -> Result<Self, Failure> {
        Self::own(named)?.ok_or_else(|| {
            Failure::input(format!(
                "{purpose}: expected a checkout of Cardan's repository around the current folder; change into \
                 one, or name the one that is meant with --checkout DIR"
            ))
        })
    }

    /// The checkout that the user means, if there is one.
    ///
    /// # Errors
    /// `named` is no checkout.
    pub(crate) fn own(named: Option<&Path>) -> Result<Option<Self>, Failure> {
        let with = |origin| move |root| Self { root, origin };
        let Some(named) = named else {
            let here = std::env::current_dir().unwrap_or_default();
            let around = here.ancestors().find_map(recognised);
            return Ok(around.map(with(Origin::Around)));
        };
        recognised(named)
            .map(with(Origin::Named))
            .map(Some)
            .ok_or_else(|| {
                Failure::input(format!(
                    "--checkout {}: no checkout of Cardan's repository; expected the folder that holds {} and \
                     {WORDLENGTHS}",
                    named.display(),
                    BOARDS[0].folder
                ))
            })
    }

    /// Its root.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// Its file of deployed formats.
    pub(crate) fn wordlengths(&self) -> PathBuf {
        self.root.join(WORDLENGTHS)
    }

    /// Where a build of these sources writes: Cargo's target folder, or the user's cache for sources that
    /// are not the user's.
    ///
    /// # Errors
    /// The system names no cache.
    pub(crate) fn build_folder(&self) -> Result<PathBuf, Failure> {
        let variable = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
        if let Some(folder) = variable("CARGO_TARGET_DIR") {
            return Ok(std::path::absolute(&folder).unwrap_or_else(|_| folder.into()));
        }
        if self.origin != Origin::Bundled {
            return Ok(self.root.join("target"));
        }
        let cache = variable("XDG_CACHE_HOME").map(PathBuf::from);
        let cache = cache.filter(|folder| folder.is_absolute());
        let home = || variable("HOME").map(|home| PathBuf::from(home).join(".cache"));
        let cache = cache.or_else(home).ok_or_else(|| {
            Failure::input("no folder to build in: set CARGO_TARGET_DIR, XDG_CACHE_HOME or HOME")
        })?;
        Ok(cache.join("cardan"))
    }

    /// Both places.
    ///
    /// # Errors
    /// As [`Checkout::build_folder`].
    pub(crate) fn places(&self) -> Result<Places, Failure> {
        Ok(Places {
            sources: self.root.clone(),
            build_folder: self.build_folder()?,
        })
    }

    /// One line that says whose sources are read, and where is written.
    ///
    /// # Errors
    /// As [`Checkout::build_folder`].
    pub(crate) fn told(&self) -> Result<String, Failure> {
        let into = self.build_folder()?;
        Ok(format!("building {self}, into {}", into.display()))
    }
}

impl fmt::Display for Checkout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let root = self.root.display();
        match self.origin {
            Origin::Named => write!(f, "the checkout {root} (--checkout)"),
            Origin::Around => write!(f, "the checkout {root} (around the current folder)"),
            Origin::Bundled => write!(f, "the sources {root} (they came with this program)"),
        }
    }
}

/// The absolute path of `folder`, if it is a checkout.
fn recognised(folder: &Path) -> Option<PathBuf> {
    let manifest = folder.join(BOARDS[0].folder).join("Cargo.toml");
    let manifest: toml::Table = std::fs::read_to_string(manifest).ok()?.parse().ok()?;
    let name = manifest.get("package")?.get("name")?.as_str()?;
    let is_ours = name == PACKAGE && folder.join(WORDLENGTHS).is_file();
    is_ours.then(|| folder.canonicalize().ok())?
}

/// The sources beside the installed program; for a program in a checkout's target folder that checkout.
fn bundled() -> Option<Checkout> {
    let program = std::env::current_exe().ok()?.canonicalize().ok()?;
    let folder = program.parent()?;
    let root =
        recognised(&folder.join(INSTALLED)).or_else(|| folder.ancestors().find_map(recognised))?;
    Some(Checkout {
        root,
        origin: Origin::Bundled,
    })
}
