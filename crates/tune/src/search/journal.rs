//! What an interrupted search had evaluated, so that it goes on from there: a file of one JSON line
//! per evaluation, only ever appended to.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::space::Levels;

/// Why a journal was refused; nothing was written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum JournalError {
    /// It cannot be opened.
    #[error("{file}: cannot be used as a journal: {what}")]
    File {
        /// The file.
        file: String,
        /// Why.
        what: String,
    },
    /// It belongs to something else.
    #[error(
        "{file}: is the journal of another search (other budget, scenario, options or program); give another file, or remove this one"
    )]
    Foreign {
        /// The file.
        file: String,
    },
    /// A record in the middle is damaged.
    #[error("{file}, line {line}: damaged record: {what}; remove the file to start again")]
    Damaged {
        /// The file.
        file: String,
        /// Line number from 1.
        line: usize,
        /// What is wrong.
        what: String,
    },
}

#[derive(Serialize, Deserialize)]
struct Header {
    cardan_journal: u32,
    search: String,
}

/// Values as bits: exactly what they were, infinities included.
#[derive(Serialize, Deserialize)]
struct Record {
    /// How often the search had begun again on other runs.
    problem: u64,
    levels: Levels,
    values: Vec<u64>,
}

const VERSION: u32 = 3;

/// An open journal.
pub(crate) struct Journal {
    file: File,
    known: HashMap<(u64, Levels), Vec<f64>>,
    on: u64,
    problem: Option<String>,
}

impl Journal {
    /// Opens or begins the journal of the search that `search` describes. The note tells of a record
    /// that was cut off.
    pub(crate) fn open(path: &Path, search: &str) -> Result<(Self, Option<String>), JournalError> {
        let name = path.display().to_string();
        let failed = |error: std::io::Error| JournalError::File {
            file: name.clone(),
            what: error.to_string(),
        };
        let mut file = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .open(path)
            .map_err(failed)?;
        let mut text = String::new();
        file.read_to_string(&mut text).map_err(failed)?;
        let mut journal = Self {
            file,
            known: HashMap::new(),
            on: 0,
            problem: None,
        };
        if text.is_empty() {
            let header = Header {
                cardan_journal: VERSION,
                search: search.to_owned(),
            };
            journal.line(&header);
            return Ok((journal, None));
        }
        let note = journal.read(&text, search, &name)?;
        if note.is_some() {
            // What follows must begin on a line of its own.
            let whole = text.rfind('\n').map_or(0, |at| at + 1);
            journal.file.set_len(whole as u64).map_err(failed)?;
        }
        Ok((journal, note))
    }

    fn read(
        &mut self,
        text: &str,
        search: &str,
        name: &str,
    ) -> Result<Option<String>, JournalError> {
        let mut lines = text.split_inclusive('\n').enumerate();
        let header = lines.next().map_or("", |(_, line)| line);
        let is_own = serde_json::from_str::<Header>(header)
            .is_ok_and(|header| header.cardan_journal == VERSION && header.search == search);
        if !is_own {
            return Err(JournalError::Foreign {
                file: name.to_owned(),
            });
        }
        for (at, line) in lines {
            if !line.ends_with('\n') {
                return Ok(Some(format!(
                    "{name}: the last record was cut off; it is evaluated again"
                )));
            }
            let record: Record =
                serde_json::from_str(line).map_err(|error| JournalError::Damaged {
                    file: name.to_owned(),
                    line: at + 1,
                    what: error.to_string(),
                })?;
            let values = record.values.into_iter().map(f64::from_bits).collect();
            self.known.insert((record.problem, record.levels), values);
        }
        Ok(None)
    }

    /// The values of a choice that the interrupted search evaluated.
    pub(crate) fn take(&mut self, levels: &Levels) -> Option<Vec<f64>> {
        self.known.remove(&(self.on, levels.clone()))
    }

    /// What follows is evaluated on other runs.
    pub(crate) const fn next_problem(&mut self) {
        self.on += 1;
    }

    /// Adds an evaluation.
    pub(crate) fn append(&mut self, levels: &Levels, values: &[f64]) {
        let record = Record {
            problem: self.on,
            levels: levels.clone(),
            values: values.iter().map(|value| value.to_bits()).collect(),
        };
        self.line(&record);
    }

    fn line(&mut self, value: &impl Serialize) {
        let written = serde_json::to_string(value)
            .map_err(std::io::Error::from)
            .and_then(|text| self.file.write_all(format!("{text}\n").as_bytes()));
        if let Err(error) = written {
            self.problem.get_or_insert(error.to_string());
        }
    }

    /// The first failure to write.
    pub(crate) fn problem(&self) -> Option<String> {
        self.problem.clone()
    }
}
