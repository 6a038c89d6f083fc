//! Reads recordings: tables of text with a header, columns by name with their units, every fault with
//! its place. What is understood beside the contract's CSV: `docs/recordings.md`.

use std::path::Path;

use crate::error::Error;
use crate::recording_columns::{Column, Columns};
use crate::recording_table::Table;
use crate::rotation::{self, Quaternion};
use crate::scenario::RecordingChoice;

/// Fewest usable rows.
const LEAST_ROWS: usize = 4;

/// Most rows; more would not fit the memory of most machines.
const MOST_ROWS: usize = 10_000_000;

/// Larger magnitudes are taken for faults (m/s^2, microtesla, seconds).
const LARGEST: f64 = 1e6;

/// How far the length of a reference quaternion may be from one.
const UNIT_MARGIN: f64 = 0.01;

/// Times beyond this that tell no unit are counted from 1970, in the unit that their size tells:
/// seconds, milliseconds, microseconds, nanoseconds.
const EPOCH: [(f64, f64); 4] = [(1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3), (1e8, 1.0)];

/// Key that lets a slower magnetometer be interpolated.
const INTERPOLATE: &str = "--set motion.recording.interpolate_mag=true";

/// One sample in the recording's own sensor axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Seconds after the first row.
    pub t_s: f64,
    /// Specific force in m/s^2.
    pub force_m_s2: [f64; 3],
    /// Flux density in microtesla.
    pub field_ut: [f64; 3],
    /// Orientation of the sensor axes in east-north-up, where known.
    pub reference: Option<Quaternion>,
    /// Line of the file, from 1.
    pub line: u64,
}

/// A row whose magnetometer may have had nothing new.
struct Found {
    row: Row,
    has_field: bool,
}

/// Reads all rows of `file`; `choice` says whether a slower magnetometer is interpolated.
///
/// # Errors
/// Unreadable or truncated file, missing column, a cell that is not a finite number, time that does
/// not increase, an incomplete or unnormalised reference quaternion, too few or too many rows.
pub fn read(file: &Path, choice: &RecordingChoice) -> Result<Vec<Row>, Error> {
    let mut table = Table::open(file)?;
    let mut rows: Vec<Found> = Vec::new();
    let mut clock = Clock::new(&table.columns.time);
    while let Some(cells) = table.next()? {
        let found = cells.row(&mut clock, choice.interpolate_mag)?;
        if let Some(before) = rows.last()
            && found.row.t_s <= before.row.t_s
        {
            let message = format!(
                "time must increase, but {} follows {}",
                cells.shown(&cells.columns.time),
                clock.before
            );
            return Err(cells.error(&cells.columns.time, message));
        }
        clock.before = cells.shown(&cells.columns.time).to_owned();
        rows.push(found);
        if rows.len() > MOST_ROWS {
            return Err(whole(
                file,
                format!("has more than {MOST_ROWS} rows; cut it into pieces"),
            ));
        }
    }
    let rows = interpolated(rows);
    if rows.len() < LEAST_ROWS {
        let found = rows.len();
        return Err(whole(
            file,
            format!("has {found} rows of data; expected at least {LEAST_ROWS}"),
        ));
    }
    Ok(rows)
}

pub(crate) fn whole(file: &Path, message: String) -> Error {
    Error::Recording {
        file: file.into(),
        message,
    }
}

/// Fills in the field between the rows that have one, by straight lines; what lies before the first
/// and after the last of them goes.
fn interpolated(found: Vec<Found>) -> Vec<Row> {
    let known: Vec<usize> = (0..found.len()).filter(|&at| found[at].has_field).collect();
    let mut rows: Vec<Row> = found.into_iter().map(|found| found.row).collect();
    let (Some(&first), Some(&last)) = (known.first(), known.last()) else {
        return Vec::new();
    };
    for pair in known.windows(2) {
        let (from, to) = (rows[pair[0]].clone(), rows[pair[1]].clone());
        for row in &mut rows[pair[0] + 1..pair[1]] {
            let share = (row.t_s - from.t_s) / (to.t_s - from.t_s);
            row.field_ut = std::array::from_fn(|axis| {
                from.field_ut[axis] + share * (to.field_ut[axis] - from.field_ut[axis])
            });
        }
    }
    rows.truncate(last + 1);
    rows.drain(..first);
    let start_s = rows[0].t_s;
    rows.iter_mut().for_each(|row| row.t_s -= start_s);
    rows
}

/// Seconds after the first row, from times in any unit.
struct Clock {
    factor: Option<f64>,
    start: Option<(f64, Option<i64>)>,
    /// The last time as it stands in the file.
    before: String,
}

impl Clock {
    fn new(time: &Column) -> Self {
        Self {
            factor: time.factor,
            start: None,
            before: String::new(),
        }
    }

    /// The difference is taken first: the digits of times since 1970 exceed those of an `f64`.
    fn seconds(&mut self, text: &str, value: f64) -> Result<f64, String> {
        let factor = match self.factor {
            Some(factor) => factor,
            None => {
                let epoch = EPOCH.iter().find(|(least, _)| value >= *least);
                let (_, factor) = epoch
                    .ok_or("tells no unit; rename the column t_s, t_ms, t_us or t_ns".to_owned())?;
                *self.factor.insert(*factor)
            }
        };
        let whole = text.parse::<i64>().ok();
        let (start, start_whole) = *self.start.get_or_insert((value, whole));
        let since = match (whole, start_whole) {
            (Some(now), Some(start)) => now.saturating_sub(start) as f64,
            _ => value - start,
        };
        Ok(since * factor)
    }
}

/// One line of the file.
pub(crate) struct Cells<'a> {
    pub(crate) file: &'a Path,
    pub(crate) line: u64,
    /// Cells are not separated by commas, so that one stands for the point.
    pub(crate) has_decimal_comma: bool,
    pub(crate) columns: &'a Columns,
    pub(crate) cells: Vec<&'a str>,
}

impl Cells<'_> {
    /// Surplus cells must be empty: some programs end lines with a separator.
    pub(crate) fn check_width(&self, width: usize) -> Result<(), Error> {
        let found = self.cells.len();
        let surplus = self.cells.get(width..).unwrap_or(&[]);
        if found >= width && surplus.iter().all(|cell| cell.is_empty()) {
            return Ok(());
        }
        let hint = if found + 2 >= 2 * width {
            "; if decimals are written with a comma, separate the cells by semicolons"
        } else {
            ""
        };
        let line = self.line;
        Err(whole(
            self.file,
            format!("line {line}: {found} cells where the header has {width}{hint}"),
        ))
    }

    fn row(&self, clock: &mut Clock, may_lack_field: bool) -> Result<Found, Error> {
        let columns = self.columns;
        let time = &columns.time;
        let value = self.value(time, f64::MAX)?;
        let t_s = clock
            .seconds(self.shown(time), value)
            .map_err(|message| self.error(time, message))?;
        if t_s.abs() > LARGEST {
            let message =
                format!("{t_s} s after the first is out of reason; expected under {LARGEST:e}");
            return Err(self.error(time, message));
        }
        let has_field = columns
            .field
            .iter()
            .any(|column| !self.shown(column).is_empty());
        let field_ut = match has_field || !may_lack_field {
            true => self.vector(&columns.field)?,
            false => [0.0; 3],
        };
        let reference = match &columns.reference {
            Some(columns) => self.reference(columns)?,
            None => None,
        };
        Ok(Found {
            row: Row {
                t_s,
                force_m_s2: self.vector(&columns.force)?,
                field_ut,
                reference,
                line: self.line,
            },
            has_field,
        })
    }

    fn vector(&self, columns: &[Column; 3]) -> Result<[f64; 3], Error> {
        let mut values = [0.0; 3];
        for (value, column) in values.iter_mut().zip(columns) {
            *value = self.value(column, LARGEST)? * column.factor.unwrap_or(1.0);
        }
        Ok(values)
    }

    /// The cell as it stands there.
    fn shown(&self, column: &Column) -> &str {
        self.cells.get(column.index).copied().unwrap_or("")
    }

    fn value(&self, column: &Column, largest: f64) -> Result<f64, Error> {
        let text = self.shown(column);
        let is_comma = self.has_decimal_comma && text.contains(',') && !text.contains('.');
        let parsed = match is_comma {
            true => text.replace(',', ".").parse::<f64>(),
            false => text.parse::<f64>(),
        };
        let message = match parsed {
            Ok(value) if value.abs() <= largest && value.is_finite() => return Ok(value),
            Ok(value) if value.is_finite() => {
                format!("{text} is out of reason; expected under {largest:e}")
            }
            _ if text.is_empty() && self.columns.field.iter().any(|c| c.index == column.index) => {
                format!("is empty; for a slower magnetometer let it be interpolated: {INTERPOLATE}")
            }
            _ if text.is_empty() => "is empty; only ref_* columns may be".to_owned(),
            _ if text.contains(':') => {
                format!("'{text}' is a date; expected a number, such as seconds in a column t_s")
            }
            _ => format!("'{text}' is not a finite number"),
        };
        Err(self.error(column, message))
    }

    /// A quaternion, or none if all four cells are empty.
    fn reference(&self, columns: &[Column; 4]) -> Result<Option<Quaternion>, Error> {
        if columns.iter().all(|column| self.shown(column).is_empty()) {
            return Ok(None);
        }
        let mut q = [0.0; 4];
        for (value, column) in q.iter_mut().zip(columns) {
            if self.shown(column).is_empty() {
                let message = "is empty while other ref_q* cells of the line are not";
                return Err(self.error(column, message.into()));
            }
            *value = self.value(column, LARGEST)?;
        }
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() > UNIT_MARGIN {
            let message = format!("the quaternion has length {length:.4}; expected 1");
            return Err(self.error(&columns[0], message));
        }
        Ok(Some(rotation::normalised(q)))
    }

    fn error(&self, column: &Column, message: String) -> Error {
        Error::Cell {
            file: self.file.into(),
            line: self.line,
            column: column.name.clone(),
            message,
        }
    }
}
