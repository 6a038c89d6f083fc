//! A table, as CSV and as a structured NumPy array. Its rows wait in a file without a name, which is gone when
//! this process is; so they take no memory, and nothing is left of a run that does not end.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Seek as _, SeekFrom, Write as _};
use std::path::Path;

use super::Format;
use crate::files::Whole;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A whole number in every row.
    Whole,
    /// Real numbers; a cell may be empty.
    Real,
}

/// A cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cell {
    Whole(u64),
    /// NaN where the cell is empty.
    Real(f64),
}

impl Cell {
    /// A real number; empty where there is none.
    pub(super) fn real(value: Option<f64>) -> Self {
        Self::Real(value.unwrap_or(f64::NAN))
    }

    /// Nothing.
    pub(super) const EMPTY: Self = Self::Real(f64::NAN);
}

/// Columns of a table.
pub(super) type Columns = Vec<(String, Kind)>;

/// Rows of as many cells as there are columns.
#[derive(Debug)]
pub(super) struct Table {
    columns: Columns,
    format: Format,
    rows: BufWriter<File>,
    count: u64,
}

/// First bytes of a `.npy` file: magic and version 1.0 (NumPy, `numpy.lib.format`).
const MAGIC: &[u8; 8] = b"\x93NUMPY\x01\x00";
/// The same, version 2.0: the header's length takes four bytes instead of two.
const MAGIC_2: &[u8; 8] = b"\x93NUMPY\x02\x00";
/// The data begin at a multiple of this.
const ALIGNMENT: usize = 64;

impl Table {
    /// A table without rows, which is to become `file`.
    pub(super) fn begin(file: &Path, format: Format, columns: Columns) -> io::Result<Self> {
        let folder = Whole::folder_of(file);
        let rows = match folder {
            Some(folder) => tempfile::tempfile_in(folder)?,
            None => tempfile::tempfile()?,
        };
        Ok(Self {
            columns,
            format,
            rows: BufWriter::new(rows),
            count: 0,
        })
    }

    /// Number of columns.
    pub(super) fn width(&self) -> usize {
        self.columns.len()
    }

    /// Adds a row. What is empty or not finite is an empty cell in text.
    pub(super) fn row(&mut self, cells: &[Cell]) -> io::Result<()> {
        self.count += 1;
        if self.format == Format::Npy {
            for cell in cells {
                let bytes = match *cell {
                    Cell::Whole(value) => value.to_le_bytes(),
                    Cell::Real(value) => value.to_le_bytes(),
                };
                self.rows.write_all(&bytes)?;
            }
            return Ok(());
        }
        for (index, cell) in cells.iter().enumerate() {
            if index > 0 {
                self.rows.write_all(b",")?;
            }
            match *cell {
                Cell::Whole(value) => write!(self.rows, "{value}")?,
                Cell::Real(value) if value.is_finite() => write!(self.rows, "{value}")?,
                Cell::Real(_) => {}
            }
        }
        self.rows.write_all(b"\n")
    }

    /// Puts the table in its place.
    pub(super) fn finish(self, file: &Path) -> io::Result<()> {
        let head = self.head();
        let mut rows = self
            .rows
            .into_inner()
            .map_err(io::IntoInnerError::into_error)?;
        rows.seek(SeekFrom::Start(0))?;
        let mut whole = Whole::create(file)?;
        whole.write_all(&head)?;
        io::copy(&mut BufReader::new(rows), &mut whole)?;
        whole.commit()
    }

    /// What stands before the rows: names separated by commas; or of a one-dimensional structured array a field
    /// per column, whole numbers as unsigned 64 bits, others as floats of 64 bits, NaN where a cell is empty,
    /// little-endian.
    fn head(&self) -> Vec<u8> {
        if self.format == Format::Csv {
            let names: Vec<&str> = self.columns.iter().map(|(name, _)| name.as_str()).collect();
            return (names.join(",") + "\n").into_bytes();
        }
        let fields = self.columns.iter().map(|(name, kind)| {
            let kind = match kind {
                Kind::Whole => "<u8",
                Kind::Real => "<f8",
            };
            format!("('{name}', '{kind}'), ")
        });
        let fields: String = fields.collect();
        let rows = self.count;
        let dictionary =
            format!("{{'descr': [{fields}], 'fortran_order': False, 'shape': ({rows},), }}");
        header(&dictionary)
    }
}

/// Magic, length, and the dictionary filled up with spaces and a line end.
fn header(dictionary: &str) -> Vec<u8> {
    let padded =
        |before: usize| (before + dictionary.len() + 1).next_multiple_of(ALIGNMENT) - before;
    let short = padded(MAGIC.len() + 2);
    let (mut bytes, len) = match u16::try_from(short) {
        Ok(len) => ([&MAGIC[..], &len.to_le_bytes()].concat(), short),
        Err(_) => {
            let len = padded(MAGIC_2.len() + 4);
            // Four bytes hold the names of 30 million columns.
            ([&MAGIC_2[..], &(len as u32).to_le_bytes()].concat(), len)
        }
    };
    let start = bytes.len();
    bytes.extend(dictionary.as_bytes());
    bytes.resize(start + len - 1, b' ');
    bytes.push(b'\n');
    bytes
}
