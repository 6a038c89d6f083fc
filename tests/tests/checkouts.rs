//! Whose checkout is read and written: the user's, never the one that the program was compiled in.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use cardan_tests::{SHORT_SEARCH, assert_refused, cardan, copy_firmware, root, stderr};
use serde_json::Value;
use tempfile::TempDir;

const WORDLENGTHS: &str = "firmware/wordlengths.toml";

/// A command of `program` run in `folder`, whose caches are in `home`.
fn command(program: &Path, folder: &Path, home: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(program);
    command
        .args(arguments)
        .current_dir(folder)
        .env("XDG_CACHE_HOME", home)
        .env_remove("CARGO_TARGET_DIR");
    command
}

fn output(mut command: Command) -> Output {
    command.output().expect("starts")
}

fn document(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(output)))
}

/// The program alone, as `cargo install` leaves it.
fn installed(folder: &Path) -> PathBuf {
    let program = folder.join("bin/cardan");
    fs::create_dir_all(folder.join("bin")).expect("ours");
    // Not by this process: a child that another test starts meanwhile would hold the copy open for writing.
    let copied = Command::new("cp").arg(cardan()).arg(&program).status();
    assert!(copied.expect("cp starts").success());
    program
}

/// A checkout, as far as firmware goes.
fn checkout(to: &Path) {
    copy_firmware(to);
    let manifest = fs::read_to_string(root().join("Cargo.toml")).expect("readable");
    let (head, rest) = manifest.split_once("members = [").expect("a workspace");
    let (_, rest) = rest.split_once("]\n").expect("a list");
    let members =
        "members = [\"firmware\", \"crates/units\", \"crates/spec\", \"crates/datapath\"]";
    let rest = rest.replace("default-members = [\"crates/cardan\"]", "");
    fs::write(to.join("Cargo.toml"), format!("{head}{members}\n{rest}")).expect("ours");
}

/// Cargo's target folder of the workspace: what does not depend on a checkout's place is compiled once.
fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or(root().join("target"), PathBuf::from)
}

/// The node formats of a word-length file, by name.
fn formats(text: &str) -> Vec<(String, i64, i64)> {
    let table: toml::Table = text.parse().expect("TOML");
    let nodes = table["node"].as_array().expect("nodes").iter();
    let number = |node: &toml::Value, key: &str| node[key].as_integer().expect("a number");
    nodes
        .map(|node| {
            let name = node["name"].as_str().expect("a name").to_owned();
            (name, number(node, "word"), number(node, "frac"))
        })
        .collect()
}

#[test]
fn a_program_alone_builds_and_writes_nothing_outside_a_checkout_and_says_what_to_do() {
    let folder = TempDir::new().expect("a folder");
    let program = installed(folder.path());
    let nowhere = folder.path().join("nowhere");
    fs::create_dir(&nowhere).expect("ours");
    let other = fs::read_to_string(root().join(WORDLENGTHS)).expect("readable");
    let other = other.replacen("frac = 14", "frac = 13", 1);
    fs::write(nowhere.join("other.toml"), other).expect("ours");
    let budget = ["--budget", "attitude.rms<=0.5"];
    for (arguments, parts) in [
        (&["build"][..], &["--checkout DIR", "firmware sources"][..]),
        (&["build", "--test"], &["--checkout DIR"]),
        (&["compare", "--build"], &["--build", "--checkout DIR"]),
        (
            &["compare", "--wordlengths", "other.toml"],
            &["--checkout DIR"],
        ),
        (
            &[&["tune", "--apply"], &budget[..]].concat(),
            &["--apply", "--checkout DIR"],
        ),
        (
            &["build", "--checkout", "."],
            &["--checkout .", WORDLENGTHS],
        ),
    ] {
        let output = output(command(&program, &nowhere, folder.path(), arguments));
        assert_refused(&output, parts);
    }
    let left: Vec<_> = fs::read_dir(&nowhere).expect("ours").collect();
    assert_eq!(left.len(), 1, "nothing is written");
}

#[test]
fn a_foreign_folder_with_boards_is_no_checkout() {
    let folder = TempDir::new().expect("a folder");
    let program = installed(folder.path());
    let board = folder.path().join("firmware/boards/atmega328p");
    fs::create_dir_all(&board).expect("ours");
    fs::write(board.join("Cargo.toml"), "[package]\nname = \"blinky\"\n").expect("ours");
    fs::write(folder.path().join(WORDLENGTHS), "").expect("ours");
    let tune = ["tune", "--apply", "--budget", "attitude.rms<=0.5"];
    let output = output(command(&program, folder.path(), folder.path(), &tune));
    assert_refused(&output, &["--apply", "checkout"]);
}

#[test]
fn what_apply_cannot_write_is_told_before_the_search() {
    let folder = TempDir::new().expect("a folder");
    checkout(folder.path());
    let file = folder.path().join(WORDLENGTHS);
    let whole = fs::read_to_string(&file).expect("there");
    let first = whole.find("[[node]]").expect("nodes");
    let second = first + 1 + whole[first + 1..].find("[[node]]").expect("nodes");
    let without = format!("{}{}", &whole[..first], &whole[second..]);
    fs::write(&file, without).expect("ours");
    let tune = ["tune", "--apply", "--budget", "attitude.rms<=0.5"];
    let run = || output(command(cardan(), folder.path(), folder.path(), &tune));
    assert_refused(&run(), &["wordlengths.toml", "sample", "is missing"]);
    fs::write(&file, "[[node]").expect("ours");
    assert_refused(&run(), &["wordlengths.toml", "line 1"]);
}

#[test]
fn apply_changes_the_checkout_that_the_user_stands_in_and_keeps_its_comments_and_order() {
    let folder = TempDir::new().expect("a folder");
    checkout(folder.path());
    let file = folder.path().join(WORDLENGTHS);
    // Comments of all kinds, and tables in another order than the program's.
    let text = fs::read_to_string(&file).expect("there");
    let (head, nodes) = text.split_at(text.find("[[node]]").expect("nodes"));
    let text = format!("# Ours.\n{head}{nodes}\n# The end.\n").replacen(
        "word = 16\nfrac = 0",
        "word = 16 # of the bus\nfrac = 0   # codes",
        1,
    );
    fs::write(&file, &text).expect("ours");
    let own = root().join(WORDLENGTHS);
    let untouched = fs::read(&own).expect("readable");
    let inner = folder.path().join("crates/spec/src");
    let more = ["--apply", "--json", "--budget", "attitude.rms<=0.5"];
    let tune = [&SHORT_SEARCH[..], &more].concat();
    let mut tune = command(cardan(), &inner, folder.path(), &tune);
    tune.env("CARGO_TARGET_DIR", target());
    let output = output(tune);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    let shown = folder.path().canonicalize().expect("there");
    let shown = shown.display().to_string();
    assert!(
        said.contains(&format!("--apply will write {shown}/{WORDLENGTHS}")),
        "{said}"
    );
    assert_eq!(
        fs::read(&own).expect("readable"),
        untouched,
        "another checkout"
    );
    let after = fs::read_to_string(&file).expect("there");
    let comments = |text: &str| -> Vec<String> {
        let parts = text.lines().filter_map(|line| line.split_once('#'));
        parts.map(|(_, comment)| comment.to_owned()).collect()
    };
    assert_eq!(comments(&after), comments(&text));
    let names =
        |text: &str| -> Vec<String> { formats(text).into_iter().map(|(name, ..)| name).collect() };
    assert_eq!(names(&after), names(&text));
    let found = document(&output);
    for (name, word, frac) in formats(&after) {
        let best = &found["best"]["formats"][&name];
        assert_eq!(
            (&best["word"], &best["frac"]),
            (&word.into(), &frac.into()),
            "{name}"
        );
    }
    assert_ne!(formats(&after), formats(&text));
    // Only values are other ones, and the table [tuned] is new.
    let (values, tuned) = after
        .split_once("\n[tuned]\n")
        .expect("what it was tuned to");
    assert!(tuned.contains("attitude.rms<=0.5") && tuned.contains("[[tuned.tolerance]]"));
    let differing = text.lines().zip(values.lines()).filter(|(a, b)| a != b);
    for (before, after) in differing {
        let key = |line: &str| line.split('=').next().map(str::to_owned);
        assert_eq!(key(before), key(after));
    }
}

#[test]
fn a_program_in_a_target_folder_reads_its_checkout_and_builds_elsewhere() {
    let folder = TempDir::new().expect("a folder");
    let nowhere = folder.path().join("nowhere");
    fs::create_dir(&nowhere).expect("ours");
    // A checkout with a program in its target folder; the user stands elsewhere. That the build fails at once
    // is told with the others.
    let other = folder.path().join("other");
    checkout(&other);
    let board = other.join("firmware/boards/atmega328p/Cargo.toml");
    let manifest = fs::read_to_string(&board).expect("there");
    let manifest = manifest.replace(
        "[profile.release]",
        "[dependencies.none]\npath = \"/nonexistent\"\n\n[profile.release]",
    );
    fs::write(&board, manifest).expect("ours");
    let program = installed(&other.join("target"));
    let arguments = ["build", "--target", "atmega328p"];
    let output = output(command(&program, &nowhere, folder.path(), &arguments));
    let path = |path: &Path| path.canonicalize().expect("there").display().to_string();
    let told = format!(
        "building the sources {} (they came with this program), into {}/cardan",
        path(&other),
        folder.path().display()
    );
    assert_refused(&output, &[&told, "/nonexistent"]);
    assert!(!other.join("target/boards").exists());
    assert!(folder.path().join("cardan/boards/atmega328p").is_dir());
}

#[test]
fn all_builds_what_it_can_and_lists_the_rest_with_what_installs_it() {
    let folder = TempDir::new().expect("a folder");
    // A linker that is not there.
    let none = folder.path().join("ld.lld");
    fs::write(&none, "#!/bin/sh\nexit 1\n").expect("ours");
    fs::set_permissions(&none, fs::Permissions::from_mode(0o755)).expect("ours");
    let path = std::env::var("PATH").unwrap_or_default();
    let mut build = Command::new(cardan());
    build
        .args(["build", "--target", "all", "--json"])
        .current_dir(root())
        .env("PATH", format!("{}:{path}", folder.path().display()));
    let output = output(build);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let found = document(&output);
    let built = found["targets"].as_array().expect("a list");
    assert_eq!(built.len(), 1);
    assert_eq!(built[0]["target"], "atmega328p");
    let left = &found["not_built"][0];
    assert_eq!(
        left["targets"],
        serde_json::json!(["cortex-m0plus", "cortex-m4", "rv32imc"])
    );
    assert!(
        left["parts"].to_string().contains("apt-get install lld"),
        "{left}"
    );
    for part in [
        "not built: cortex-m0plus, cortex-m4, rv32imc",
        "apt-get install lld",
    ] {
        assert!(said.contains(part), "{said}");
    }
}
