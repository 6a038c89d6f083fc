//! `cargo xtask dist`: the package and the archive as they are installed, with the program under test in them.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use cardan_tests::{cardan, root, stderr};
use serde_json::Value;
use tempfile::TempDir;

fn succeeded(command: &mut Command) -> Output {
    let output = command.output().expect("starts");
    assert!(output.status.success(), "{command:?}: {}", stderr(&output));
    output
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The program without what a release has not either: packing takes a tenth of the time.
fn stripped(folder: &Path) -> PathBuf {
    let program = folder.join("cardan");
    succeeded(Command::new("strip").arg("-o").arg(&program).arg(cardan()));
    program
}

/// Packs `program` into a new folder under `folder`; the package and the archive.
fn packed(program: &Path, folder: &Path, name: &str) -> [PathBuf; 2] {
    let out = folder.join(name);
    let xtask = cardan().with_file_name("xtask");
    let mut dist = Command::new(xtask);
    dist.args(["dist", "--out"])
        .arg(&out)
        .arg("--program")
        .arg(program)
        .current_dir(root())
        .env_remove("CARGO_MANIFEST_DIR")
        .env("SOURCE_DATE_EPOCH", "1700000000");
    succeeded(&mut dist);
    let mut found: Vec<PathBuf> = fs::read_dir(&out)
        .expect("made")
        .map(|entry| entry.expect("readable").path())
        .collect();
    found.sort();
    found.try_into().expect("two files and nothing else")
}

/// What the installed program says in `folder`.
fn said(program: &Path, folder: &Path, arguments: &[&str]) -> Value {
    let mut command = Command::new(program);
    command
        .args(arguments)
        .current_dir(folder)
        .env_remove("CARGO_TARGET_DIR");
    let output = succeeded(&mut command);
    serde_json::from_slice(&output.stdout).expect("a document")
}

#[test]
fn the_same_sources_give_the_same_package_and_archive_which_work_outside_a_checkout() {
    let folder = TempDir::new().expect("a folder");
    let program = stripped(folder.path());
    let [archive, package] = packed(&program, folder.path(), "one");
    for (one, two) in [&archive, &package]
        .into_iter()
        .zip(&packed(&program, folder.path(), "two"))
    {
        let equal = fs::read(one).expect("readable") == fs::read(two).expect("readable");
        assert!(equal, "{} differs", one.display());
        let name = one.file_name().expect("a name").to_string_lossy();
        assert!(name.contains(env!("CARGO_PKG_VERSION")), "{name}");
    }

    let control = text(&succeeded(Command::new("dpkg-deb").arg("-I").arg(&package)));
    for part in [
        "Package: cardan",
        "libc6 (>= 2.",
        "Architecture: ",
        "Maintainer: ",
    ] {
        assert!(control.contains(part), "{part}: {control}");
    }
    let listed = text(&succeeded(Command::new("dpkg-deb").arg("-c").arg(&package)));
    for line in listed.lines() {
        assert!(line.contains(" root/root "), "{line}");
        assert!(line.contains("2023-11-14"), "{line}");
    }

    let roots = ["deb", "tar"].map(|name| folder.path().join(name));
    for root in &roots {
        fs::create_dir(root).expect("ours");
    }
    succeeded(
        Command::new("dpkg-deb")
            .arg("-x")
            .arg(&package)
            .arg(&roots[0]),
    );
    let mut tar = Command::new("tar");
    tar.arg("-xzf").arg(&archive).arg("-C").arg(&roots[1]);
    succeeded(&mut tar);
    let mut top = fs::read_dir(&roots[1]).expect("unpacked");
    let top = top.next().expect("one folder").expect("readable").path();
    let installed_one = roots[0].join("usr");
    for prefix in [&installed_one, &top] {
        installed(prefix, folder.path());
    }
    bundles(&installed_one);
}

/// Everything is in its place, and the program works.
fn installed(prefix: &Path, folder: &Path) {
    for file in [
        "share/man/man1/cardan.1.gz",
        "share/man/man1/cardan-compare.1.gz",
        "share/bash-completion/completions/cardan",
        "share/zsh/vendor-completions/_cardan",
        "share/fish/vendor_completions.d/cardan.fish",
        "share/doc/cardan/copyright",
        "share/doc/cardan/LICENSE-MIT",
        "share/doc/cardan/examples/corners.toml",
        "share/cardan/sources/firmware/wordlengths.toml",
    ] {
        assert!(prefix.join(file).is_file(), "{file}");
    }
    let licences = prefix.join("share/doc/cardan/THIRD-PARTY-LICENCES");
    let licences = fs::read_to_string(licences).expect("the list");
    for part in [
        "\nserialport 4.",
        ": MPL-2.0\n",
        "Mozilla Public License",
        "\nnalgebra ",
        "\navr-device ",
        "Permission is hereby granted",
    ] {
        assert!(licences.contains(part), "{part}");
    }
    assert!(!licences.contains("\npaste "));
    let program = prefix.join("bin/cardan");
    let compared = said(
        &program,
        folder,
        &["compare", "--seconds", "1", "--json", "--quiet"],
    );
    assert_eq!(compared["verdict"], "pass");
}

/// The firmware sources that came with the program are those that it was made of, and Cargo takes them without
/// the rest of the repository. (That they build, and where, is `checkouts.rs`: it takes minutes.)
fn bundles(prefix: &Path) {
    let program = prefix.join("bin/cardan");
    let sources = prefix.join("share/cardan/sources");
    let compare = [
        "compare",
        "--in-process",
        "--seconds",
        "0.5",
        "--json",
        "--quiet",
    ];
    let compared = said(&program, &sources, &compare);
    assert_eq!(compared["stale"], Value::Null);
    for board in ["atmega328p", "cortex-m0plus", "cortex-m4", "rv32imc"] {
        let mut metadata = Command::new(env!("CARGO"));
        metadata
            .args(["metadata", "--locked", "--format-version", "1"])
            .current_dir(sources.join("firmware/boards").join(board));
        let found = text(&succeeded(&mut metadata));
        let sources = sources.canonicalize().expect("there");
        let firmware = format!("{}/firmware/Cargo.toml", sources.display());
        assert!(found.contains(&firmware), "{board}");
    }
}

#[test]
fn without_a_time_or_with_unknown_words_nothing_is_made() {
    let folder = TempDir::new().expect("a folder");
    let xtask = cardan().with_file_name("xtask");
    for (arguments, epoch, part) in [
        (&["dist", "--program", "x"][..], "soon", "SOURCE_DATE_EPOCH"),
        (&["dist", "--fast"], "0", "--out DIR"),
        (&["dist", "--program", "/nonexistent"], "0", "/nonexistent"),
    ] {
        let out = folder.path().join("out");
        let mut dist = Command::new(&xtask);
        dist.args(arguments)
            .current_dir(root())
            .env("CARGO_TARGET_DIR", &out)
            .env("SOURCE_DATE_EPOCH", epoch);
        let output = dist.output().expect("starts");
        assert_eq!(output.status.code(), Some(1));
        assert!(stderr(&output).contains(part), "{}", stderr(&output));
        let made = out.join("dist");
        let left = fs::read_dir(made).map(Iterator::count).unwrap_or_default();
        assert_eq!(left, 0, "nothing is left behind");
    }
}
