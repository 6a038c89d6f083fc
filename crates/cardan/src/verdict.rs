//! The end of a comparison: table, JSON, report, dump, exit code.

use std::path::PathBuf;
use std::process::ExitCode;

use cardan_compare::table;
use cardan_compare::{Plots, Verdict, html};
use clap::Args;

use crate::ci::CiOptions;
use crate::dump::DumpOptions;
use crate::failure::{Done, code};
use crate::files::{Plan, write_into};
use crate::judge::Outcome;
use crate::output::Output;
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

/// Prints and writes; the exit code is the verdict.
pub(crate) fn publish(outcome: Outcome, extras: &Extras, output: Output) -> Done {
    let Outcome {
        mut report,
        facts,
        plots,
        dump,
        crash,
    } = outcome;
    extras.ci.judge(&mut report)?;
    if let Some(folder) = &extras.report {
        let page = html::page(&report, &facts, &plots.unwrap_or_else(Plots::default));
        let path = write_into("--report", folder, html::FILE, page)?;
        output.note(&format!("report: {}", path.display()));
    }
    if let (Some(dump), Some(file)) = (dump, extras.dump.file()) {
        dump.finish()?;
        output.note(&format!("dump: {}", file.display()));
    }
    extras.ci.write(&report, output)?;
    if output.is_json() {
        output.document(&report)?;
    }
    output.result(&table::render(&report, output.style()))?;
    if let Some(crash) = &crash {
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
