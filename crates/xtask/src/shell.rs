//! Runs programs in the workspace's folder.

use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What recognises the workspace's folder.
const MARK: &str = "crates/xtask/src/shell.rs";

/// The workspace's folder: the one that Cargo runs this program of, else the one around the current folder.
/// Never that which the program was compiled in: it may be another checkout, whose files are not meant.
///
/// # Errors
/// Neither is one.
pub(crate) fn find_root() -> Result<PathBuf, String> {
    let package = std::env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from);
    let here = std::env::current_dir().ok();
    let starts = package.iter().chain(&here);
    let mut folders = starts.flat_map(|start| start.ancestors());
    let found = folders.find(|folder| folder.join(MARK).is_file());
    found.map(Path::to_owned).ok_or_else(|| {
        "this is no checkout of the repository; change into one and use `cargo xtask`".to_owned()
    })
}

/// The workspace's folder, which `main` has found.
pub(crate) fn root() -> PathBuf {
    find_root().unwrap_or_default()
}

/// Cargo's target folder.
pub(crate) fn target() -> PathBuf {
    match std::env::var_os("CARGO_TARGET_DIR") {
        Some(folder) => std::path::absolute(&folder).unwrap_or_else(|_| folder.into()),
        None => root().join("target"),
    }
}

/// The command line, as the steps build it.
pub(crate) fn cardan() -> PathBuf {
    target().join("debug/cardan")
}

/// `program` with `arguments` in the workspace's folder.
pub(crate) fn command(program: impl AsRef<OsStr>, arguments: &[&str]) -> Command {
    let mut command = Command::new(program);
    command.current_dir(root()).args(arguments);
    command
}

/// Cargo with `arguments`.
pub(crate) fn cargo(arguments: &[&str]) -> Command {
    command(
        std::env::var_os("CARGO").unwrap_or("cargo".into()),
        arguments,
    )
}

/// Shows the command, runs it, and says whether it succeeded.
pub(crate) fn run(mut command: Command) -> Result<bool, String> {
    show(&command);
    let status = command
        .status()
        .map_err(|error| unusable(&command, &error))?;
    Ok(status.success())
}

/// The same, and hands each line of standard output to `look` on its way to the terminal.
pub(crate) fn run_watched(
    mut command: Command,
    mut look: impl FnMut(&str),
) -> Result<bool, String> {
    show(&command);
    let spawned = command.stdout(Stdio::piped()).spawn();
    let mut child = spawned.map_err(|error| unusable(&command, &error))?;
    if let Some(output) = child.stdout.take() {
        for line in BufReader::new(output).lines() {
            let line = line.map_err(|error| unusable(&command, &error))?;
            println!("{line}");
            look(&line);
        }
    }
    let status = child.wait().map_err(|error| unusable(&command, &error))?;
    Ok(status.success())
}

/// Standard output of a command that succeeds.
pub(crate) fn output(mut command: Command) -> Result<String, String> {
    let output = command.stderr(Stdio::inherit()).output();
    let output = output.map_err(|error| unusable(&command, &error))?;
    if !output.status.success() {
        return Err(unusable(&command, &output.status));
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// The rest of the first line that begins with `start`, of what a program prints that is there and succeeds.
pub(crate) fn first_line(program: &OsStr, arguments: &[&str], start: &str) -> Option<String> {
    let output = command(program, arguments)
        .stderr(Stdio::null())
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let line = text.lines().find_map(|line| line.strip_prefix(start))?;
    output.status.success().then(|| line.trim().to_owned())
}

/// Whether a command is there and succeeds.
pub(crate) fn succeeds(mut command: Command) -> bool {
    let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

fn show(command: &Command) {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let words: Vec<_> = words.map(OsStr::to_string_lossy).collect();
    eprintln!("$ {}", words.join(" "));
}

fn unusable(command: &Command, error: &dyn std::fmt::Display) -> String {
    format!(
        "{} cannot be run: {error}",
        command.get_program().to_string_lossy()
    )
}
