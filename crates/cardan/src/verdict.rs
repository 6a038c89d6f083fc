//! The end of a comparison: table, JSON, report, dump, exit code.

use std::path::PathBuf;
use std::process::ExitCode;

use cardan_bench::App;
use cardan_compare::table;
use cardan_compare::{Comparison, Verdict, compare, html};
use clap::Args;

use crate::ci::CiOptions;
use crate::dump::{self, DumpOptions};
use crate::failure::{Done, code};
use crate::files::{Plan, write_into};
use crate::output::Output;
use crate::participants::diff::Collected;
use crate::run_options::RunOptions;

/// What else is written.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct Extras {
    /// Write a self-contained HTML report into this folder
    #[arg(long, value_name = "DIR")]
    pub(crate) report: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) dump: DumpOptions,
    #[command(flatten)]
    pub(crate) ci: CiOptions,
}

impl Extras {
    /// The same with everything that `run` reads, for a check before the work.
    pub(crate) fn files(&self, run: &RunOptions) -> Plan {
        run.inputs()
            .input("--baseline", self.ci.baseline())
            .output("--junit", self.ci.junit())
            .output("--dump", self.dump.file())
            .folder("--report", self.report.as_deref(), &[html::FILE])
    }
}

/// Judges, prints, writes; the exit code is the verdict.
pub(crate) fn publish(
    comparison: &Comparison,
    collected: &Collected,
    extras: &Extras,
    dump: Option<(&dump::Plan, &dyn App)>,
    output: Output,
) -> Done {
    let mut report = compare(comparison);
    extras.ci.judge(&mut report)?;
    if let Some(folder) = &extras.report {
        let page = html::page(&report, comparison);
        let path = write_into("--report", folder, html::FILE, page)?;
        output.note(&format!("report: {}", path.display()));
    }
    if let Some((plan, app)) = dump {
        plan.write(app, comparison, collected)?;
        output.note(&format!("dump: {}", plan.file().display()));
    }
    extras.ci.write(&report, output)?;
    if output.is_json() {
        output.document(&report)?;
    }
    output.result(&table::render(&report, output.style()))?;
    if let Some(crash) = &collected.emulated_summary.crash {
        output.error(&format!("the emulated program crashed: {crash}"));
        return Ok(ExitCode::from(code::CRASH));
    }
    Ok(ExitCode::from(match report.verdict {
        Verdict::Pass => code::PASS,
        Verdict::Fail => code::FAIL,
    }))
}

/// The command that runs this comparison again.
pub(crate) fn command_line(run: &RunOptions) -> String {
    format!("cardan compare{}", run.arguments().typed())
}
