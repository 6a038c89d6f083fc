//! The report as one self-contained page: no scripts, no fonts or images from elsewhere.

mod budget;
mod flow;
mod group;
mod nodes;
mod run;
mod summary;

use maud::html;

use crate::input::Comparison;
use crate::plots::Plots;
use crate::report::Report;
use crate::verdict::Verdict;

/// File name of the page in the report's folder.
pub const FILE: &str = "report.html";

/// The page as text. `facts` are those that `report` was made from, `plots` what was kept of its curves.
#[must_use]
pub fn page(report: &Report, facts: &Comparison, plots: &Plots) -> String {
    let verdict = match report.verdict {
        Verdict::Pass => "PASS",
        Verdict::Fail => "FAIL",
    };
    let title = format!("{verdict} · {} on {}", report.app, report.scenario);
    let content = html! {
        (summary::section(report))
        (group::section(report, facts, plots))
        (budget::section(report, facts))
        (nodes::section(report, facts, plots))
        (flow::section(report, facts))
        (run::section(report))
    };
    cardan_page::document(&title, &content)
}
