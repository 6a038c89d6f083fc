//! The line table: which addresses belong to which source line.

use gimli::{AttributeValue, Dwarf, Error, Unit, UnitRef};

use super::Reader;

/// A piece of code that one source line gave rise to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Byte address of its first instruction.
    pub start: u32,
    /// Byte address behind its last instruction.
    pub end: u32,
    /// Number of the source file.
    pub file: usize,
    /// Line from 1.
    pub line: u32,
}

/// All rows of a program.
#[derive(Debug, Default)]
pub(super) struct Lines {
    pub(super) rows: Vec<Row>,
    pub(super) files: Vec<String>,
}

impl Lines {
    /// Reads all line programs, and the first error among them. What lies at address 0 is dropped
    /// if the program has its vectors there: it is what the linker left of removed functions.
    pub(super) fn read(dwarf: &Dwarf<Reader>, has_vectors: bool) -> (Lines, Option<Error>) {
        let mut lines = Lines::default();
        let mut damage = None;
        let mut headers = dwarf.units();
        loop {
            match headers.next() {
                Ok(Some(header)) => {
                    let read = dwarf
                        .unit(header)
                        .and_then(|unit| lines.add_unit(dwarf, &unit, has_vectors));
                    damage = damage.or(read.err());
                }
                Ok(None) => break,
                Err(error) => {
                    damage = damage.or(Some(error));
                    break;
                }
            }
        }
        lines.order();
        (lines, damage)
    }

    fn add_unit(
        &mut self,
        dwarf: &Dwarf<Reader>,
        unit: &Unit<Reader>,
        has_vectors: bool,
    ) -> Result<(), Error> {
        let Some(program) = unit.line_program.clone() else {
            return Ok(());
        };
        let unit = UnitRef::new(dwarf, unit);
        let mut known: Vec<(u64, usize)> = Vec::new();
        let mut rows = program.rows();
        // The rows of one sequence, each of which ends where the next begins.
        let mut sequence: Vec<(u32, u64, u32)> = Vec::new();
        while let Some((header, row)) = rows.next_row()? {
            let address = u32::try_from(row.address()).unwrap_or(u32::MAX);
            if !row.end_sequence() {
                let line = row.line().map_or(0, |line| line.get());
                let line = u32::try_from(line).unwrap_or(0);
                sequence.push((address, row.file_index(), line));
                continue;
            }
            let is_left_over = has_vectors && sequence.first().is_some_and(|first| first.0 == 0);
            let ends = sequence.iter().skip(1).map(|next| next.0).chain([address]);
            for (&(start, file, line), end) in sequence.iter().zip(ends) {
                if is_left_over || line == 0 || start >= end {
                    continue;
                }
                let number = match known.iter().find(|(index, _)| *index == file) {
                    Some(&(_, number)) => number,
                    None => {
                        let number = self.number(path(unit, header, file)?);
                        known.push((file, number));
                        number
                    }
                };
                self.rows.push(Row {
                    start,
                    end,
                    file: number,
                    line,
                });
            }
            sequence.clear();
        }
        Ok(())
    }

    /// The number of a file.
    fn number(&mut self, path: String) -> usize {
        let found = self.files.iter().position(|known| *known == path);
        found.unwrap_or_else(|| {
            self.files.push(path);
            self.files.len() - 1
        })
    }

    /// Sorts the rows and cuts those that a later one overlaps.
    fn order(&mut self) {
        self.rows.sort_by_key(|row| (row.start, row.end));
        for index in 1..self.rows.len() {
            let start = self.rows[index].start;
            let before = &mut self.rows[index - 1];
            before.end = before.end.min(start);
        }
        self.rows.retain(|row| row.start < row.end);
    }

    /// The row of a byte address.
    pub(super) fn at(&self, address: u32) -> Option<&Row> {
        let after = self.rows.partition_point(|row| row.start <= address);
        let row = self.rows.get(after.checked_sub(1)?)?;
        (address < row.end).then_some(row)
    }
}

/// The path of a file: folder of the compilation, folder of the file, name.
fn path(
    unit: UnitRef<'_, Reader>,
    header: &gimli::LineProgramHeader<Reader>,
    index: u64,
) -> Result<String, Error> {
    let Some(file) = header.file(index) else {
        return Ok("?".to_owned());
    };
    let text = |value: AttributeValue<Reader>| -> Result<String, Error> {
        let bytes = unit.attr_string(value)?;
        Ok(String::from_utf8_lossy(bytes.bytes()).into_owned())
    };
    let mut path = std::path::PathBuf::new();
    if let Some(folder) = &unit.comp_dir {
        path.push(String::from_utf8_lossy(folder.bytes()).as_ref());
    }
    if file.directory_index() != 0
        && let Some(folder) = file.directory(header)
    {
        path.push(text(folder)?);
    }
    path.push(text(file.path_name())?);
    Ok(normal(&path))
}

/// Without `.` and, where a folder goes before them, `..`.
fn normal(path: &std::path::Path) -> String {
    use std::path::Component;
    let mut parts: Vec<Component<'_>> = Vec::new();
    for part in path.components() {
        match (part, parts.last()) {
            (Component::CurDir, _) => {}
            (Component::ParentDir, Some(Component::Normal(_))) => drop(parts.pop()),
            _ => parts.push(part),
        }
    }
    let path: std::path::PathBuf = parts.iter().collect();
    path.to_string_lossy().into_owned()
}
