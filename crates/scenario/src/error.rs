//! What can be wrong with a scenario or a recording; every message says where and how to mend it.

use std::path::PathBuf;

/// A scenario or recording cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// No bundled scenario and no file of that name.
    #[error(
        "no scenario '{name}': neither a bundled one ({bundled}) nor a file that exists; {hint}"
    )]
    UnknownScenario {
        /// What was asked for.
        name: String,
        /// The bundled names.
        bundled: String,
        /// What to do.
        hint: String,
    },
    /// The file cannot be read.
    #[error("cannot read {path}: {reason}")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        reason: std::io::Error,
    },
    /// The file is not TOML, or a key or type is wrong.
    #[error("{file}, line {line}, column {column}: {message}")]
    Syntax {
        /// File, or name of the bundled scenario.
        file: String,
        /// Line from 1.
        line: usize,
        /// Column from 1.
        column: usize,
        /// What is wrong and how to mend it.
        message: String,
    },
    /// A value is outside its admissible range.
    #[error("{place}: {key} = {value} is not admissible; expected {expected}")]
    Range {
        /// File and, where known, line.
        place: String,
        /// Full key.
        key: String,
        /// The value found.
        value: String,
        /// The admissible range with unit, or the condition.
        expected: String,
    },
    /// A key to be set that there is not.
    #[error(
        "{place}: there is no key {key}{hint} Expected is a numeric key of --print-scenario with its table"
    )]
    UnknownKey {
        /// File and, where known, line.
        place: String,
        /// The key.
        key: String,
        /// The nearest one, as a question; or a full stop.
        hint: String,
    },
    /// A recording is not usable as a whole.
    #[error("recording {file}: {message}")]
    Recording {
        /// The file.
        file: PathBuf,
        /// What is wrong and how to mend it.
        message: String,
    },
    /// One cell of a recording is wrong.
    #[error("recording {file}, line {line}, column '{column}': {message}")]
    Cell {
        /// The file.
        file: PathBuf,
        /// Line from 1; the header is line 1.
        line: u64,
        /// Name of the column.
        column: String,
        /// What is wrong and what is expected.
        message: String,
    },
}
