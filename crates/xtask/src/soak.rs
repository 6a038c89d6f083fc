//! The long tests: each fuzz target for some minutes, random programs for 10^9 cycles, and ten million
//! random operations in each rounding and overflow mode against exact rationals, and a million random
//! algorithms on tapes.

use std::fs;

use crate::shell::{cargo, command, output, root, run, succeeds, target};

/// Folder of the fuzz targets.
const FUZZ: &str = "emulator/fuzz";
/// Minutes per target, unless said otherwise.
pub(crate) const MINUTES: u64 = 10;
/// Cycles of random programs.
const CYCLES: &str = "1000000000";

/// Random algorithms.
const TAPES: &str = "1000000";
/// Random operations per rounding and overflow mode.
const OPERATIONS: &str = "10000000";

/// Runs the soak: `minutes` per target. What the fuzzer finds interesting stays under the target
/// folder; the committed corpus is only read.
pub(crate) fn soak(minutes: u64) -> Result<bool, String> {
    let arguments = [
        "run",
        "--release",
        "--package",
        "cardan-emulator",
        "--example",
        "random_flash",
    ];
    let mut is_good = run(cargo(&[&arguments[..], &["--", CYCLES]].concat()))?;
    is_good &= run(arithmetic())?;
    is_good &= run(tapes())?;
    if !succeeds(fuzz(&["--version"])) {
        return Err("the fuzzer is missing; install it: cargo install cargo-fuzz".to_owned());
    }
    let list = output(fuzz(&["list", "--fuzz-dir", FUZZ]))?;
    let names = targets(&list, &committed()?)?;
    for name in names {
        let found = target().join("fuzz").join(name);
        fs::create_dir_all(&found).map_err(|error| format!("{}: {error}", found.display()))?;
        let corpus = root().join(FUZZ).join("corpus").join(name);
        let (found, corpus) = (found.display().to_string(), corpus.display().to_string());
        let time = format!("-max_total_time={}", minutes * 60);
        let fuzzing = [
            "run",
            "-s",
            "none",
            "--fuzz-dir",
            FUZZ,
            name,
            &found,
            &corpus,
            "--",
            &time,
        ];
        is_good &= run(fuzz(&fuzzing))?;
    }
    Ok(is_good)
}

/// The targets that have a committed corpus.
fn committed() -> Result<Vec<String>, String> {
    let folder = root().join(FUZZ).join("corpus");
    let entries =
        fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let names = entries.flatten().map(|entry| entry.file_name());
    Ok(names
        .map(|name| name.to_string_lossy().into_owned())
        .collect())
}

/// The targets in `list`, which must hold at least those with a corpus: a soak of nothing is none.
fn targets<'a>(list: &'a str, expected: &[String]) -> Result<Vec<&'a str>, String> {
    let names: Vec<&str> = list.lines().map(str::trim).collect();
    let names: Vec<&str> = names.into_iter().filter(|name| !name.is_empty()).collect();
    match expected.iter().find(|name| !names.contains(&name.as_str())) {
        _ if names.is_empty() => Err(format!("`cargo fuzz list` finds no target in {FUZZ}")),
        Some(name) => Err(format!("`cargo fuzz list` does not find the target {name}")),
        None => Ok(names),
    }
}

/// Random algorithms: recorded as what they are, trials exact, no false proof.
fn tapes() -> std::process::Command {
    let test = [
        "test",
        "--release",
        "-p",
        "cardan-numerics",
        "--test",
        "random_tapes",
    ];
    let mut test = cargo(&[&test[..], &["--", "--nocapture"]].concat());
    test.env("CARDAN_TAPES", TAPES);
    test
}

/// Deployed rounding and the tunable arithmetic against exact rationals.
fn arithmetic() -> std::process::Command {
    let packages = ["-p", "cardan-datapath", "-p", "cardan-numerics"];
    let tests = ["--test", "rounding", "--test", "exact_law"];
    let mut test = cargo(&[&["test", "--release"][..], &packages, &tests].concat());
    test.env("CARDAN_RANDOM_OPERATIONS", OPERATIONS);
    test
}

/// cargo-fuzz, which needs what only nightly compilers offer, or one that is told to offer it.
fn fuzz(arguments: &[&str]) -> std::process::Command {
    let mut fuzz = command("cargo", &[&["fuzz"], arguments].concat());
    fuzz.env("RUSTC_BOOTSTRAP", "1");
    fuzz.env("CARGO_TARGET_DIR", target().join("fuzz/build"));
    fuzz
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_soak_without_targets_is_an_error() {
        let expected = committed().expect("there is a corpus");
        assert!(expected.len() >= 5, "{expected:?}");
        assert!(targets("", &expected).is_err());
        assert!(targets("decoder\n", &expected).is_err());
        let all = expected.join("\n") + "\n";
        assert_eq!(targets(&all, &expected).expect("all").len(), expected.len());
    }

    #[test]
    fn a_command_that_fails_has_no_output() {
        assert!(output(command("false", &[])).is_err());
        assert_eq!(output(command("echo", &["x"])).as_deref(), Ok("x\n"));
    }
}
