//! `build`: cross-compiles the firmware, and says what it needs of the controller.

mod left_out;
pub(crate) mod measure;
mod report;
mod simulate;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use cardan_bench::App;
use cardan_bench::app::by_name;
use cardan_datapath::wordlengths::{self, DeclaredNode};
use clap::Args;

use self::left_out::{LeftOut, listed};
use self::measure::measure_both;
use self::report::{Document, ImageReport, TargetReport};
use crate::failure::{Done, Failure, code};
use crate::files::{Plan, make_folder, read_text, write_whole};
use crate::output::Output;
use crate::toolchain::{self, BOARDS, Board, Built, Checkout, Runs};

/// Cross-compiles the firmware to its targets: flash, RAM, stack and cycles of each image.
///
/// Both images of a target are built: plain, and tapped (which publishes every node value). Stack
/// and cycles are measured: the image runs in the emulator while its inputs step through the whole
/// range. ARM and RISC-V programs work on recorded codes; QEMU runs them, which counts no cycles.
/// Needs a cross toolchain; `cardan doctor` says which parts are missing. `all` builds the targets whose
/// toolchain is there, and lists the others with what installs theirs.
///
/// The firmware is that of the checkout around the current folder, and what is built goes into its target
/// folder. Outside a checkout it is the firmware that came with this program, built in the user's cache.
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
    /// Checkout of Cardan's repository to build, instead of the one around the current folder.
    #[arg(long, value_name = "DIR")]
    checkout: Option<PathBuf>,
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
    let checkout = Checkout::to_read(arguments.checkout.as_deref())?;
    if arguments.test {
        return test(&checkout, &boards, output);
    }
    let mut plan = Plan::default().input("--wordlengths", arguments.wordlengths.as_deref());
    for board in &boards {
        plan = plan.folder("--out", out(arguments, board).as_deref(), &FILES);
    }
    plan.check()?;
    // Before the first build takes its minutes.
    let (boards, mut left_out) = buildable(boards)?;
    output.note(&checkout.told()?);
    for one in &left_out {
        output.note(&format!("not built: {one}"));
    }
    let is_alone = boards.len() + left_out.len() == 1;
    let mut reports = Vec::new();
    for board in boards {
        let folder = out(arguments, board);
        match target(
            &checkout,
            board,
            nodes.as_deref(),
            folder.as_deref(),
            output,
        ) {
            Ok(report) => reports.push(report),
            Err(failure) if is_alone => return Err(failure),
            Err(failure) => left_out.push(LeftOut::failed(board, &failure)),
        }
    }
    if reports.is_empty() {
        return Err(Failure::input(listed(&left_out)));
    }
    let code = if left_out.is_empty() {
        code::PASS
    } else {
        code::FAIL
    };
    let document = Document::new(checkout.places()?, reports, left_out);
    if output.is_json() {
        output.document(&document)?;
    }
    output.result(&document.to_string())?;
    Ok(ExitCode::from(code))
}

/// The boards whose toolchain is there, and the others with what installs theirs.
///
/// # Errors
/// There is none.
fn buildable(boards: Vec<&'static Board>) -> Result<(Vec<&'static Board>, Vec<LeftOut>), Failure> {
    let mut ready = Vec::new();
    let mut left_out: Vec<LeftOut> = Vec::new();
    let mut first = None;
    for board in boards {
        let Err(missing) = toolchain::find(board) else {
            ready.push(board);
            continue;
        };
        match left_out.iter_mut().find(|one| one.parts == missing.parts) {
            Some(alike) => alike.targets.push(board.name),
            None => left_out.push(LeftOut::missing(board, &missing)),
        }
        first.get_or_insert(missing);
    }
    match (ready.is_empty(), first) {
        (true, Some(first)) if left_out.len() == 1 => Err(Failure::input(first)),
        (true, Some(_)) => Err(Failure::input(format!(
            "nothing can be built:\n{}\n`cardan doctor` shows what is installed and what each part is for",
            listed(&left_out)
        ))),
        _ => Ok((ready, left_out)),
    }
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
fn test(checkout: &Checkout, boards: &[&Board], output: Output) -> Done {
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
    output.note(&checkout.told()?);
    let mut passed = true;
    let mut results = serde_json::Map::new();
    for board in tested {
        let is_good = toolchain::test_board(checkout, board, output.is_quiet(), output.is_json())?;
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
    checkout: &Checkout,
    board: &'static Board,
    nodes: Option<&[DeclaredNode]>,
    folder: Option<&Path>,
    output: Output,
) -> Result<TargetReport, Failure> {
    let build =
        |is_tapped| toolchain::build_board(checkout, board, is_tapped, nodes, output.is_quiet());
    let (plain, tapped) = (build(false)?, build(true)?);
    if let Some(folder) = folder {
        let record = toolchain::record(checkout, board, &plain.elf, &tapped.elf)?;
        write(&record.to_toml()?, folder, &plain, &tapped)?;
    }
    let runner = match board.runs_in {
        Runs::Emulator => Vec::new(),
        Runs::Qemu => toolchain::runner(checkout, board)?,
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

fn write(record: &str, folder: &Path, plain: &Built, tapped: &Built) -> Result<(), Failure> {
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
