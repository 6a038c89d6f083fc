//! Dumps of a comparison for other tools: what is written, into which kind of file.
//!
//! Without `--dump-signal` one row per solution ([`solutions`]); with it the signals named, on one
//! time base ([`series`]). As CSV or as a structured NumPy array ([`table`]).

mod series;
mod signal;
mod solutions;
mod table;

use std::path::{Path, PathBuf};

use cardan_bench::App;
use cardan_compare::Comparison;
use clap::Args;

use crate::failure::Failure;
use crate::files::write_whole;
use crate::participants::diff::Collected;

pub(crate) use signal::{Signal, Stage};

/// What is to be written.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct DumpOptions {
    /// Write values as a table (.csv) or a structured NumPy array (.npy): node values of every
    /// solution, or the signals that --dump-signal names
    #[arg(long, value_name = "FILE")]
    dump: Option<PathBuf>,
    /// A signal to dump instead, by cycle; may be repeated: a node, `code`, a pin (PB1), adc0_V to
    /// adc4_V (ideal voltage at the hold instants), or a voltage inside the front end then
    /// (adc0_band_pass_V, adc0_hold_plus_V, adc0_hold_minus_V, adc0_low_pass_V)
    #[arg(long, value_name = "NAME", requires = "dump")]
    dump_signal: Vec<String>,
}

/// Kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Csv,
    Npy,
}

/// A dump whose options are sound.
#[derive(Debug)]
pub(crate) struct Plan {
    file: PathBuf,
    kind: Kind,
    signals: Vec<Signal>,
}

impl DumpOptions {
    /// The file.
    pub(crate) fn file(&self) -> Option<&Path> {
        self.dump.as_deref()
    }

    /// Names of signals as given.
    pub(crate) fn signals(&self) -> &[String] {
        &self.dump_signal
    }

    /// Checks file and signals; none if nothing is to be written.
    ///
    /// # Errors
    /// Another kind of file, an unknown signal, a signal named twice.
    pub(crate) fn plan(&self, app: &dyn App) -> Result<Option<Plan>, Failure> {
        let Some(file) = &self.dump else {
            return Ok(None);
        };
        let extension = file
            .extension()
            .map(|extension| extension.to_ascii_lowercase());
        let kind = match extension
            .as_deref()
            .and_then(|extension| extension.to_str())
        {
            Some("csv") => Kind::Csv,
            Some("npy") => Kind::Npy,
            _ => {
                return Err(Failure::input(format!(
                    "--dump {}: expected a name that ends in .csv (text) or .npy (NumPy)",
                    file.display()
                )));
            }
        };
        Ok(Some(Plan {
            file: file.clone(),
            kind,
            signals: signals(&self.dump_signal, app)?,
        }))
    }
}

/// The signals of these names.
///
/// # Errors
/// An unknown signal, or one named twice.
pub(crate) fn signals(names: &[String], app: &dyn App) -> Result<Vec<Signal>, Failure> {
    let mut signals = Vec::new();
    for name in names {
        let signal = Signal::parse(name, app)
            .map_err(|problem| Failure::input(format!("--dump-signal {name}: {problem}")))?;
        if signals.contains(&signal) {
            let problem = "named twice; give each signal once";
            return Err(Failure::input(format!("--dump-signal {name}: {problem}")));
        }
        signals.push(signal);
    }
    Ok(signals)
}

impl Plan {
    /// Where it goes.
    pub(crate) fn file(&self) -> &Path {
        &self.file
    }

    /// What is asked for.
    pub(crate) fn signals(&self) -> &[Signal] {
        &self.signals
    }

    /// Nodes among them.
    pub(crate) fn nodes(&self) -> Vec<usize> {
        let nodes = self.signals.iter().filter_map(|signal| match signal {
            Signal::Node(node) => Some(*node),
            _ => None,
        });
        nodes.collect()
    }

    /// Writes the file.
    ///
    /// # Errors
    /// A signal that nobody published, a file that cannot be written.
    pub(crate) fn write(
        &self,
        app: &dyn App,
        comparison: &Comparison,
        collected: &Collected,
    ) -> Result<(), Failure> {
        let table = match self.signals.is_empty() {
            true => solutions::table(comparison, collected),
            false => series::table(&self.signals, app, comparison, collected)?,
        };
        match self.kind {
            Kind::Csv => write_whole("--dump", &self.file, table.csv()),
            Kind::Npy => write_whole("--dump", &self.file, table.npy()),
        }
    }
}
