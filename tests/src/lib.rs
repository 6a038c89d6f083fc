//! Whole-system tests and their inputs: what the tests share.

pub mod program;

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use serde_json::Value;

/// A search that ends soon; a budget has to follow.
pub const SHORT_SEARCH: [&str; 9] = [
    "tune",
    "--seconds",
    "1",
    "--runs",
    "1",
    "--evaluations",
    "150",
    "--fresh",
    "0",
];

/// What makes a folder a checkout, as far as firmware and images go.
///
/// # Panics
/// When it cannot be written.
pub fn copy_firmware(to: &Path) {
    for folder in ["firmware", "crates/units", "crates/spec", "crates/datapath"] {
        copy(&root().join(folder), &to.join(folder));
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("ours");
    for entry in fs::read_dir(from).expect("readable") {
        let path = entry.expect("readable").path();
        let name = path.file_name().expect("a name");
        if path.is_dir() && name != "target" {
            copy(&path, &to.join(name));
        } else if path.is_file() {
            fs::copy(&path, to.join(name)).expect("copied");
        }
    }
}

/// Root of the workspace.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .map_or_else(PathBuf::new, Path::to_path_buf)
}

/// The program under test: what `CARDAN_PROGRAM` names (`cargo xtask test` sets it to what it has
/// built), else it is built here, in the profile and target folder of the running test. (Cargo does
/// not build another package's program for a test.)
///
/// # Panics
/// When the program does not build.
pub fn cardan() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        if let Some(program) = std::env::var_os("CARDAN_PROGRAM") {
            return PathBuf::from(program);
        }
        let test = std::env::current_exe().expect("a test has a path");
        let profile_folder = test
            .parent()
            .and_then(Path::parent)
            .expect("target/PROFILE/deps");
        let target = profile_folder.parent().expect("target/PROFILE");
        let mut build = Command::new(env!("CARGO"));
        build
            .current_dir(root())
            .args(["build", "--quiet", "--workspace", "--bins"]);
        build.arg("--target-dir").arg(target);
        if profile_folder.ends_with("release") {
            build.arg("--release");
        }
        let status = build.status().expect("cargo runs");
        assert!(status.success(), "cardan does not build");
        profile_folder.join("cardan")
    })
}

/// Runs the program to its end.
///
/// # Panics
/// When it cannot be started.
pub fn run<S: AsRef<std::ffi::OsStr>>(arguments: &[S]) -> Output {
    Command::new(cardan())
        .args(arguments)
        .output()
        .expect("cardan starts")
}

/// Standard error as text.
#[must_use]
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The one JSON document on standard output.
///
/// # Panics
/// There is another thing: with what the program says.
#[must_use]
pub fn document(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| {
        let shown = String::from_utf8_lossy(&output.stdout);
        panic!("{error}: {shown}{}", stderr(output))
    })
}

/// The run was refused as bad input, with exit code 2 and a message that says all of `parts`.
///
/// # Panics
/// When it was not.
pub fn assert_refused(output: &Output, parts: &[&str]) {
    let said = stderr(output);
    assert_eq!(output.status.code(), Some(2), "{parts:?}: {said}");
    for part in parts {
        assert!(said.contains(part), "says {said:?}, not {part:?}");
    }
}

/// Says why a test cannot run on this machine, where the test harness does not keep it to itself.
///
/// # Panics
/// Where `CARDAN_ALL_TESTS` is set: nothing may be left out there.
pub fn not_run(why: &str) {
    assert!(
        std::env::var_os("CARDAN_ALL_TESTS").is_none(),
        "CARDAN_ALL_TESTS is set, and this test cannot run: {why}"
    );
    let _ = writeln!(std::io::stderr(), "NOT RUN: {why}");
}
