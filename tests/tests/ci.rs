//! A comparison in continuous integration: JUnit, annotations, baseline, stale sources.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use cardan_tests::{assert_refused, cardan, copy_firmware, document, root, run, stderr};
use serde_json::Value;
use tempfile::TempDir;

const RUN: [&str; 4] = ["compare", "--in-process", "--seconds", "1"];

fn compare(more: &[&str]) -> Output {
    run(&[&RUN[..], more].concat())
}

/// Cases and failures as Python's XML reader sees them.
fn cases(file: &Path) -> (usize, usize) {
    let script = "import sys, xml.etree.ElementTree as e\nr = e.parse(sys.argv[1]).getroot()\n\
                  c = r.findall('.//testcase')\nassert int(r.get('tests')) == len(c)\n\
                  print(len(c), len(r.findall('.//failure')))";
    let output = Command::new("python3")
        .arg("-c")
        .arg(script)
        .arg(file)
        .output()
        .expect("python3");
    let text = String::from_utf8_lossy(&output.stdout);
    let mut numbers = text
        .split_whitespace()
        .map(|word| word.parse().expect("a number"));
    (
        numbers
            .next()
            .unwrap_or_else(|| panic!("{}", stderr(&output))),
        numbers.next().expect("two"),
    )
}

#[test]
fn junit_has_a_case_per_node_and_its_failures_are_the_verdicts() {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("cardan.xml");
    let path = file.to_string_lossy();
    let output = run(&["compare", "--seconds", "1", "--json", "--junit", &path]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let nodes = document(&output)["nodes"].as_array().expect("nodes").len();
    let (all, failed) = cases(&file);
    assert!(all > nodes && failed == 0, "{all} {failed}");
    let output = compare(&[
        "--set",
        "tolerance.nodes.yaw=0",
        "--set",
        "tolerance.truth.rms_deg=0",
        "--junit",
        &path,
    ]);
    assert_eq!(output.status.code(), Some(1));
    // The node, what frames say of it, and the error against truth.
    assert_eq!(cases(&file).1, 3);
}

#[test]
fn annotations_are_said_where_github_runs_it_or_the_option_asks() {
    let failing = ["--quiet", "--set", "tolerance.nodes.yaw=0"];
    let command = |set: bool, more: &[&str]| {
        let mut command = Command::new(cardan());
        command
            .args([&RUN[..], &failing, more].concat())
            .env_remove("GITHUB_ACTIONS");
        if set {
            command.env("GITHUB_ACTIONS", "true");
        }
        let output = command.output().expect("starts");
        assert_eq!(output.status.code(), Some(1));
        stderr(&output)
            .matches("::error title=cardan compare%3A attitude on tumble::node yaw")
            .count()
    };
    assert_eq!(
        [
            command(false, &[]),
            command(true, &[]),
            command(false, &["--annotations"])
        ],
        [0, 1, 1]
    );
}

#[test]
fn a_run_is_as_good_as_itself_and_worse_than_a_better_one() {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("run.json");
    let path = file.to_string_lossy();
    let mut stored = document(&compare(&["--json", "--quiet"]));
    fs::write(&file, stored.to_string()).expect("written");
    let again = compare(&["--baseline", &path, "--margin", "0"]);
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));

    let rms = stored["attitude"]["total"]["rms_deg"]
        .as_f64()
        .expect("a figure");
    stored["attitude"]["total"]["rms_deg"] = (rms / 1.3).into();
    fs::write(&file, stored.to_string()).expect("written");
    let worse = compare(&["--baseline", &path, "--json"]);
    assert_eq!(worse.status.code(), Some(1));
    let found = document(&worse);
    assert_eq!(found["verdict"], "fail");
    let reasons = found["reasons"].as_array().expect("reasons");
    assert_eq!(reasons.len(), 1);
    let reason = reasons[0].as_str().expect("text");
    assert!(
        reason.starts_with("baseline: attitude, rms of total against truth"),
        "{reason}"
    );
    let within = compare(&["--baseline", &path, "--margin", "40"]);
    assert_eq!(within.status.code(), Some(0), "{}", stderr(&within));
}

#[test]
fn a_baseline_that_cannot_be_compared_with_is_refused_before_the_run() {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("run.json");
    let path = file.to_string_lossy();
    assert_refused(
        &compare(&["--baseline", &path]),
        &["run.json", "cannot be read"],
    );
    for (text, expected) in [
        ("{", "cardan compare --json"),
        ("{\"nodes\": []}", "no scenario"),
        (
            "{\"nodes\": [], \"scenario\": \"heat\", \"app\": \"attitude\"}",
            "'heat'",
        ),
    ] {
        fs::write(&file, text).expect("written");
        assert_refused(&compare(&["--baseline", &path]), &[expected]);
    }
    for margin in ["-1", "x", "nan"] {
        assert_refused(
            &compare(&["--baseline", &path, "--margin", margin]),
            &["--margin"],
        );
    }
}

fn stale_in(folder: &Path) -> Value {
    let output = Command::new(cardan())
        .args([
            "compare",
            "--in-process",
            "--seconds",
            "0.5",
            "--json",
            "--quiet",
        ])
        .current_dir(folder)
        .output()
        .expect("starts");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    document(&output)["stale"].clone()
}

#[test]
fn firmware_sources_that_are_others_are_told_with_the_command_that_builds_and_compares() {
    let folder = TempDir::new().expect("a folder");
    assert_eq!(stale_in(folder.path()), Value::Null, "outside a checkout");
    copy_firmware(folder.path());
    assert_eq!(stale_in(folder.path()), Value::Null, "the same sources");
    let inner = folder.path().join("crates/spec");
    for changed in [
        "firmware/src/inverse.rs",
        "crates/datapath/src/format.rs",
        "firmware/boards/atmega328p/Cargo.lock",
    ] {
        let file = folder.path().join(changed);
        let before = fs::read_to_string(&file).expect("there");
        fs::write(&file, format!("{before}\n")).expect("ours");
        let told = stale_in(&inner);
        let told = told
            .as_str()
            .unwrap_or_else(|| panic!("{changed}: nothing is said"));
        assert!(
            told.contains("bundled image") && told.contains("compare --build"),
            "{told}"
        );
        fs::write(&file, before).expect("ours");
    }
    fs::write(folder.path().join("firmware/tests/more.rs"), "").expect("ours");
    assert_eq!(
        stale_in(&inner),
        Value::Null,
        "tests are no sources of an image"
    );
}

#[test]
fn an_image_of_the_checkout_is_built_and_passes() {
    let output = Command::new(cardan())
        .args(["compare", "--build", "--seconds", "1", "--json", "--quiet"])
        .current_dir(root())
        .output()
        .expect("starts");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found = document(&output);
    assert_eq!(
        (&found["verdict"], &found["stale"]),
        (&"pass".into(), &Value::Null)
    );
    let nowhere = TempDir::new().expect("a folder");
    let output = Command::new(cardan())
        .args(["compare", "--build"])
        .current_dir(nowhere.path())
        .output()
        .expect("starts");
    assert_refused(&output, &["--build", "checkout"]);
}

#[test]
fn colour_is_for_terminals_or_on_demand_and_no_color_wins() {
    let with = |variables: &[(&str, &str)], more: &[&str]| {
        let mut command = Command::new(cardan());
        command
            .args(["compare", "--seconds", "0.5"])
            .args(more)
            .env_remove("NO_COLOR")
            .env_remove("CLICOLOR_FORCE");
        command.envs(variables.iter().copied());
        let output = command.output().expect("starts");
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    for more in [&[][..], &["--in-process"]] {
        assert!(!with(&[], more).contains('\u{1b}'), "a pipe");
        assert!(
            with(&[("CLICOLOR_FORCE", "1")], more).contains("\u{1b}[32mok"),
            "{more:?}"
        );
        assert!(!with(&[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")], more).contains('\u{1b}'));
        let narrow = with(&[("COLUMNS", "70")], more);
        assert!(
            narrow.contains("left out: ") && narrow.lines().all(|line| line.chars().count() <= 110)
        );
        assert!(!with(&[("COLUMNS", "200")], more).contains("left out"));
    }
}
