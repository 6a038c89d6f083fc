//! The report as one self-contained page: no scripts, no fonts or images from elsewhere.

mod attitude;
mod budget;
mod flow;
mod nodes;
mod run;
mod summary;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use maud::html;

use crate::input::Comparison;
use crate::report::Report;
use crate::verdict::Verdict;

/// File name of the page in the report's folder.
pub const FILE: &str = "report.html";

/// The page could not be written.
#[derive(Debug, thiserror::Error)]
#[error(
    "cannot write the report to {}: {source}; give a folder that can be written to", path.display()
)]
pub struct WriteError {
    /// Where it should have gone.
    pub path: PathBuf,
    source: io::Error,
}

/// Writes the page to `folder`, which is made if need be, and returns the file's path.
///
/// # Errors
/// When the folder or the file cannot be written; the error names it.
pub fn write(
    report: &Report,
    comparison: &Comparison,
    folder: &Path,
) -> Result<PathBuf, WriteError> {
    let path = folder.join(FILE);
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(&path, page(report, comparison)))
        .map_err(|source| WriteError {
            path: path.clone(),
            source,
        })?;
    Ok(path)
}

/// The page as text. `comparison` is the one that `report` was made from; it gives the curves.
#[must_use]
pub fn page(report: &Report, comparison: &Comparison) -> String {
    let verdict = match report.verdict {
        Verdict::Pass => "PASS",
        Verdict::Fail => "FAIL",
    };
    let title = format!("{verdict} · {} on {}", report.app, report.scenario);
    let content = html! {
        (summary::section(report))
        (attitude::section(report, comparison))
        (budget::section(report))
        (nodes::section(report, comparison))
        (flow::section(report, comparison))
        (run::section(report))
    };
    cardan_page::document(&title, &content)
}
