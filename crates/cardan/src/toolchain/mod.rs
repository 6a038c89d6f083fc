//! The cross toolchain: finds it, and builds board images with it that are the same wherever the
//! checkout lies.

mod checkout;
mod compile;
mod digest;
mod elf;
mod find;
mod kept;
mod metadata;
mod probe;
mod record;
mod sources;

use std::path::{Path, PathBuf};

use cardan_datapath::wordlengths::DeclaredNode;
use cardan_datapath::{Format, NodeInfo};

pub(crate) use checkout::{Checkout, Places};
pub(crate) use elf::sizes;
pub(crate) use find::{Candidate, Missing, compilers, find, lld};
pub(crate) use probe::{first_line, runs};
pub(crate) use record::{Recorded, Versions, hex_digest};
pub(crate) use sources::reference_digest;

use crate::failure::Failure;

/// A target of the firmware: a package outside the workspace.
#[derive(Debug)]
pub(crate) struct Board {
    /// Name, as in `--target`.
    pub(crate) name: &'static str,
    /// Its folder in the workspace.
    folder: &'static str,
    /// Folders of other packages that only boards use.
    shared: &'static [&'static str],
    /// Compiler target.
    pub(crate) triple: &'static str,
    /// What its programs run in here.
    pub(crate) runs_in: Runs,
}

/// What runs a board's programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Runs {
    /// This program's emulator: the reference board.
    Emulator,
    /// QEMU, on recorded codes (`firmware/boards/replay`).
    Qemu,
}

/// What boards on QEMU share.
const REPLAY: &[&str] = &["firmware/boards/replay"];

/// All targets; the first is the reference.
pub(crate) const BOARDS: [Board; 4] = [
    Board {
        name: "atmega328p",
        folder: digest::REFERENCE,
        shared: &[],
        triple: "avr-none",
        runs_in: Runs::Emulator,
    },
    Board {
        name: "cortex-m0plus",
        folder: "firmware/boards/cortex-m0plus",
        shared: REPLAY,
        triple: "thumbv6m-none-eabi",
        runs_in: Runs::Qemu,
    },
    Board {
        name: "cortex-m4",
        folder: "firmware/boards/cortex-m4",
        shared: REPLAY,
        triple: "thumbv7em-none-eabi",
        runs_in: Runs::Qemu,
    },
    Board {
        name: "rv32imc",
        folder: "firmware/boards/rv32imc",
        shared: REPLAY,
        triple: "riscv32imc-unknown-none-elf",
        runs_in: Runs::Qemu,
    },
];

/// An image as the toolchain made it.
#[derive(Clone, Debug)]
pub(crate) struct Built {
    /// ELF file with symbols, without debug information.
    pub(crate) elf: Vec<u8>,
    /// Where it lies.
    pub(crate) file: PathBuf,
}

/// Builds one image of `board` from `checkout`: with taps or without, in the formats of `wordlengths` or in the
/// deployed ones. Cargo's messages go to standard error unless `is_quiet`.
///
/// # Errors
/// No toolchain, no sources, or a build that fails; the message says what to do.
pub(crate) fn build_board(
    checkout: &Checkout,
    board: &Board,
    is_tapped: bool,
    wordlengths: Option<&[DeclaredNode]>,
    is_quiet: bool,
) -> Result<Built, Failure> {
    let compiler = find(board).map_err(Failure::input)?;
    compile::image(&compiler, checkout, board, is_tapped, wordlengths, is_quiet)
}

/// Builds the on-target tests of `board` and runs them in the emulator. Their report goes to standard
/// output, or aside to standard error. Returns whether all passed.
///
/// # Errors
/// No toolchain, or no sources; the message says what to do.
pub(crate) fn test_board(
    checkout: &Checkout,
    board: &Board,
    is_quiet: bool,
    is_reported_aside: bool,
) -> Result<bool, Failure> {
    let compiler = find(board).map_err(Failure::input)?;
    compile::tests(&compiler, checkout, board, is_quiet, is_reported_aside)
}

/// A firmware's nodes in other formats, in the order of the firmware.
pub(crate) fn declared(nodes: &[NodeInfo], formats: &[Format]) -> Vec<DeclaredNode> {
    let pairs = nodes.iter().zip(formats);
    let declared = pairs.map(|(node, &format)| DeclaredNode {
        name: node.name.to_owned(),
        unit: node.unit.to_owned(),
        meaning: node.meaning.to_owned(),
        format,
    });
    declared.collect()
}

/// What an image of `board` is built with and from, for the record beside it.
pub(crate) fn record(
    checkout: &Checkout,
    board: &Board,
    plain: &[u8],
    tapped: &[u8],
) -> Result<Recorded, Failure> {
    let compiler = find(board).map_err(Failure::input)?;
    record::of(&compiler, checkout.root(), board, plain, tapped)
}

/// The command that runs a program of `board`, without the program: its Cargo's runner.
///
/// # Errors
/// No sources, or a configuration of Cargo's without one.
pub(crate) fn runner(checkout: &Checkout, board: &Board) -> Result<Vec<String>, Failure> {
    let file = checkout
        .root()
        .join(board.folder)
        .join(".cargo/config.toml");
    let text = std::fs::read_to_string(&file)
        .map_err(|error| unusable(&file, "cannot be read", &error))?;
    let table: toml::Table = text
        .parse()
        .map_err(|error| unusable(&file, "is no TOML", &error))?;
    let words = table
        .get("target")
        .and_then(|targets| targets.get(board.triple)?.get("runner")?.as_array())
        .map(|words| words.iter().filter_map(|word| word.as_str()));
    let words: Vec<String> = words.into_iter().flatten().map(str::to_owned).collect();
    if words.is_empty() {
        let expected = format!("expected a list [target.{}] runner", board.triple);
        return Err(unusable(&file, "names no runner", &expected));
    }
    Ok(words)
}

/// A file of the workspace that could not be used.
fn unusable(file: &Path, what: &str, error: &dyn std::fmt::Display) -> Failure {
    Failure::input(format!("{}: {what}: {error}", file.display()))
}
