//! `doctor`: which toolchains and system parts are there, and what installs the missing ones.

mod parts;
mod shared_memory;

use std::fmt::Write;
use std::process::ExitCode;

use clap::Args;
use serde::Serialize;

use self::parts::{Need, Part};
use crate::failure::{Done, code};
use crate::output::Output;

/// Shows which toolchains and system parts are there, what each is for, and what installs those
/// that are missing.
///
/// `compare` needs nothing but shared memory; the other parts are for cross-compiling and for this
/// repository's own tests. Exits with 0 if `compare` can run, else with 1.
#[derive(Args)]
pub(crate) struct Arguments {}

/// The JSON document.
#[derive(Serialize)]
struct Document {
    /// Whether `compare` can run.
    ready: bool,
    parts: Vec<Part>,
}

/// Runs the command.
pub(crate) fn execute(_arguments: &Arguments, output: Output) -> Done {
    let parts = parts::all();
    let ready = parts
        .iter()
        .all(|part| part.is_present() || part.needed_for != Need::Compare);
    let document = Document { ready, parts };
    if output.is_json() {
        output.document(&document)?;
    }
    output.result(&text(&document))?;
    Ok(ExitCode::from(if ready { code::PASS } else { code::FAIL }))
}

fn text(document: &Document) -> String {
    let mut text = String::new();
    for need in [Need::Compare, Need::Build, Need::Tests] {
        let _ = writeln!(text, "{}", need.title());
        for part in document.parts.iter().filter(|part| part.needed_for == need) {
            let _ = writeln!(text, "{part}");
        }
        text.push('\n');
    }
    text.push_str(match document.ready {
        true => "`cardan compare` can run.",
        false => "`cardan compare` cannot run: see the first section.",
    });
    let missing: Vec<&Part> = document
        .parts
        .iter()
        .filter(|part| !part.is_present())
        .collect();
    let optional = missing
        .iter()
        .filter(|part| part.needed_for != Need::Compare)
        .count();
    if optional > 0 {
        let _ = write!(text, " {optional} optional parts are missing.");
    }
    let packages: Vec<&str> = missing
        .iter()
        .flat_map(|part| part.packages.iter().copied())
        .collect();
    if !packages.is_empty() {
        let _ = write!(
            text,
            "\nAll at once: sudo apt-get install {}",
            packages.join(" ")
        );
    }
    text
}
