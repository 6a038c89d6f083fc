//! What an interrupted search had evaluated, so that it goes on from there: a file of one JSON line
//! per evaluation, only ever appended to.
//!
//! Each line has a check sum over the search and itself. Wherever a journal was cut, or pieces of
//! journals were put together, the lines that are whole and of this search count; the others are
//! evaluated again.

use std::collections::HashMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::space::Levels;

/// Largest journal that is read, in bytes.
const MOST_BYTES: u64 = 4 << 30;

/// The check sum of lines.
const SUMS: crc::Crc<u64> = crc::Crc::<u64>::new(&crc::CRC_64_XZ);

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
    /// Of search and all of the record.
    sum: u64,
}

impl Record {
    fn new(search: &str, problem: u64, levels: &Levels, values: &[f64]) -> Self {
        let mut record = Self {
            problem,
            levels: levels.clone(),
            values: values.iter().map(|value| value.to_bits()).collect(),
            sum: 0,
        };
        record.sum = record.proper_sum(search);
        record
    }

    fn proper_sum(&self, search: &str) -> u64 {
        let mut digest = SUMS.digest();
        digest.update(search.as_bytes());
        // What can be written as JSON at all is written the same each time.
        let content = serde_json::to_vec(&(self.problem, &self.levels, &self.values));
        let content = content.unwrap_or_default();
        digest.update(&content);
        digest.finalize()
    }
}

const VERSION: u32 = 4;

/// An open journal.
pub(crate) struct Journal {
    file: File,
    search: String,
    /// Its first line is there, wherever.
    has_header: bool,
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
        let refused = |what: &str| JournalError::File {
            file: name.clone(),
            what: what.to_owned(),
        };
        if std::fs::metadata(path).is_ok_and(|there| !there.is_file()) {
            return Err(refused("it is no regular file"));
        }
        let file = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .open(path)
            .map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(refused("another search is writing it; give another file"));
            }
            Err(TryLockError::Error(error)) => return Err(failed(error)),
        }
        let mut bytes = Vec::new();
        let mut bounded = (&file).take(MOST_BYTES + 1);
        bounded.read_to_end(&mut bytes).map_err(failed)?;
        if bytes.len() as u64 > MOST_BYTES {
            return Err(refused("it is larger than 4 GiB"));
        }
        let mut journal = Self {
            file,
            search: search.to_owned(),
            has_header: false,
            known: HashMap::new(),
            on: 0,
            problem: None,
        };
        let header = journal.header();
        if header.as_bytes().starts_with(&bytes) && bytes.len() < header.len() {
            // Empty, or cut off in its first line.
            journal.file.set_len(0).map_err(failed)?;
            journal.write(header.as_bytes());
            return Ok((journal, None));
        }
        let note = journal.read(&bytes, &name)?;
        if bytes.last() != Some(&b'\n') {
            // What follows must begin on a line of its own.
            let whole = bytes.iter().rposition(|&byte| byte == b'\n');
            let whole = whole.map_or(0, |at| at + 1);
            if journal.record(&bytes[whole..]).is_some() {
                journal.write(b"\n");
            } else {
                journal.file.set_len(whole as u64).map_err(failed)?;
            }
        }
        if !journal.has_header {
            let header = journal.header();
            journal.write(header.as_bytes());
        }
        Ok((journal, note))
    }

    /// The first line.
    fn header(&self) -> String {
        let header = Header {
            cardan_journal: VERSION,
            search: self.search.clone(),
        };
        // A number and a text can always be written.
        serde_json::to_string(&header).unwrap_or_default() + "\n"
    }

    /// The record of a line that is whole and of this search.
    fn record(&self, line: &[u8]) -> Option<Record> {
        let record = serde_json::from_slice::<Record>(line).ok()?;
        (record.sum == record.proper_sum(&self.search)).then_some(record)
    }

    /// Takes all lines that are whole and of this search.
    fn read(&mut self, bytes: &[u8], name: &str) -> Result<Option<String>, JournalError> {
        let mut damaged = 0;
        for line in bytes.split(|&byte| byte == b'\n') {
            if line.is_empty() {
                continue;
            }
            if let Ok(header) = serde_json::from_slice::<Header>(line) {
                self.has_header |= header.cardan_journal == VERSION && header.search == self.search;
                continue;
            }
            match self.record(line) {
                Some(record) => {
                    let values = record.values.into_iter().map(f64::from_bits).collect();
                    self.known.insert((record.problem, record.levels), values);
                }
                None => damaged += 1,
            }
        }
        if !self.has_header && self.known.is_empty() {
            return Err(JournalError::Foreign {
                file: name.to_owned(),
            });
        }
        Ok((damaged > 0).then(|| {
            format!(
                "{name}: {damaged} {} damaged, cut off or of another search, evaluated again",
                if damaged == 1 {
                    "record is"
                } else {
                    "records are"
                }
            )
        }))
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
        self.line(&Record::new(&self.search, self.on, levels, values));
    }

    fn line(&mut self, value: &impl Serialize) {
        match serde_json::to_string(value) {
            Ok(text) => self.write(format!("{text}\n").as_bytes()),
            Err(error) => {
                self.problem.get_or_insert(error.to_string());
            }
        }
    }

    fn write(&mut self, bytes: &[u8]) {
        if let Err(error) = self.file.write_all(bytes) {
            self.problem.get_or_insert(error.to_string());
        }
    }

    /// The first failure to write.
    pub(crate) fn problem(&self) -> Option<String> {
        self.problem.clone()
    }
}
