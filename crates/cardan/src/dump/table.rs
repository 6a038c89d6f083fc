//! A table, as CSV and as a structured NumPy array.

use std::fmt::Write as _;

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

/// Rows of as many cells as there are columns.
#[derive(Debug, Default)]
pub(super) struct Table {
    columns: Vec<(String, Kind)>,
    pub(super) rows: Vec<Vec<Cell>>,
}

/// First bytes of a `.npy` file: magic and version 1.0 (NumPy, `numpy.lib.format`).
const MAGIC: &[u8; 8] = b"\x93NUMPY\x01\x00";
/// The same, version 2.0: the header's length takes four bytes instead of two.
const MAGIC_2: &[u8; 8] = b"\x93NUMPY\x02\x00";
/// The data begin at a multiple of this.
const ALIGNMENT: usize = 64;

impl Table {
    /// Adds a column on the right.
    pub(super) fn column(&mut self, name: &str, kind: Kind) {
        self.columns.push((name.to_owned(), kind));
    }

    /// Number of columns.
    pub(super) fn width(&self) -> usize {
        self.columns.len()
    }

    /// Comma separated, with a header row. What is empty or not finite is an empty cell.
    pub(super) fn csv(&self) -> Vec<u8> {
        let names: Vec<&str> = self.columns.iter().map(|(name, _)| name.as_str()).collect();
        let mut text = names.join(",");
        text.push('\n');
        for row in &self.rows {
            for (index, cell) in row.iter().enumerate() {
                if index > 0 {
                    text.push(',');
                }
                // Writing to a string cannot fail.
                let _ = match *cell {
                    Cell::Whole(value) => write!(text, "{value}"),
                    Cell::Real(value) if value.is_finite() => write!(text, "{value}"),
                    Cell::Real(_) => Ok(()),
                };
            }
            text.push('\n');
        }
        text.into_bytes()
    }

    /// A one-dimensional structured array, a field per column: whole numbers as unsigned 64 bits,
    /// others as floats of 64 bits, NaN where a cell is empty; little-endian.
    pub(super) fn npy(&self) -> Vec<u8> {
        let mut fields = String::new();
        for (name, kind) in &self.columns {
            let kind = match kind {
                Kind::Whole => "<u8",
                Kind::Real => "<f8",
            };
            let _ = write!(fields, "('{name}', '{kind}'), ");
        }
        let rows = self.rows.len();
        let dictionary =
            format!("{{'descr': [{fields}], 'fortran_order': False, 'shape': ({rows},), }}");
        let mut bytes = header(&dictionary);
        bytes.reserve(rows * self.width() * 8);
        for cell in self.rows.iter().flatten() {
            bytes.extend(match *cell {
                Cell::Whole(value) => value.to_le_bytes(),
                Cell::Real(value) => value.to_le_bytes(),
            });
        }
        bytes
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
