//! A recording as a table: its separators, its header, and its lines of cells.

use std::io;
use std::path::Path;

use crate::error::Error;
use crate::recording_columns::Columns;
use crate::recording_file::{Cells, whole};
use crate::recording_lines::Lines;

/// Lines in a row that may be empty or comments.
const MOST_IDLE: u64 = 1_000_000;

/// Lines before the header that may say other things.
const MOST_PREAMBLE: usize = 100;

/// What separates cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Between {
    One(char),
    /// Any amount of white space.
    Space,
}

impl Between {
    /// What separates the cells of a header.
    fn of(header: &str) -> Self {
        for one in [';', '\t', ','] {
            if header.contains(one) {
                return Self::One(one);
            }
        }
        Self::Space
    }

    /// The cells of a line, without quotation marks.
    fn split<'a>(self, line: &'a str, cells: &mut Vec<&'a str>) {
        cells.clear();
        let Self::One(one) = self else {
            cells.extend(line.split_whitespace());
            return;
        };
        let mut rest = line;
        loop {
            let inner = rest.trim_start_matches([' ', '\u{a0}']);
            let quoted = inner
                .strip_prefix('"')
                .and_then(|text| text.split_once('"'));
            let (cell, after) = quoted.unwrap_or(("", rest));
            match after.find(one) {
                Some(at) => {
                    cells.push(if quoted.is_some() {
                        cell
                    } else {
                        after[..at].trim()
                    });
                    rest = &after[at + one.len_utf8()..];
                }
                None => {
                    cells.push(if quoted.is_some() { cell } else { after.trim() });
                    return;
                }
            }
        }
    }

    fn owned(self, line: &str) -> Vec<String> {
        let mut cells = Vec::new();
        self.split(line, &mut cells);
        cells.into_iter().map(str::to_owned).collect()
    }
}

/// A recording being read, behind its header.
pub(crate) struct Table<'a> {
    file: &'a Path,
    lines: Lines,
    between: Between,
    pub(crate) columns: Columns,
    /// Cells of the header.
    width: usize,
    line: String,
    /// The line after the header, if it was looked at already.
    ahead: Option<String>,
}

impl<'a> Table<'a> {
    pub(crate) fn open(file: &'a Path) -> Result<Self, Error> {
        let lines = Lines::open(file).map_err(|reason| match reason.kind() {
            io::ErrorKind::UnexpectedEof => read_error(file, &reason),
            _ => Error::Unreadable {
                path: file.into(),
                reason,
            },
        })?;
        let mut table = Self {
            file,
            lines,
            between: Between::Space,
            columns: Columns::none(),
            width: 0,
            line: String::new(),
            ahead: None,
        };
        table.header()?;
        Ok(table)
    }

    fn text(&mut self) -> Result<Option<String>, Error> {
        let next = self.lines.next();
        next.map_err(|error| read_error(self.file, &error))
    }

    /// Finds the header: the first line whose columns are all there, before the first numbers.
    fn header(&mut self) -> Result<(), Error> {
        let mut best: Option<(usize, u64, String)> = None;
        let mut separator = None;
        for _ in 0..MOST_PREAMBLE {
            let Some(line) = self.text()? else { break };
            let (bare, is_comment) = uncommented(&line);
            if bare.is_empty() {
                continue;
            }
            if let Some(stated) = bare
                .strip_prefix("sep=")
                .and_then(|rest| rest.chars().next())
            {
                separator = Some(Between::One(stated));
                continue;
            }
            let between = separator.unwrap_or_else(|| Between::of(bare));
            let header = between.owned(bare);
            if !is_comment && header.iter().all(|cell| cell.parse::<f64>().is_ok()) {
                let message = format!(
                    "line {}: numbers where the header row was expected; add one with the columns' \
                     names, such as t_s, acc_x_m_s2, mag_x_uT",
                    self.lines.number
                );
                let told = best.map(|(_, line, message)| format!("line {line}: {message}"));
                return Err(whole(self.file, told.unwrap_or(message)));
            }
            (self.between, self.width) = (between, header.len());
            let number = self.lines.number;
            match self.columns_of(&header)? {
                Ok(columns) => {
                    self.columns = columns;
                    return Ok(());
                }
                Err(message) => {
                    let recognised = Columns::recognised(&header);
                    let is_better = best.as_ref().is_none_or(|(most, ..)| recognised > *most);
                    if is_better && (!is_comment || recognised > 0) {
                        best = Some((recognised, number, message));
                    }
                    // The line after it was looked at for units.
                    if recognised > 3 {
                        break;
                    }
                }
            }
        }
        Err(whole(
            self.file,
            match best {
                Some((_, line, message)) => format!("line {line}: {message}"),
                None => "is empty; expected a header row and samples".to_owned(),
            },
        ))
    }

    /// The columns of a header. Names without units may have them in the next line.
    fn columns_of(&mut self, header: &[String]) -> Result<Result<Columns, String>, Error> {
        let first = Columns::find(header, None);
        if Columns::recognised(header) < 4 {
            return Ok(first);
        }
        let Some(line) = self.text()? else {
            return Ok(first);
        };
        let units = self.between.owned(uncommented(&line).0);
        let is_words = units.len() == header.len()
            && units.iter().any(|cell| !cell.is_empty())
            && !units
                .iter()
                .any(|cell| cell.starts_with(|c: char| c.is_ascii_digit() || c == '-'));
        if !is_words || units.iter().any(|cell| cell.parse::<f64>().is_ok()) {
            self.ahead = Some(line);
            return Ok(first);
        }
        Ok(Columns::find(header, Some(&units)))
    }

    /// The next line with numbers.
    pub(crate) fn next(&mut self) -> Result<Option<Cells<'_>>, Error> {
        let mut idle = 0;
        loop {
            let line = match self.ahead.take() {
                Some(line) => line,
                None => match self.text()? {
                    Some(line) => line,
                    None => return Ok(None),
                },
            };
            let (bare, is_comment) = uncommented(&line);
            if !is_comment && !bare.is_empty() {
                self.line = line;
                break;
            }
            idle += 1;
            if idle > MOST_IDLE {
                let message = format!(
                    "line {}: more than {MOST_IDLE} lines without a sample; expected a table",
                    self.lines.number
                );
                return Err(whole(self.file, message));
            }
        }
        let mut cells = Vec::new();
        self.between.split(&self.line, &mut cells);
        let cells = Cells {
            file: self.file,
            line: self.lines.number,
            has_decimal_comma: self.between != Between::One(','),
            columns: &self.columns,
            cells,
        };
        cells.check_width(self.width)?;
        Ok(Some(cells))
    }
}

/// A line without the sign of a comment, and whether it had one.
fn uncommented(line: &str) -> (&str, bool) {
    let bare = line.trim();
    for sign in ["#", "%", "//", "\"#"] {
        if let Some(rest) = bare.strip_prefix(sign) {
            return (rest.trim_matches(['"', ' ', '\t', '#']), true);
        }
    }
    (bare, false)
}

fn read_error(file: &Path, error: &io::Error) -> Error {
    let message = if error.kind() == io::ErrorKind::UnexpectedEof {
        "the compressed file ends early: it is truncated, fetch it again".to_owned()
    } else {
        format!("cannot be read on: {error}")
    };
    whole(file, message)
}
