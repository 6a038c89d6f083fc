//! The result over corners and units as a page.

use std::path::{Path, PathBuf};

use cardan_page::format::{count, number, optional, percent};
use cardan_page::plot::{Bar, bars};
use cardan_page::{document, framed, masthead, reproduce};
use maud::{Markup, html};

use super::report::{Report, Run};
use crate::failure::Failure;
use crate::files::write_into;

/// Units that have a row of their own.
const MOST_UNITS: usize = 40;
/// The page in its folder.
pub(super) const FILE: &str = "corners.html";

/// Writes the page into `folder` and returns its path.
pub(super) fn write(report: &Report, folder: &Path) -> Result<PathBuf, Failure> {
    write_into("--report", folder, FILE, page(report))
}

fn page(report: &Report) -> String {
    let title = report.title();
    let pass = report.passes();
    let shown = report.shown(MOST_UNITS);
    let statement = report.yield_told().unwrap_or_else(|| report.told());
    let errors: Vec<Bar> = shown
        .iter()
        .map(|run| Bar {
            name: run.name.clone(),
            remark: run
                .reason
                .iter()
                .chain(&run.refused)
                .next()
                .cloned()
                .unwrap_or_default(),
            size: run.rms_deg,
            class: if run.passes() { "" } else { "alarm" },
        })
        .collect();
    let content = html! {
        (masthead("compare --corners", &title, Some(pass), &statement))
        (framed(
            "runs",
            "Variants",
            "The scenario itself, its named corners, and the random units from the worst on. The share is that \
             of the node nearest to its limit.",
            &table(&shown),
        ))
        (framed(
            "errors",
            "Attitude error",
            &format!("Degrees rms over solutions without status flags, against {}; logarithmic.", report.measure()),
            &bars(&errors, "°"),
        ))
        @if let Some(worst) = report.worst() { (reproduce(&worst.reproduce)) }
    };
    document(&title, &content)
}

fn table(runs: &[&Run]) -> Markup {
    html! {
        div.scroll { table.nodes.runs {
            thead { tr {
                th scope="col" {}
                th scope="col" { "variant" }
                th.number scope="col" { "rms °" }
                th.number scope="col" { "max °" }
                th.number scope="col" { "flagged" }
                th.number scope="col" { "solutions" }
                th scope="col" { "nearest to its limit" }
                th scope="col" { "set" }
            } }
            tbody { @for run in runs {
                tr .bad[!run.passes()] {
                    td.mark { @if run.passes() { "✓" } @else { "✗" } }
                    th scope="row" { (run.name) }
                    td.number { (optional(run.rms_deg)) }
                    td.number { (optional(run.max_deg)) }
                    td.number { (run.flagged_share.map_or_else(|| "–".to_owned(), percent)) }
                    td.number { (count(run.solutions)) }
                    td { (run.nearest()) }
                    td.prose {
                        @for (key, value) in run.settings() { (key) " = " (number(value)) " " }
                    }
                }
            } }
        } }
    }
}
