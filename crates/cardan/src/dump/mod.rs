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
use crate::files::unwritten;
use crate::participants::diff::Collected;

use self::series::Series;
use self::solutions::Solutions;
use self::table::Table;
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
enum Format {
    Csv,
    Npy,
}

/// A dump whose options are sound.
#[derive(Debug)]
pub(crate) struct Plan {
    file: PathBuf,
    format: Format,
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
        let format = match extension
            .as_deref()
            .and_then(|extension| extension.to_str())
        {
            Some("csv") => Format::Csv,
            Some("npy") => Format::Npy,
            _ => {
                return Err(Failure::input(format!(
                    "--dump {}: expected a name that ends in .csv (text) or .npy (NumPy)",
                    file.display()
                )));
            }
        };
        Ok(Some(Plan {
            file: file.clone(),
            format,
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
    /// What is asked for.
    pub(crate) fn signals(&self) -> &[Signal] {
        &self.signals
    }

    /// Begins to write the values of the run that `facts` tell of.
    ///
    /// # Errors
    /// A node that takes no value in it, a file that cannot be written.
    pub(crate) fn begin(
        &self,
        app: &'static dyn App,
        facts: &Comparison,
    ) -> Result<Writer, Failure> {
        let columns = match self.signals.is_empty() {
            true => solutions::columns(facts),
            false => series::columns(&self.signals, app, facts)?,
        };
        let table = Table::begin(&self.file, self.format, columns)
            .map_err(|error| unwritten("--dump", &self.file, &error))?;
        let rows = match self.signals.is_empty() {
            true => Rows::Solutions(Solutions::default()),
            false => Rows::Series(Series::new(&self.signals, app, facts, table.width())?),
        };
        Ok(Writer {
            file: self.file.clone(),
            table,
            rows,
        })
    }
}

/// A dump being written, window by window.
#[derive(Debug)]
pub(crate) struct Writer {
    file: PathBuf,
    table: Table,
    rows: Rows,
}

/// What the rows are of.
#[derive(Debug)]
enum Rows {
    Solutions(Solutions),
    Series(Series),
}

impl Writer {
    /// Nodes whose cycles are wanted, and whether signals are that the emulated participant publishes.
    pub(crate) fn timed(&self) -> (Vec<usize>, bool) {
        match &self.rows {
            Rows::Solutions(_) => (Vec::new(), false),
            Rows::Series(series) => (series.nodes(), series.is_published()),
        }
    }

    /// Adds a window.
    ///
    /// # Errors
    /// A disk that takes no more.
    pub(crate) fn add(
        &mut self,
        window: &Comparison,
        collected: &Collected,
    ) -> Result<(), Failure> {
        let table = &mut self.table;
        let written = match &mut self.rows {
            Rows::Solutions(solutions) => solutions.add(window, collected, table),
            Rows::Series(series) => series.add(window, collected, table),
        };
        written.map_err(|error| unwritten("--dump", &self.file, &error))
    }

    /// Puts the file in its place.
    ///
    /// # Errors
    /// A signal that nobody published, a file that cannot be written.
    pub(crate) fn finish(mut self) -> Result<(), Failure> {
        let written = match &mut self.rows {
            Rows::Solutions(_) => Ok(()),
            Rows::Series(series) => {
                series.check()?;
                series.flush(u64::MAX, &mut self.table)
            }
        };
        written
            .and_then(|()| self.table.finish(&self.file))
            .map_err(|error| unwritten("--dump", &self.file, &error))
    }
}
