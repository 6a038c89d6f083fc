//! `docs/bring-your-own-datapath.md`, done as it is written: in a fresh folder outside the workspace.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use cardan_tests::{root, stderr};
use tempfile::TempDir;

const GUIDE: &str = "docs/bring-your-own-datapath.md";
/// What the guide calls the checkout, and the repository.
const CHECKOUT: &str = "/path/to/cardan";
const REPOSITORY: &str = "https://example.org/cardan";
/// Files of the project.
const FILES: [&str; 4] = ["Cargo.toml", "build.rs", "wordlengths.toml", "src/main.rs"];

/// A block of code with the paragraph before it.
struct Block {
    kind: String,
    before: String,
    text: String,
}

fn blocks() -> Vec<Block> {
    let guide = fs::read_to_string(root().join(GUIDE)).expect("readable");
    let mut found = Vec::new();
    let mut before = String::new();
    let mut lines = guide.lines();
    while let Some(line) = lines.next() {
        if let Some(kind) = line.strip_prefix("```") {
            let text: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
            found.push(Block {
                kind: kind.to_owned(),
                before: before.clone(),
                text: text.join("\n") + "\n",
            });
        } else if !line.trim().is_empty() {
            line.clone_into(&mut before);
        }
    }
    found
}

/// The file that a block is, or a part of: the first that the paragraph before it names.
fn file(block: &Block) -> Option<&'static str> {
    let is_code = ["toml", "rust"].contains(&block.kind.as_str());
    let mut words = block.before.split('`');
    let named = words.find_map(|word| FILES.iter().copied().find(|file| *file == word));
    named.filter(|_| is_code)
}

/// Cargo and the shell in `folder`, without the network; what is compiled goes below the workspace's target
/// folder, so that it is compiled once.
fn command(program: &str, folder: &Path) -> Command {
    let mut command = Command::new(program);
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root().join("target"), Into::into);
    command
        .current_dir(folder)
        .env("CARGO_TARGET_DIR", target.join("guide"))
        // The same bits in half of the time that it takes to compile.
        .env("CARGO_PROFILE_RELEASE_OPT_LEVEL", "1")
        .env("CARGO_NET_OFFLINE", "true");
    command
}

fn succeeded(mut command: Command) -> Output {
    let output = command.output().expect("starts");
    assert!(output.status.success(), "{command:?}: {}", stderr(&output));
    output
}

/// The project's files, with the manifests of both forms.
fn write(folder: &Path, is_git: bool, place: &str) {
    let mut texts: Vec<(&str, String)> = FILES.map(|file| (file, String::new())).into();
    for block in blocks() {
        let Some(name) = file(&block) else { continue };
        if name == "Cargo.toml" && block.text.contains("git = ") != is_git {
            continue;
        }
        let (_, text) = texts
            .iter_mut()
            .find(|(file, _)| *file == name)
            .expect("known");
        if !text.is_empty() {
            text.push('\n');
        }
        text.push_str(&block.text);
    }
    for (name, text) in texts {
        assert!(!text.is_empty(), "the guide shows {name}");
        let text = text.replace(if is_git { REPOSITORY } else { CHECKOUT }, place);
        fs::write(folder.join(name), text).expect("ours");
    }
    // The versions that the workspace has compiled and fetched.
    fs::copy(root().join("Cargo.lock"), folder.join("Cargo.lock")).expect("copied");
}

#[test]
fn the_project_of_the_guide_builds_anywhere_and_prints_what_the_guide_says() {
    let folder = TempDir::new().expect("a folder");
    let mut place = folder.path().to_owned();
    let mut has_files = false;
    let mut printed = String::new();
    let mut compared = 0;
    for block in blocks() {
        match block.kind.as_str() {
            "sh" => {
                for line in block.text.lines() {
                    if let Some(inner) = line.strip_prefix("cd ") {
                        place.push(inner);
                        continue;
                    }
                    if place != folder.path() && !has_files {
                        write(&place, false, &root().display().to_string());
                        has_files = true;
                    }
                    let mut shell = command("sh", &place);
                    shell.args(["-c", line]);
                    printed = String::from_utf8_lossy(&succeeded(shell).stdout).into_owned();
                }
            }
            "text" => {
                assert_eq!(printed, block.text, "after {}", block.before);
                compared += 1;
            }
            _ => {}
        }
    }
    assert!(has_files && compared > 0);
    // The result takes the place of the formats to begin with.
    let tuned = fs::read_to_string(place.join("tuned.toml")).expect("written");
    fs::write(place.join("wordlengths.toml"), tuned).expect("ours");
    let mut build = command("cargo", &place);
    build.args(["build", "--release"]);
    succeeded(build);
}

#[test]
fn the_crates_are_found_in_a_git_repository_too() {
    let folder = TempDir::new().expect("a folder");
    let (repository, project) = (
        folder.path().join("cardan"),
        folder.path().join("my-filter"),
    );
    for inner in ["crates", "firmware", "Cargo.toml"] {
        copy(&root().join(inner), &repository.join(inner));
    }
    for arguments in [
        &["init", "--quiet"][..],
        &["add", "--all"],
        &[
            "-c",
            "user.name=x",
            "-c",
            "user.email=x@example.org",
            "commit",
            "--quiet",
            "-m",
            "x",
        ],
    ] {
        let mut git = command("git", &repository);
        git.args(arguments);
        succeeded(git);
    }
    fs::create_dir_all(project.join("src")).expect("ours");
    write(&project, true, &format!("file://{}", repository.display()));
    let mut metadata = command("cargo", &project);
    metadata
        .args(["metadata", "--format-version", "1"])
        .env("CARGO_NET_OFFLINE", "false");
    let found = String::from_utf8_lossy(&succeeded(metadata).stdout).into_owned();
    for name in ["cardan-datapath", "cardan-numerics", "cardan-tune"] {
        let id = format!("git+file://{}#{name}@", repository.display());
        assert!(found.contains(&id), "{name}");
    }
}

fn copy(from: &Path, to: &Path) {
    if from.is_file() {
        fs::create_dir_all(to.parent().expect("a folder")).expect("ours");
        fs::copy(from, to).expect("copied");
        return;
    }
    for entry in fs::read_dir(from).expect("readable") {
        let path = entry.expect("readable").path();
        let name = path.file_name().expect("a name");
        if name != "target" {
            copy(&path, &to.join(name));
        }
    }
}
