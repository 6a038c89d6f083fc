//! The licence list of a release: every crate that is linked into the program or into the firmware images that
//! are part of it, with its licence, where its source is, and the licence texts of its package.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::shell::{cargo, first_line, output};

/// Begins the names of files that hold licence texts.
const TEXTS: [&str; 6] = [
    "license",
    "licence",
    "copying",
    "copyright",
    "notice",
    "unlicense",
];
/// The image that is part of the program, as a package.
const IMAGE: &str = "firmware/boards/atmega328p/Cargo.toml";
/// What is linked and no crate.
const OTHERS: &str = "\
The Rust standard library (MIT OR Apache-2.0), https://github.com/rust-lang/rust: in the program and, its core \
library, in the firmware images.
avr-libc (BSD-3-Clause), https://github.com/avrdudes/avr-libc: its start-up code is in the firmware images.
";

/// A crate of a registry.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Crate {
    name: String,
    version: String,
    licence: String,
    /// Its folder.
    folder: String,
}

/// The list as text.
///
/// # Errors
/// Cargo cannot tell the dependencies, or a crate names no licence.
pub(crate) fn list() -> Result<String, String> {
    let host = host()?;
    let program = metadata(&["--filter-platform", &host])?;
    let image = metadata(&["--manifest-path", IMAGE])?;
    let mut crates = BTreeSet::new();
    linked(&program, "cardan", &mut crates)?;
    linked(&image, "cardan-atmega328p", &mut crates)?;
    let mut out = format!(
        "Cardan is MIT OR Apache-2.0. The program contains these {} crates, unchanged; their sources are at the \
         addresses given.\n{OTHERS}\n",
        crates.len()
    );
    let mut texts: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for one in &crates {
        let Crate {
            name,
            version,
            licence,
            folder,
        } = one;
        let _ = writeln!(
            out,
            "{name} {version}: {licence}\n    https://crates.io/crates/{name}/{version}"
        );
        for text in texts_in(Path::new(folder))? {
            texts
                .entry(text)
                .or_default()
                .push(format!("{name} {version}"));
        }
    }
    for (text, owners) in texts {
        let _ = write!(
            out,
            "\n{}\n{}\n\n{text}\n",
            "-".repeat(80),
            owners.join(", ")
        );
    }
    Ok(out)
}

/// The host's target triple.
fn host() -> Result<String, String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or("rustc".into());
    first_line(&rustc, &["-vV"], "host: ")
        .ok_or_else(|| "rustc does not say which host it is for".to_owned())
}

fn metadata(more: &[&str]) -> Result<Value, String> {
    let arguments = [&["metadata", "--format-version", "1", "--locked"], more].concat();
    let text = output(cargo(&arguments))?;
    serde_json::from_str(&text).map_err(|error| format!("cargo metadata: {error}"))
}

/// Adds what is linked into package `root`: its normal dependencies and theirs.
fn linked(metadata: &Value, root: &str, crates: &mut BTreeSet<Crate>) -> Result<(), String> {
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let packages: BTreeMap<String, Value> = list(&metadata["packages"])
        .into_iter()
        .map(|package| (text(&package["id"]), package))
        .collect();
    let nodes: BTreeMap<String, Value> = list(&metadata["resolve"]["nodes"])
        .into_iter()
        .map(|node| (text(&node["id"]), node))
        .collect();
    let mut waiting: Vec<String> = packages
        .iter()
        .filter(|(_, package)| package["name"] == root)
        .map(|(id, _)| id.clone())
        .collect();
    if waiting.is_empty() {
        return Err(format!("cargo metadata names no package {root}"));
    }
    let mut seen = BTreeSet::new();
    while let Some(id) = waiting.pop() {
        if !seen.insert(id.clone()) {
            continue;
        }
        let package = &packages[&id];
        if package["source"].is_string() {
            let (name, version) = (text(&package["name"]), text(&package["version"]));
            let licence = package["license"].as_str();
            let licence = licence.ok_or_else(|| format!("{name} {version} names no licence"))?;
            let folder = Path::new(package["manifest_path"].as_str().unwrap_or_default()).parent();
            crates.insert(Crate {
                licence: licence.replace('/', " OR ").replace("  ", " "),
                folder: folder.unwrap_or(Path::new("")).display().to_string(),
                name,
                version,
            });
        }
        for dependency in list(&nodes[&id]["deps"]) {
            let kinds = list(&dependency["dep_kinds"]);
            if kinds.iter().any(|kind| kind["kind"].is_null()) {
                waiting.push(text(&dependency["pkg"]));
            }
        }
    }
    Ok(())
}

/// The licence texts in a package's folder.
fn texts_in(folder: &Path) -> Result<Vec<String>, String> {
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let lower = name.to_lowercase();
        if path.is_file() && TEXTS.iter().any(|start| lower.starts_with(start)) {
            names.push(path);
        }
    }
    names.sort();
    let texts = names.iter().map(|path| {
        let text = fs::read(path).map_err(failed)?;
        Ok(String::from_utf8_lossy(&text).trim().to_owned())
    });
    texts.collect()
}
