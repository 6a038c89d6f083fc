//! Reads recordings: CSV or gzip-compressed CSV, columns by name, every fault with its place.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;

use crate::error::Error;
use crate::rotation::{self, Quaternion};

/// Fewest usable rows.
const LEAST_ROWS: usize = 4;

/// Larger magnitudes are taken for faults (m/s^2, microtesla, seconds).
const LARGEST: f64 = 1e6;

/// How far the length of a reference quaternion may be from one.
const UNIT_MARGIN: f64 = 0.01;

const REQUIRED: [&str; 7] = [
    "t_s",
    "acc_x_m_s2",
    "acc_y_m_s2",
    "acc_z_m_s2",
    "mag_x_uT",
    "mag_y_uT",
    "mag_z_uT",
];
const REFERENCE: [&str; 4] = ["ref_qw", "ref_qx", "ref_qy", "ref_qz"];

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
}

/// Reads all rows of `file`.
///
/// # Errors
/// Unreadable or truncated file, missing column, a cell that is not a finite number, time that does
/// not increase, an incomplete or unnormalised reference quaternion, too few rows.
pub fn read(file: &Path) -> Result<Vec<Row>, Error> {
    let whole = |message: String| Error::Recording {
        file: file.into(),
        message,
    };
    let mut reader = csv::Reader::from_reader(open(file)?);
    let header = reader.headers().map_err(|e| csv_error(file, &e))?.clone();
    if header.is_empty() {
        return Err(whole("is empty; expected a header row and samples".into()));
    }
    let columns = Columns::find(file, &header)?;
    let mut rows: Vec<Row> = Vec::new();
    let mut record = csv::StringRecord::new();
    let mut start_s = 0.0;
    while reader
        .read_record(&mut record)
        .map_err(|e| csv_error(file, &e))?
    {
        let cells = Cells {
            file,
            record: &record,
        };
        let mut row = cells.row(&columns)?;
        if rows.is_empty() {
            start_s = row.t_s;
        }
        row.t_s -= start_s;
        if let Some(before) = rows.last()
            && row.t_s <= before.t_s
        {
            let (now, then) = (row.t_s + start_s, before.t_s + start_s);
            let message = format!("time must increase, but {now} s follows {then} s");
            return Err(cells.error("t_s", message));
        }
        rows.push(row);
    }
    if rows.len() < LEAST_ROWS {
        let found = rows.len();
        return Err(whole(format!(
            "has {found} rows of data; expected at least {LEAST_ROWS}"
        )));
    }
    Ok(rows)
}

/// Opens plain or compressed text, told apart by gzip's first two bytes.
fn open(file: &Path) -> Result<Box<dyn Read>, Error> {
    let unreadable = |reason| Error::Unreadable {
        path: file.into(),
        reason,
    };
    let mut source = BufReader::new(File::open(file).map_err(unreadable)?);
    let mut magic = Vec::new();
    source
        .by_ref()
        .take(2)
        .read_to_end(&mut magic)
        .map_err(unreadable)?;
    source.rewind().map_err(unreadable)?;
    if magic == [0x1f, 0x8b] {
        Ok(Box::new(flate2::bufread::MultiGzDecoder::new(source)))
    } else {
        Ok(Box::new(source))
    }
}

fn csv_error(file: &Path, error: &csv::Error) -> Error {
    let line = error
        .position()
        .map_or(String::new(), |at| format!("line {}: ", at.line()));
    let message = match error.kind() {
        csv::ErrorKind::Io(e) if e.kind() == io::ErrorKind::UnexpectedEof => {
            "the compressed file ends early: it is truncated, fetch it again".to_string()
        }
        csv::ErrorKind::Io(e) => format!("cannot be read on: {e}"),
        csv::ErrorKind::UnequalLengths {
            expected_len, len, ..
        } => {
            format!("{line}{len} cells where the header has {expected_len}")
        }
        csv::ErrorKind::Utf8 { err, .. } => format!("{line}is not text: {err}"),
        _ => format!("{line}{error}"),
    };
    Error::Recording {
        file: file.into(),
        message,
    }
}

/// Indices of the columns in the order of [`REQUIRED`] and [`REFERENCE`].
struct Columns {
    required: [usize; REQUIRED.len()],
    reference: Option<[usize; REFERENCE.len()]>,
}

impl Columns {
    fn find(file: &Path, header: &csv::StringRecord) -> Result<Self, Error> {
        let index = |name: &str| header.iter().position(|cell| cell.trim() == name);
        let missing = |name: &str| {
            let found = header.iter().collect::<Vec<_>>().join(", ");
            let message = format!("line 1: column '{name}' is missing; the header has: {found}");
            Error::Recording {
                file: file.into(),
                message,
            }
        };
        let mut required = [0; REQUIRED.len()];
        for (slot, name) in required.iter_mut().zip(REQUIRED) {
            *slot = index(name).ok_or_else(|| missing(name))?;
        }
        let any = REFERENCE.iter().any(|name| index(name).is_some());
        let reference = if any {
            let mut found = [0; REFERENCE.len()];
            for (slot, name) in found.iter_mut().zip(REFERENCE) {
                *slot = index(name).ok_or_else(|| missing(name))?;
            }
            Some(found)
        } else {
            None
        };
        Ok(Self {
            required,
            reference,
        })
    }
}

/// One line of the file.
struct Cells<'a> {
    file: &'a Path,
    record: &'a csv::StringRecord,
}

impl Cells<'_> {
    fn row(&self, columns: &Columns) -> Result<Row, Error> {
        let mut v = [0.0; REQUIRED.len()];
        for ((value, index), name) in v.iter_mut().zip(columns.required).zip(REQUIRED) {
            *value = self.number(index, name)?;
        }
        Ok(Row {
            t_s: v[0],
            force_m_s2: [v[1], v[2], v[3]],
            field_ut: [v[4], v[5], v[6]],
            reference: columns
                .reference
                .map_or(Ok(None), |indices| self.reference(indices))?,
        })
    }

    fn number(&self, index: usize, name: &str) -> Result<f64, Error> {
        let text = self.record[index].trim();
        match text.parse::<f64>() {
            Ok(value) if value.abs() <= LARGEST => Ok(value),
            Ok(value) if value.is_finite() => Err(self.error(
                name,
                format!("{text} is out of reason; expected under {LARGEST:e}"),
            )),
            _ if text.is_empty() => {
                Err(self.error(name, "is empty; only ref_* columns may be".into()))
            }
            _ => Err(self.error(name, format!("'{text}' is not a finite number"))),
        }
    }

    /// A quaternion, or none if all four cells are empty.
    fn reference(&self, indices: [usize; 4]) -> Result<Option<Quaternion>, Error> {
        if indices
            .iter()
            .all(|index| self.record[*index].trim().is_empty())
        {
            return Ok(None);
        }
        let mut q = [0.0; 4];
        for ((value, index), name) in q.iter_mut().zip(indices).zip(REFERENCE) {
            if self.record[index].trim().is_empty() {
                let message = "is empty while other ref_q* cells of the line are not";
                return Err(self.error(name, message.into()));
            }
            *value = self.number(index, name)?;
        }
        let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() > UNIT_MARGIN {
            let message = format!("the quaternion has length {length:.4}; expected 1");
            return Err(self.error(REFERENCE[0], message));
        }
        Ok(Some(rotation::normalised(q)))
    }

    fn error(&self, column: &str, message: String) -> Error {
        let line = self.record.position().map_or(0, csv::Position::line);
        Error::Cell {
            file: self.file.into(),
            line,
            column: column.into(),
            message,
        }
    }
}
