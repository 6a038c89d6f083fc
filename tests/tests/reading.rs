//! What a user reads: help, completions, pages of the manual, what nodes are, which node is to blame.

use std::collections::BTreeSet;
use std::fs;
use std::process::Output;

use cardan_tests::{assert_refused, root, run, stderr};
use serde_json::Value;
use tempfile::TempDir;

const VERBS: [&str; 14] = [
    "compare",
    "golden",
    "native",
    "emulate",
    "diff",
    "tune",
    "ranges",
    "calibrate",
    "accuracy",
    "run",
    "build",
    "doctor",
    "completions",
    "man",
];

fn stdout(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn help_of_every_verb_has_examples_and_exit_codes() {
    let top = stdout(&run(&["--help"]));
    for verb in VERBS {
        assert!(top.contains(&format!("\n  {verb} ")), "{verb} in {top}");
        let help = stdout(&run(&[verb, "--help"]));
        for part in [
            "Examples:\n  ",
            "Exit codes:\n  0  ",
            &format!("cardan {verb}"),
        ] {
            assert!(help.contains(part), "{verb}: {part}");
        }
    }
    assert!(top.contains("Examples:") && top.contains("Exit codes:"));
}

/// The long options of a verb by its help.
fn options(verb: &str) -> Vec<String> {
    let help = stdout(&run(&[verb, "--help"]));
    let list = help
        .split("\nOptions:\n")
        .nth(1)
        .expect("every verb has options");
    let list = list.split("\n\n").next().expect("a list");
    let option = |line: &str| {
        let name = line.trim_start().split("--").nth(1)?;
        let name = name
            .split(|c: char| !c.is_alphanumeric() && c != '-')
            .next()?;
        line.trim_start()
            .starts_with('-')
            .then(|| format!("--{name}"))
    };
    list.lines().filter_map(option).collect()
}

#[test]
fn completions_and_manual_know_every_verb_and_option() {
    let options = VERBS.map(|verb| (verb, options(verb)));
    let all: usize = options.iter().map(|(_, options)| options.len()).sum();
    assert!(all > 100, "{all} options");
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let text = stdout(&run(&["completions", shell]));
        let words: BTreeSet<&str> = text
            .split(|c: char| !c.is_alphanumeric() && c != '-')
            .collect();
        for (verb, options) in &options {
            assert!(words.contains(verb), "{shell}: {verb}");
            for option in options {
                // Fish takes a long option's name without its dashes.
                let word = if shell == "fish" {
                    &option[2..]
                } else {
                    option
                };
                assert!(words.contains(word), "{shell}: {option} of {verb}");
            }
        }
    }
    assert_refused(&run(&["completions", "tcsh"]), &["bash"]);
    assert!(stdout(&run(&["man"])).contains(".TH cardan 1"));
    let folder = TempDir::new().expect("a folder");
    let pages = folder.path().join("man1");
    stdout(&run(&["man", "--out", &pages.to_string_lossy()]));
    for (verb, options) in &options {
        let page = fs::read_to_string(pages.join(format!("cardan-{verb}.1"))).expect(verb);
        assert!(page.contains("Exit codes:"), "{verb}");
        for option in options {
            let entry = format!("\\fB{}\\fR", option.replace('-', "\\-"));
            assert!(
                page.contains(&format!("\n{entry}")) || page.contains(&format!(", {entry}")),
                "{verb}: {option}"
            );
        }
    }
}

/// What is sent, and what only raises status bits.
const OUTPUTS: [&str; 5] = ["pitch", "roll", "vertical_sum", "residual", "limit"];

#[test]
fn every_node_has_a_meaning_and_says_what_enters_it_and_what_uses_it() {
    let output = run(&["compare", "--explain", "all", "--json", "--quiet"]);
    let all: Value = serde_json::from_str(&stdout(&output)).expect("a document");
    let all = all.as_array().expect("an array");
    assert!(all.len() > 90, "{}", all.len());
    for node in all {
        let name = &node["name"];
        let meaning = node["meaning"].as_str().expect("text");
        assert!(meaning.len() > 8, "{name}: {meaning}");
        let count = |key: &str| node[key].as_array().expect("a list").len();
        assert!(count("made_by") > 0, "{name}");
        // Settings and constants come from nowhere, outputs go to the frame.
        let made_by = node["made_by"].to_string();
        let is_source = ["input", "setting", "constant", "table"]
            .iter()
            .any(|word| made_by.contains(word));
        assert!(
            is_source || count("inputs") + count("earlier_inputs") > 0,
            "{name}"
        );
    }
    let names = |node: &Value, key: &str| -> BTreeSet<String> {
        let list = node[key].as_array().expect("a list");
        list.iter()
            .map(|name| name.as_str().expect("text").to_owned())
            .collect()
    };
    let mut uses = 0;
    for node in all {
        let name = node["name"].as_str().expect("text");
        // What one says that it uses says so too.
        for (made_of, used_by) in [("inputs", "users"), ("earlier_inputs", "later_users")] {
            let makers = all
                .iter()
                .filter(|other| names(other, used_by).contains(name));
            let makers: BTreeSet<String> = makers
                .map(|other| other["name"].as_str().expect("text").to_owned())
                .collect();
            assert_eq!(names(node, made_of), makers, "{name}: {made_of}");
            uses += makers.len();
        }
        let is_used = !names(node, "users").is_empty() || !names(node, "later_users").is_empty();
        assert!(
            is_used || OUTPUTS.contains(&name),
            "{name} is used by nothing"
        );
    }
    assert!(uses > 150, "{uses} uses");
    let octant = all
        .iter()
        .find(|node| node["name"] == "octant")
        .expect("there");
    assert_eq!(octant["shown_in"], "degrees");
    assert_eq!(octant["most"], 180.0 * 32767.0 / 32768.0);
    assert_eq!(
        octant["inputs"],
        serde_json::json!(["asin_argument", "asin_sum", "half"])
    );
    assert_refused(&run(&["compare", "--explain", "octnat"]), &["octant"]);
}

#[test]
fn the_documents_of_the_nodes_are_current() {
    let folder = TempDir::new().expect("a folder");
    let output = run(&[
        "compare",
        "--explain-docs",
        &folder.path().to_string_lossy(),
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for name in ["nodes.md", "nodes.svg"] {
        let written = fs::read_to_string(folder.path().join(name)).expect("written");
        let committed = fs::read_to_string(root().join("docs").join(name)).expect("committed");
        assert!(
            written == committed,
            "docs/{name} is not current: cargo xtask node-docs"
        );
    }
}

/// The deployed word lengths, where one node has another word.
fn with_word(node: &str, word: u32, frac: u32) -> String {
    let text = fs::read_to_string(root().join("firmware/wordlengths.toml")).expect("there");
    let parts: Vec<String> = text
        .split("[[node]]")
        .map(|part| {
            if !part.contains(&format!("name = \"{node}\"\n")) {
                return part.to_owned();
            }
            let lines = part.lines().map(|line| match line.split(' ').next() {
                Some("word") => format!("word = {word}"),
                Some("frac") => format!("frac = {frac}"),
                _ => line.to_owned(),
            });
            lines.collect::<Vec<_>>().join("\n") + "\n"
        })
        .collect();
    parts.join("[[node]]")
}

#[test]
fn a_word_that_is_too_short_is_named_first_and_not_what_follows_from_it() {
    let folder = TempDir::new().expect("a folder");
    for (node, word, frac) in [
        ("octant", 14, 15),
        ("cos_roll", 15, 15),
        ("level_x", 13, 14),
    ] {
        let file = folder.path().join("formats.toml");
        fs::write(&file, with_word(node, word, frac)).expect("written");
        let file = file.to_string_lossy();
        let output = run(&[
            "compare",
            "--seconds",
            "3",
            "--json",
            "--wordlengths",
            &file,
        ]);
        let document: Value = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|_| panic!("{}", stderr(&output)));
        assert_eq!(document["verdict"], "fail", "{node}");
        let first = document["reasons"][0].as_str().expect("a reason");
        assert!(
            first.starts_with(&format!("node {node}: saturates ")),
            "{node}: {first}"
        );
        let row = document["nodes"]
            .as_array()
            .expect("nodes")
            .iter()
            .find(|row| row["name"] == node);
        let row = row.expect("there");
        assert_eq!(row["status"], "fail");
        assert!(
            row["overflows"].as_u64() > Some(0) && row["first_overflow"].is_object(),
            "{row}"
        );
    }
}
