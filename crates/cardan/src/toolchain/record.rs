//! The record beside committed images: what they were built with, and from what.

use std::fmt;
use std::fs;
use std::path::Path;

use cardan_bench::image::FormatTable;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::{Board, find::Compiler, sources, unusable};
use crate::failure::Failure;

/// First lines of the file.
const HEADER: &str = "# What the images beside this file were built with, and from what. Written by \
                      `cargo xtask images`.\n\n";

/// Versions of every part of the toolchain that leaves a mark in an image.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Versions {
    /// Compiler.
    pub(crate) rustc: String,
    /// Its code generator.
    pub(crate) llvm: String,
    /// Build tool.
    pub(crate) cargo: String,
    /// AVR: linker driver.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) avr_gcc: Option<String>,
    /// AVR: assembler and linker.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) binutils: Option<String>,
    /// AVR: C library, of which the start-up code is linked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) avr_libc: Option<String>,
    /// ARM and RISC-V: linker.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) lld: Option<String>,
}

impl fmt::Display for Versions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            rustc,
            llvm,
            cargo,
            avr_gcc,
            binutils,
            avr_libc,
            lld,
        } = self;
        write!(f, "{rustc}, LLVM {llvm}, {cargo}")?;
        for part in [avr_gcc, binutils, lld].into_iter().flatten() {
            write!(f, ", {part}")?;
        }
        match avr_libc {
            Some(version) => write!(f, ", avr-libc {version}"),
            None => Ok(()),
        }
    }
}

/// `toolchain.toml`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Recorded {
    /// With what.
    pub(crate) toolchain: Versions,
    /// From what.
    pub(crate) sources: Sources,
    /// The results.
    pub(crate) images: Images,
}

/// What the images were built from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Sources {
    /// SHA-256 over the names and contents of all files of firmware and board.
    pub(crate) sha256: String,
    /// SHA-256 of the board's lock file.
    pub(crate) lock_sha256: String,
    /// AVR: version of the register definitions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) avr_device: Option<String>,
    /// Hash of the node formats.
    pub(crate) formats: String,
}

/// Both images.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Images {
    /// Without taps.
    pub(crate) plain: Digested,
    /// With taps.
    pub(crate) tapped: Digested,
}

/// An image file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Digested {
    /// SHA-256 of the file.
    pub(crate) sha256: String,
    /// Size of the file.
    pub(crate) bytes: usize,
}

impl Digested {
    fn of(bytes: &[u8]) -> Self {
        Self {
            sha256: hex_digest(bytes),
            bytes: bytes.len(),
        }
    }
}

impl Recorded {
    /// The file's text.
    pub(crate) fn to_toml(&self) -> Result<String, Failure> {
        let text = toml::to_string(self).map_err(Failure::input)?;
        Ok(format!("{HEADER}{text}"))
    }
}

/// The record of two images of `board`.
pub(super) fn of(
    compiler: &Compiler,
    workspace: &Path,
    board: &Board,
    plain: &[u8],
    tapped: &[u8],
) -> Result<Recorded, Failure> {
    let lock = workspace.join(board.folder).join("Cargo.lock");
    let text =
        fs::read_to_string(&lock).map_err(|error| unusable(&lock, "cannot be read", &error))?;
    let formats = formats_hash(board, plain)?;
    Ok(Recorded {
        toolchain: compiler.versions.clone(),
        sources: Sources {
            sha256: sources::digest(workspace, board)?,
            lock_sha256: hex_digest(text.as_bytes()),
            avr_device: locked_version(&text, "avr-device"),
            formats: format!("{formats:016x}"),
        },
        images: Images {
            plain: Digested::of(plain),
            tapped: Digested::of(tapped),
        },
    })
}

/// The hash in the format table of an image of `board`.
fn formats_hash(board: &Board, plain: &[u8]) -> Result<u64, Failure> {
    let name = format!("the plain image of {}", board.name);
    let table = FormatTable::of(&name, plain).map_err(Failure::input)?;
    let missing = || Failure::input(format!("{name} carries no format table"));
    Ok(table.ok_or_else(missing)?.hash)
}

/// Version of package `name` in the text of a lock file.
fn locked_version(lock: &str, name: &str) -> Option<String> {
    #[derive(Deserialize)]
    struct Lock {
        package: Vec<Package>,
    }
    #[derive(Deserialize)]
    struct Package {
        name: String,
        version: String,
    }
    let lock: Lock = toml::from_str(lock).ok()?;
    let package = lock
        .package
        .into_iter()
        .find(|package| package.name == name)?;
    Some(package.version)
}

/// SHA-256 of `bytes` as hexadecimal digits.
pub(crate) fn hex_digest(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Hexadecimal digits.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
