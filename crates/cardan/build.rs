//! Tells the program which firmware sources its native firmware is compiled from.

#[path = "src/toolchain/digest.rs"]
mod digest;

use std::path::Path;

fn main() {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let workspace = workspace.canonicalize().unwrap_or(workspace);
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/toolchain/digest.rs");
    // Without the sources there is nothing to compare with, and the program says nothing.
    let folders = [digest::REFERENCE];
    for file in digest::files(&workspace, &folders).unwrap_or_default() {
        println!("cargo::rerun-if-changed={}", file.display());
    }
    let sources = digest::of(&workspace, &folders).unwrap_or_default();
    println!("cargo::rustc-env=CARDAN_SOURCES={sources}");
}
