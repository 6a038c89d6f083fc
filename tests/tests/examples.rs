//! Each line of `examples/README.md`, run as it stands there.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cardan_tests::{cardan, root, run, stderr};
use tempfile::TempDir;

/// The examples, copied: what they write is not left in the checkout.
fn examples() -> TempDir {
    let folder = TempDir::new().expect("a folder");
    copy(&root().join("examples"), folder.path());
    folder
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("ours");
    for entry in fs::read_dir(from).expect("readable") {
        let path = entry.expect("readable").path();
        let name = path.file_name().expect("a name");
        if path.is_dir() {
            copy(&path, &to.join(name));
        } else {
            fs::copy(&path, to.join(name)).expect("copied");
        }
    }
}

/// The lines of a kind of block, in order.
fn lines(kind: &str) -> Vec<String> {
    let readme = fs::read_to_string(root().join("examples/README.md")).expect("readable");
    let mut found = Vec::new();
    let mut inside = false;
    for line in readme.lines() {
        match line.strip_prefix("```") {
            Some(begun) => inside = begun == kind,
            None if inside => found.push(line.to_owned()),
            None => {}
        }
    }
    found
}

/// What a line prints, run in `folder` with the program under test as `cardan`.
fn printed(line: &str, folder: &Path) -> String {
    let programs = cardan().parent().expect("a folder");
    let path = std::env::var("PATH").unwrap_or_default();
    let output = Command::new("sh")
        .args(["-c", line])
        .current_dir(folder)
        .env("PATH", format!("{}:{path}", programs.display()))
        .output()
        .expect("a shell starts");
    assert_eq!(output.status.code(), Some(0), "{line}: {}", stderr(&output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The bench, built with the workspace.
fn bench() -> PathBuf {
    let built = cardan().with_file_name("examples").join("bench");
    if !built.is_file() {
        let arguments = [
            "build",
            "--quiet",
            "--workspace",
            "--examples",
            "--target-dir",
        ];
        let target = cardan().ancestors().nth(2).expect("a target folder");
        let status = Command::new(env!("CARGO"))
            .current_dir(root())
            .args(arguments)
            .arg(target)
            .status();
        assert!(status.is_ok_and(|status| status.success()));
    }
    built
}

#[test]
fn every_line_runs_and_the_firmware_does_what_its_model_does() {
    let folder = examples();
    let mut ran = 0;
    for line in lines("sh") {
        if let Some(arguments) =
            line.strip_prefix("cargo run --release -p cardan-emulator --example bench -- ")
        {
            let line = format!("{} {arguments}", bench().display());
            let said = printed(&line, folder.path());
            assert_eq!(said.trim_end(), lines("text").join("\n"));
        } else {
            let said = printed(&line, folder.path());
            if line.ends_with("--adc 0=2.5") {
                assert!(["511", "512"].contains(&said.trim()), "{said}");
            }
        }
        ran += 1;
    }
    assert!(ran >= 7, "{ran} lines");
    let dump = fs::read_to_string(folder.path().join("smooth.vcd")).expect("written");
    assert!(dump.contains("adc0_V") && dump.contains("PD1"));
}

#[test]
fn the_scenario_with_every_key_is_current() {
    let printed = run(&["compare", "--print-scenario"]).stdout;
    let kept = fs::read(root().join("examples/scenarios/every-key.toml")).expect("readable");
    assert!(
        kept == printed,
        "examples/scenarios/every-key.toml: cardan compare --print-scenario > examples/scenarios/every-key.toml"
    );
}

#[test]
fn every_key_of_the_examples_has_a_comment() {
    for file in ["scenarios/desk.toml", "corners.toml"] {
        let text = fs::read_to_string(root().join("examples").join(file)).expect("readable");
        let mut before = "";
        for line in text.lines() {
            let is_key = line.contains(" = ") && !line.starts_with('#');
            let is_told = line.contains(" # ") || before.starts_with('#') || before.contains(" # ");
            assert!(!is_key || is_told, "{file}: {line}");
            before = line;
        }
    }
}
