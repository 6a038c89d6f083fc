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
    for name in list.lines() {
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
