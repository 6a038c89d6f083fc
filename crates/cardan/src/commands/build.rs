//! `build`: cross-compiles the firmware, and says what it needs of the controller.

pub(crate) mod measure;
mod report;
mod simulate;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use cardan_bench::App;
use cardan_bench::app::by_name;
use cardan_datapath::wordlengths::{self, DeclaredNode};
use clap::Args;

use self::measure::measure_both;
use self::report::{Document, ImageReport, TargetReport};
use crate::failure::{Done, Failure, code};
use crate::files::{Plan, make_folder, read_text, write_whole};
use crate::output::Output;
use crate::toolchain::{self, BOARDS, Board, Built, Runs};

/// Cross-compiles the firmware to its targets: flash, RAM, stack and cycles of each image.
///
/// Both images of a target are built: plain, and tapped (which publishes every node value). Stack
/// and cycles are measured: the image runs in the emulator while its inputs step through the whole
/// range. ARM and RISC-V programs work on recorded codes; QEMU runs them, which counts no cycles.
/// Needs a cross toolchain; `cardan doctor` says which parts are missing.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Application: the algorithm with its board.
    #[arg(long, value_name = "NAME", default_value = "attitude")]
    app: String,
    /// Target, or `all`.
    #[arg(long, value_name = "NAME|all", default_value = "all", value_parser = targets)]
    target: Targets,
    /// Formats other than those of the firmware's own word-length file.
    #[arg(long, value_name = "FILE")]
    wordlengths: Option<PathBuf>,
    /// Writes plain.elf, tapped.elf and toolchain.toml (what they were built with, and from) into
    /// this folder; with `--target all` into a folder per target.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Instead of images, builds the own tests of the targets that have some (atmega328p) and runs
    /// them in the emulator; exits with 1 if one fails.
    #[arg(long, conflicts_with_all = ["wordlengths", "out"])]
    test: bool,
}

/// The value of `--target`.
#[derive(Clone, Debug)]
enum Targets {
    All,
    One(&'static Board),
}

fn targets(name: &str) -> Result<Targets, String> {
    if name == "all" {
        return Ok(Targets::All);
    }
    let found = BOARDS.iter().find(|board| board.name == name);
    found.map(Targets::One).ok_or_else(|| {
        let names: Vec<&str> = BOARDS.iter().map(|board| board.name).collect();
        format!(
            "no such target; expected all or one of {}",
            names.join(", ")
        )
    })
}

/// Runs the command.
pub(crate) fn execute(arguments: &Arguments, output: Output) -> Done {
    let app = by_name(&arguments.app).map_err(Failure::input)?;
    let nodes = match &arguments.wordlengths {
        Some(file) => Some(formats(file, app)?),
        None => None,
    };
    let boards: Vec<&Board> = match arguments.target {
        Targets::All => BOARDS.iter().collect(),
        Targets::One(board) => vec![board],
    };
    if arguments.test {
        return test(&boards, output);
    }
    let mut plan = Plan::default().input("--wordlengths", arguments.wordlengths.as_deref());
    for board in &boards {
        plan = plan.folder("--out", out(arguments, board).as_deref(), &FILES);
    }
    plan.check()?;
    // Before the first build takes its minutes.
    for board in &boards {
        toolchain::find(board).map_err(Failure::input)?;
    }
    let mut reports = Vec::new();
    for board in boards {
        let folder = out(arguments, board);
        reports.push(target(board, nodes.as_deref(), folder.as_deref(), output)?);
    }
    let document = Document::new(reports);
    if output.is_json() {
        output.document(&document)?;
    }
    output.result(&document.to_string())?;
    Ok(ExitCode::SUCCESS)
}

/// Files of `--out`.
const FILES: [&str; 3] = ["plain.elf", "tapped.elf", "toolchain.toml"];

/// The board's folder of `--out`.
fn out(arguments: &Arguments, board: &Board) -> Option<PathBuf> {
    let out = arguments.out.as_ref()?;
    Some(match arguments.target {
        Targets::All => out.join(board.name),
        Targets::One(_) => out.clone(),
    })
}

/// Runs the targets' own tests. Programs for QEMU have none: what they compute is compared with what
/// the host does.
fn test(boards: &[&Board], output: Output) -> Done {
    let (tested, others): (Vec<&Board>, Vec<&Board>) = boards
        .iter()
        .partition(|board| board.runs_in == Runs::Emulator);
    let names: Vec<&str> = others.iter().map(|board| board.name).collect();
    let names = names.join(", ");
    if tested.is_empty() {
        return Err(Failure::input(format!(
            "--test: {names} has no tests of its own; expected atmega328p or all"
        )));
    }
    if !others.is_empty() {
        output.note(&format!("without tests of their own: {names}"));
    }
    let mut passed = true;
    let mut results = serde_json::Map::new();
    for board in tested {
        let is_good = toolchain::test_board(board, output.is_quiet(), output.is_json())?;
        results.insert(board.name.to_owned(), is_good.into());
        passed &= is_good;
    }
    if output.is_json() {
        output.document(&serde_json::json!({ "tests_passed": results }))?;
    }
    Ok(ExitCode::from(if passed { code::PASS } else { code::FAIL }))
}

/// Builds, measures and, where wanted, writes one target's images.
fn target(
    board: &'static Board,
    nodes: Option<&[DeclaredNode]>,
    folder: Option<&Path>,
    output: Output,
) -> Result<TargetReport, Failure> {
    let build = |is_tapped| toolchain::build_board(board, is_tapped, nodes, output.is_quiet());
    let (plain, tapped) = (build(false)?, build(true)?);
    if let Some(folder) = folder {
        write(board, folder, &plain, &tapped)?;
    }
    let runner = match board.runs_in {
        Runs::Emulator => Vec::new(),
        Runs::Qemu => toolchain::runner(board)?,
    };
    let mut remarks = Vec::new();
    let mut images = Vec::new();
    for (name, built) in [("plain", &plain), ("tapped", &tapped)] {
        let measured = match board.runs_in {
            Runs::Emulator => measure_both(&built.file.display().to_string(), &built.elf)?,
            Runs::Qemu => simulate::measure(built, &runner, &mut remarks)?,
        };
        images.push(ImageReport::new(name, built, measured));
    }
    let toolchain = toolchain::find(board).map_err(Failure::input)?.versions;
    Ok(TargetReport {
        target: board.name,
        toolchain,
        runner: (!runner.is_empty()).then_some(runner),
        remarks,
        images,
    })
}

fn write(board: &Board, folder: &Path, plain: &Built, tapped: &Built) -> Result<(), Failure> {
    let record = toolchain::record(board, &plain.elf, &tapped.elf)?.to_toml()?;
    let put = |name: &str, bytes: &[u8]| {
        let file = folder.join(name);
        write_whole("--out", &file, bytes)
    };
    make_folder("--out", folder)?;
    put("plain.elf", &plain.elf)?;
    put("tapped.elf", &tapped.elf)?;
    put("toolchain.toml", record.as_bytes())
}

/// Reads a word-length file into the order of the application's nodes.
fn formats(file: &Path, app: &'static dyn App) -> Result<Vec<DeclaredNode>, Failure> {
    let name = file.display().to_string();
    let text = read_text(file)?;
    let declared = wordlengths::parse(&text, &name).map_err(Failure::input)?;
    let formats = wordlengths::align(&declared, app.nodes(), &name).map_err(Failure::input)?;
    Ok(toolchain::declared(app.nodes(), &formats))
}
