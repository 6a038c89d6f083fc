//! The cross toolchain: finds it, and builds board images with it that are the same wherever the
//! checkout lies.

mod compile;
mod find;
mod metadata;
mod probe;
mod record;
mod sources;

use std::path::{Path, PathBuf};

use cardan_datapath::wordlengths::DeclaredNode;
use cardan_datapath::{Format, NodeInfo};

pub(crate) use find::{compilers, find};
pub(crate) use probe::{first_line, runs};
pub(crate) use record::{Recorded, Versions, hex_digest};
pub(crate) use sources::workspace;

use crate::failure::Failure;

/// A target of the firmware: a package outside the workspace.
#[derive(Debug)]
pub(crate) struct Board {
    /// Name, as in `--target`.
    pub(crate) name: &'static str,
    /// Its folder in the workspace.
    folder: &'static str,
    /// Compiler target.
    triple: &'static str,
}

/// All targets.
pub(crate) const BOARDS: [Board; 1] = [Board {
    name: "atmega328p",
    folder: "firmware/boards/atmega328p",
    triple: "avr-none",
}];

/// An image as the toolchain made it.
#[derive(Clone, Debug)]
pub(crate) struct Built {
    /// ELF file with symbols, without debug information.
    pub(crate) elf: Vec<u8>,
    /// Where it lies.
    pub(crate) file: PathBuf,
}

/// Builds one image of `board`: with taps or without, in the formats of `wordlengths` or in the
/// deployed ones. Cargo's messages go to standard error unless `is_quiet`.
///
/// # Errors
/// No toolchain, no sources, or a build that fails; the message says what to do.
pub(crate) fn build_board(
    board: &Board,
    is_tapped: bool,
    wordlengths: Option<&[DeclaredNode]>,
    is_quiet: bool,
) -> Result<Built, Failure> {
    let compiler = find().map_err(Failure::input)?;
    let workspace = workspace()?;
    compile::image(
        &compiler,
        &workspace,
        board,
        is_tapped,
        wordlengths,
        is_quiet,
    )
}

/// Builds the on-target tests of `board` and runs them in the emulator. Their report goes to standard
/// output, or aside to standard error. Returns whether all passed.
///
/// # Errors
/// No toolchain, or no sources; the message says what to do.
pub(crate) fn test_board(
    board: &Board,
    is_quiet: bool,
    is_reported_aside: bool,
) -> Result<bool, Failure> {
    let compiler = find().map_err(Failure::input)?;
    compile::tests(&compiler, &workspace()?, board, is_quiet, is_reported_aside)
}

/// A firmware's nodes in other formats, in the order of the firmware.
pub(crate) fn declared(nodes: &[NodeInfo], formats: &[Format]) -> Vec<DeclaredNode> {
    let pairs = nodes.iter().zip(formats);
    let declared = pairs.map(|(node, &format)| DeclaredNode {
        name: node.name.to_owned(),
        unit: node.unit.to_owned(),
        format,
    });
    declared.collect()
}

/// What an image of `board` is built with and from, for the record beside it.
pub(crate) fn record(board: &Board, plain: &[u8], tapped: &[u8]) -> Result<Recorded, Failure> {
    let compiler = find().map_err(Failure::input)?;
    record::of(&compiler, &workspace()?, board, plain, tapped)
}

/// A file of the workspace that could not be used.
fn unusable(file: &Path, what: &str, error: &dyn std::fmt::Display) -> Failure {
    Failure::input(format!("{}: {what}: {error}", file.display()))
}
