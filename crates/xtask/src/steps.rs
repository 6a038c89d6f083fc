//! The checks, in the order in which a mistake shows soonest.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use clap::ValueEnum;

use crate::needs;

/// A check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Step {
    /// Formatting.
    Fmt,
    /// Lints, denied.
    Clippy,
    /// Images of the reference board from source, into the target folder.
    Images,
    /// All tests of all crates.
    Test,
    /// Documentation, warnings denied.
    Doc,
}

/// Root of the workspace.
fn root() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest
        .ancestors()
        .nth(2)
        .map_or_else(PathBuf::new, Path::to_path_buf)
}

fn cargo(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO"));
    command.args(arguments).current_dir(root());
    command
}

fn run(command: &mut Command, what: &str) -> Result<(), String> {
    let started = Instant::now();
    println!("== {what}");
    let status = command
        .status()
        .map_err(|error| format!("{what}: {error}"))?;
    println!(
        "== {what}: {} ({:.0} s)",
        status,
        started.elapsed().as_secs_f64()
    );
    if status.success() {
        Ok(())
    } else {
        Err(format!("{what} failed"))
    }
}

/// Installs and runs the chosen steps, all by default.
///
/// # Errors
/// What could not be installed, or the first step that failed.
pub(crate) fn test(only: &[Step]) -> Result<(), String> {
    let python = needs::install(&root())?;
    let wanted = |step: Step| only.is_empty() || only.contains(&step);
    // One profile throughout: nothing is compiled twice.
    if wanted(Step::Fmt) {
        run(&mut cargo(&["fmt", "--all", "--check"]), "formatting")?;
    }
    if wanted(Step::Clippy) {
        let arguments = [
            "clippy",
            "--release",
            "--workspace",
            "--all-targets",
            "--",
            "-D",
            "warnings",
        ];
        run(&mut cargo(&arguments), "lints")?;
    }
    if wanted(Step::Images) {
        let arguments = [
            "run",
            "--release",
            "--package",
            "cardan",
            "--",
            "build",
            "--quiet",
        ];
        run(&mut cargo(&arguments), "images from source")?;
    }
    if wanted(Step::Test) {
        let mut tests = cargo(&["test", "--release", "--workspace", "--no-fail-fast"]);
        count(tests.env("CARDAN_PYTHON", python))?;
    }
    if wanted(Step::Doc) {
        let mut doc = cargo(&["doc", "--release", "--workspace", "--no-deps", "--quiet"]);
        run(doc.env("RUSTDOCFLAGS", "-D warnings"), "documentation")?;
    }
    Ok(())
}

/// Runs the tests and adds up their results.
fn count(tests: &mut Command) -> Result<(), String> {
    println!("== tests");
    let mut child = tests
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| error.to_string())?;
    let (mut passed, mut failed) = (0_u64, 0_u64);
    let lines = child
        .stdout
        .take()
        .map(BufReader::new)
        .into_iter()
        .flat_map(BufRead::lines);
    for line in lines.map_while(Result::ok) {
        println!("{line}");
        if line.starts_with("test result:") {
            let number = |what: &str| {
                let before = line.split(what).next()?;
                before.split_whitespace().last()?.parse::<u64>().ok()
            };
            passed += number(" passed").unwrap_or(0);
            failed += number(" failed").unwrap_or(0);
        }
    }
    let status = child.wait().map_err(|error| error.to_string())?;
    println!("{passed} passed, {failed} failed");
    if status.success() && failed == 0 && passed > 0 {
        Ok(())
    } else {
        Err(format!("tests: {failed} failed"))
    }
}

/// Rebuilds the committed images.
///
/// # Errors
/// No toolchain, or a build that fails.
pub(crate) fn images() -> Result<(), String> {
    let out = "firmware/boards/atmega328p/images";
    let arguments = [
        "run",
        "--release",
        "--package",
        "cardan",
        "--",
        "build",
        "--target",
        "atmega328p",
        "--out",
        out,
    ];
    run(&mut cargo(&arguments), "images")
}
