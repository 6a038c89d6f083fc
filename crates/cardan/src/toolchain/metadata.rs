//! What Cargo knows about a board's packages.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Deserialize;

/// The part of `cargo metadata` that is looked at.
#[derive(Deserialize)]
pub(super) struct Metadata {
    packages: Vec<Package>,
}

#[derive(Deserialize)]
struct Package {
    source: Option<String>,
    manifest_path: PathBuf,
}

impl Metadata {
    /// Folders that hold the sources of packages from a registry.
    pub(super) fn registries(&self) -> BTreeSet<PathBuf> {
        let foreign = self
            .packages
            .iter()
            .filter(|package| package.source.is_some());
        let folders = foreign.filter_map(|package| package.manifest_path.parent()?.parent());
        folders.map(Path::to_owned).collect()
    }
}

/// A message of `cargo build --message-format=json`.
#[derive(Deserialize)]
struct Message {
    executable: Option<PathBuf>,
}

/// The executable among the messages of a build.
pub(super) fn executable(messages: &str) -> Option<PathBuf> {
    let mut parsed = messages
        .lines()
        .rev()
        .filter_map(|line| serde_json::from_str::<Message>(line).ok());
    parsed.find_map(|message| message.executable)
}
