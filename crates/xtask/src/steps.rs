//! The steps of `cargo xtask test`: one target folder, one profile and one selection of features,
//! so that nothing is compiled twice.

use std::process::Command;
use std::time::Instant;

use crate::deny;
use crate::prepare::{PYTHON, oracle_python, prepare};
use crate::shell::{cardan, cargo, command, run as run_command, run_watched};

/// Folder of the committed images.
const IMAGES: &str = "firmware/boards/atmega328p/images";

/// Environment variable that names the program under test (`tests/src/lib.rs`).
const PROGRAM: &str = "CARDAN_PROGRAM";

/// A check.
struct Step {
    name: &'static str,
    /// The steps after it make no sense if it fails.
    is_ground: bool,
    run: fn(&mut Counts) -> Result<bool, String>,
}

/// Tests counted so far, and what the last lines must say.
#[derive(Default)]
struct Counts {
    passed: u64,
    failed: u64,
    remarks: Vec<String>,
}

const STEPS: [Step; 9] = [
    Step {
        name: "fmt",
        is_ground: false,
        run: fmt,
    },
    Step {
        name: "build",
        is_ground: true,
        run: build,
    },
    Step {
        name: "prepare",
        is_ground: true,
        run: |_| prepare(),
    },
    Step {
        name: "deny",
        is_ground: false,
        run: deny,
    },
    Step {
        name: "clippy",
        is_ground: false,
        run: clippy,
    },
    Step {
        name: "images",
        is_ground: false,
        run: images,
    },
    Step {
        name: "target",
        is_ground: false,
        run: on_target,
    },
    Step {
        name: "test",
        is_ground: false,
        run: test,
    },
    Step {
        name: "doc",
        is_ground: false,
        run: doc,
    },
];

/// Names of all steps.
pub(crate) fn names() -> String {
    STEPS.map(|step| step.name).join(", ")
}

/// Runs all steps, or those in the comma-separated list `only`.
pub(crate) fn run(only: Option<&str>) -> Result<bool, String> {
    let wanted: Option<Vec<&str>> = only.map(|list| list.split(',').collect());
    for name in wanted.iter().flatten() {
        if !STEPS.iter().any(|step| step.name == *name) {
            return Err(format!("--only {name}: no such step; expected {}", names()));
        }
    }
    let mut counts = Counts::default();
    let mut results = Vec::new();
    for step in STEPS {
        if wanted
            .as_ref()
            .is_some_and(|wanted| !wanted.contains(&step.name))
        {
            continue;
        }
        println!("\n== {}", step.name);
        let begin = Instant::now();
        let is_good = (step.run)(&mut counts).unwrap_or_else(|message| {
            eprintln!("xtask: {message}");
            false
        });
        results.push((step.name, is_good, begin.elapsed().as_secs()));
        if step.is_ground && !is_good {
            break;
        }
    }
    Ok(report(&results, &counts))
}

fn report(results: &[(&str, bool, u64)], counts: &Counts) -> bool {
    println!();
    for (name, is_good, seconds) in results {
        println!(
            "{name:<8} {:<6} {seconds:>5} s",
            if *is_good { "ok" } else { "FAILED" }
        );
    }
    let bad = results.iter().filter(|(_, is_good, _)| !is_good).count();
    println!(
        "{} of {} steps good; tests: {} passed, {} failed",
        results.len() - bad,
        results.len(),
        counts.passed,
        counts.failed
    );
    for remark in &counts.remarks {
        println!("\n!! {remark}");
    }
    bad == 0
}

fn deny(counts: &mut Counts) -> Result<bool, String> {
    let (is_good, remark) = deny::check()?;
    counts.remarks.extend(remark);
    Ok(is_good)
}

fn fmt(_: &mut Counts) -> Result<bool, String> {
    run_command(cargo(&["fmt", "--all", "--check"]))
}

fn build(_: &mut Counts) -> Result<bool, String> {
    run_command(cargo(&["build", "--workspace", "--all-targets"]))
}

fn clippy(_: &mut Counts) -> Result<bool, String> {
    let arguments = [
        "clippy",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ];
    run_command(cargo(&arguments))
}

/// Builds the board images from source; the tests look at them again, from the same folder.
fn images(_: &mut Counts) -> Result<bool, String> {
    run_command(command(cardan(), &["build", "--target", "all"]))
}

fn test(counts: &mut Counts) -> Result<bool, String> {
    let mut tests = cargo(&["test", "--workspace", "--no-fail-fast"]);
    // The program that the first step built: `cargo build --bins` would select other features, and
    // compile half of the workspace again.
    tests.env(PROGRAM, cardan());
    if let Some(python) = oracle_python() {
        tests.env(PYTHON, python);
    }
    counted(tests, counts)
}

/// The boards' own tests, in the emulator.
fn on_target(counts: &mut Counts) -> Result<bool, String> {
    counted(command(cardan(), &["build", "--test"]), counts)
}

/// Runs test programs and counts what they report.
fn counted(tests: Command, counts: &mut Counts) -> Result<bool, String> {
    run_watched(tests, |line| {
        if let Some((passed, failed)) = result(line) {
            counts.passed += passed;
            counts.failed += failed;
        }
    })
}

/// The counts in the last line of a test program.
fn result(line: &str) -> Option<(u64, u64)> {
    let rest = line.strip_prefix("test result: ")?;
    let count = |what: &str| {
        let before = rest.split(what).next()?;
        before
            .rsplit(|c: char| !c.is_ascii_digit())
            .next()?
            .parse()
            .ok()
    };
    Some((count(" passed")?, count(" failed")?))
}

fn doc(_: &mut Counts) -> Result<bool, String> {
    let mut doc = cargo(&["doc", "--workspace", "--no-deps"]);
    doc.env("RUSTDOCFLAGS", "-D warnings");
    run_command(doc)
}

/// Rebuilds the committed images and the record beside them.
pub(crate) fn write_images() -> Result<bool, String> {
    let built = run_command(cargo(&["build", "--workspace", "--bins"]))?;
    let arguments = ["build", "--target", "atmega328p", "--out", IMAGES];
    Ok(built && run_command(command(cardan(), &arguments))?)
}

/// Writes the documents of the nodes.
pub(crate) fn write_node_docs() -> Result<bool, String> {
    let built = run_command(cargo(&["build", "--workspace", "--bins"]))?;
    let arguments = ["compare", "--explain-docs", "docs"];
    Ok(built && run_command(command(cardan(), &arguments))?)
}

#[cfg(test)]
mod tests {
    use super::result;

    #[test]
    fn the_last_line_of_a_test_program_is_counted() {
        let line =
            "test result: FAILED. 12 passed; 3 failed; 0 ignored; 0 measured; 1 filtered out";
        assert_eq!(result(line), Some((12, 3)));
        assert_eq!(result("test adds ... ok"), None);
    }
}
