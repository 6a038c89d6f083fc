//! The pages of `docs/` that a user works along: every command in them runs, and every line of output
//! that they show comes.

use std::collections::BTreeSet;
use std::env;
use std::ffi::OsString;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use cardan_tests::{cardan, root};

/// A block of a page between fences.
struct Block {
    /// What stands behind the opening fence.
    info: String,
    /// Line of the page at which it begins, from 1.
    line: usize,
    text: String,
}

fn blocks(page: &str) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut open: Option<Block> = None;
    for (at, line) in page.lines().enumerate() {
        match (line.strip_prefix("```"), open.take()) {
            (Some(info), None) => {
                open = Some(Block {
                    info: info.to_owned(),
                    line: at + 2,
                    text: String::new(),
                });
            }
            (Some(_), Some(block)) => blocks.push(block),
            (None, Some(mut block)) => {
                block.text += line;
                block.text.push('\n');
                open = Some(block);
            }
            (None, None) => {}
        }
    }
    assert!(open.is_none(), "a fence is not closed");
    blocks
}

/// Runs the commands of a block in the root of the checkout; gives what they print.
fn run(name: &str, block: &Block) -> String {
    let program = PathBuf::from(cardan());
    let folder = program.parent().expect("in a folder");
    let path = env::var("PATH").unwrap_or_default();
    let output = Command::new("bash")
        .args(["-e", "-u", "-o", "pipefail", "-c", &block.text])
        .env("PATH", format!("{}:{path}", folder.display()))
        .env_remove("COLUMNS")
        .env_remove("GITHUB_ACTIONS")
        .current_dir(root())
        .output()
        .expect("bash starts");
    let place = format!("docs/{name}, line {}", block.line);
    let all = [output.stdout, output.stderr].concat();
    let all = String::from_utf8_lossy(&all).into_owned();
    let expected = match block.info.strip_prefix("sh").map(str::trim) {
        Some("") => Some(0),
        Some("exit=any") => None,
        Some(other) => {
            let code = other
                .strip_prefix("exit=")
                .and_then(|code| code.parse().ok());
            Some(code.unwrap_or_else(|| panic!("{place}: {other}?")))
        }
        None => panic!("{place}: not commands"),
    };
    if let Some(code) = expected {
        assert_eq!(output.status.code(), Some(code), "{place}:\n{all}");
    }
    all
}

/// Runs a page from its beginning to its end.
fn work_along(name: &str) {
    fs::create_dir_all(root().join("target/try")).expect("made");
    let page = fs::read_to_string(root().join("docs").join(name)).expect("there");
    let before = names();
    let mut printed = String::new();
    let (mut commands, mut shown) = (0, 0);
    for block in blocks(&page) {
        if block.info.starts_with("sh") {
            printed += &run(name, &block);
            commands += 1;
        } else if block.info == "text" {
            for line in block.text.lines() {
                assert!(
                    printed.lines().any(|printed| printed.contains(line)),
                    "docs/{name}, line {}: {line:?} is not in\n{printed}",
                    block.line
                );
                shown += 1;
            }
        }
    }
    assert!(commands > 0 && shown > 0, "{name}: nothing to work along");
    assert_eq!(names(), before, "docs/{name} leaves files in the checkout");
}

/// What lies in the root of the checkout.
fn names() -> BTreeSet<OsString> {
    let entries = fs::read_dir(root()).expect("a folder");
    entries
        .map(|entry| entry.expect("readable").file_name())
        .collect()
}

#[test]
fn a_first_verdict() {
    work_along("first-verdict.md");
}

#[test]
fn reading_a_result() {
    work_along("reading-a-result.md");
}

#[test]
fn my_recording() {
    work_along("my-recording.md");
}

#[test]
fn my_firmware() {
    work_along("my-firmware.md");
}

#[test]
fn my_word_lengths() {
    work_along("my-word-lengths.md");
}

#[test]
fn my_ci() {
    work_along("my-ci.md");
}

/// Links between pages lead to files.
#[test]
fn no_link_leads_nowhere() {
    let mut checked = 0;
    let folders = ["", "docs", "docs/design", "firmware/c"];
    for folder in folders.map(|folder| root().join(folder)) {
        for entry in fs::read_dir(&folder).expect("a folder") {
            let file = entry.expect("readable").path();
            if file.extension().is_none_or(|extension| extension != "md") {
                continue;
            }
            let page = fs::read_to_string(&file).expect("text");
            for part in page.split("](").skip(1) {
                let target = part.split(')').next().unwrap_or_default();
                let target = target.split('#').next().unwrap_or_default();
                if target.is_empty() || target.contains("://") {
                    continue;
                }
                assert!(
                    folder.join(target).exists(),
                    "{}: {target} is not there",
                    file.display()
                );
                checked += 1;
            }
        }
    }
    assert!(checked > 20, "{checked}");
}
