//! The report as one self-contained page: no scripts, no fonts or images from elsewhere.

mod attitude;
mod budget;
mod flow;
mod nodes;
mod run;
mod summary;

use maud::html;

use crate::input::Comparison;
use crate::report::Report;
use crate::verdict::Verdict;

/// File name of the page in the report's folder.
pub const FILE: &str = "report.html";

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
