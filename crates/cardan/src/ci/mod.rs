//! A comparison in continuous integration: JUnit, annotations of GitHub, and a stored run as the measure.

mod baseline;
mod github;
mod junit;

use std::path::{Path, PathBuf};

use cardan_compare::Report;
use clap::Args;

use crate::arguments::Arguments;
use crate::failure::Failure;
use crate::files::write_whole;
use crate::output::Output;
use crate::run_options::Setup;

/// Options for continuous integration.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct CiOptions {
    /// Write the result as JUnit XML: a test case per node, and per kind of check
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// A document of an earlier `compare --json` of the same run: any error figure that is worse than its by
    /// more than --margin fails, and is named
    #[arg(long, value_name = "FILE")]
    baseline: Option<PathBuf>,
    /// By how much figures may be worse than the baseline's, in percent [default: 10]
    #[arg(long, value_name = "PERCENT", value_parser = percent, allow_negative_numbers = true,
        requires = "baseline")]
    margin: Option<f64>,
    /// Say every reason as an annotation of GitHub too (by itself where GITHUB_ACTIONS is set)
    #[arg(long)]
    annotations: bool,
}

/// Margin where none is given, in percent.
const MARGIN: f64 = 10.0;

fn percent(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let number = number.filter(|number: &f64| number.is_finite() && *number >= 0.0);
    number.ok_or_else(|| "expected a percentage from 0 up, such as 10".to_owned())
}

impl CiOptions {
    /// A baseline that cannot be used is told before anything runs.
    pub(crate) fn check(&self, setup: &Setup) -> Result<(), Failure> {
        match &self.baseline {
            Some(file) => baseline::read(file)?.check(file, setup),
            None => Ok(()),
        }
    }

    /// Whether a margin is given.
    pub(crate) const fn has_margin(&self) -> bool {
        self.margin.is_some()
    }

    /// The file of results as JUnit XML.
    pub(crate) fn junit(&self) -> Option<&Path> {
        self.junit.as_deref()
    }

    /// The document to be compared with.
    pub(crate) fn baseline(&self) -> Option<&Path> {
        self.baseline.as_deref()
    }

    /// The options as arguments for a child process.
    pub(crate) fn arguments(&self) -> Arguments {
        let mut arguments = Arguments::default();
        arguments.give_some("--junit", self.junit.as_ref());
        arguments.give_some("--baseline", self.baseline.as_ref());
        if let (Some(margin), Some(_)) = (self.margin, &self.baseline) {
            arguments.give("--margin", margin.to_string());
        }
        if self.annotations {
            arguments.switch("--annotations");
        }
        arguments
    }

    /// Adds what is worse than the baseline to the reasons.
    pub(crate) fn judge(&self, report: &mut Report) -> Result<(), Failure> {
        if let Some(file) = &self.baseline {
            let margin = self.margin.unwrap_or(MARGIN) / 100.0;
            baseline::read(file)?.judge(report, margin)?;
        }
        Ok(())
    }

    /// Writes what else is asked for.
    pub(crate) fn write(&self, report: &Report, output: Output) -> Result<(), Failure> {
        if let Some(file) = &self.junit {
            write_whole("--junit", file, junit::document(report))?;
            output.note(&format!("junit: {}", shown(file)));
        }
        if self.annotations || std::env::var("GITHUB_ACTIONS").as_deref() == Ok("true") {
            for line in github::annotations(report) {
                eprintln!("{line}");
            }
        }
        Ok(())
    }
}

fn shown(file: &Path) -> String {
    file.display().to_string()
}
