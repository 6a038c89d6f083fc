//! EEPROM content in files: Intel HEX (`.hex`, `.eep`, as `avrdude -U eeprom:w:FILE:i` takes it) or raw
//! bytes (`.bin`), by the file's extension.

use std::path::Path;

use cardan_bench::image::EepromImage;
use ihex::{Reader, Record};

use crate::failure::Failure;
use crate::files::{self, write_whole};

/// Bytes of the largest EEPROM of the family.
const MOST: usize = 4096;

/// What names the file to be written.
const OPTION: &str = "--out";

/// Data bytes per record, as objcopy writes them.
const PER_RECORD: usize = 16;

#[derive(Clone, Copy)]
enum Form {
    Hex,
    Raw,
}

/// Form by the extension.
fn form(file: &Path) -> Result<Form, Failure> {
    let extension = file
        .extension()
        .map(|text| text.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("hex" | "eep") => Ok(Form::Hex),
        Some("bin") => Ok(Form::Raw),
        _ => Err(Failure::input(format!(
            "{}: its form is not known; expected a name in .hex or .eep (Intel HEX) or in .bin (raw \
             bytes)",
            file.display()
        ))),
    }
}

/// Refuses a file name whose form is not known, before anything runs.
pub(crate) fn check_name(file: &Path) -> Result<(), Failure> {
    form(file).map(drop)
}

/// Name of the form in messages.
pub(crate) fn form_name(file: &Path) -> &'static str {
    match form(file) {
        Ok(Form::Raw) => "raw bytes",
        _ => "Intel HEX",
    }
}

/// Writes the content of an EEPROM from address 0.
pub(crate) fn write(file: &Path, bytes: &[u8]) -> Result<(), Failure> {
    match form(file)? {
        Form::Raw => write_whole(OPTION, file, bytes),
        Form::Hex => write_whole(OPTION, file, hex(file, bytes)?),
    }
}

fn hex(file: &Path, bytes: &[u8]) -> Result<String, Failure> {
    let data = bytes.chunks(PER_RECORD).zip((0_u16..).step_by(PER_RECORD));
    let mut records: Vec<Record> = data
        .map(|(chunk, offset)| Record::Data {
            offset,
            value: chunk.to_vec(),
        })
        .collect();
    records.push(Record::EndOfFile);
    ihex::create_object_file_representation(&records)
        .map(|text| text + "\n")
        .map_err(|error| Failure::input(format!("{}: {error}", file.display())))
}

/// Reads the content of an EEPROM from address 0; gaps are erased bytes.
pub(crate) fn read(file: &Path) -> Result<EepromImage, Failure> {
    let form = form(file)?;
    let name = file.display().to_string();
    let bytes = files::read(file)?;
    let bytes = match form {
        Form::Raw => bytes,
        Form::Hex => {
            parse(&bytes).map_err(|problem| Failure::input(format!("{name}: {problem}")))?
        }
    };
    if bytes.len() > MOST {
        let found = bytes.len();
        return Err(Failure::input(format!(
            "{name}: {found} bytes; no EEPROM of the family has more than {MOST}"
        )));
    }
    Ok(EepromImage { name, bytes })
}

fn parse(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let text = std::str::from_utf8(bytes)
        .map_err(|_| "no Intel HEX: it is not text; raw bytes have names in .bin".to_owned())?;
    let mut content = Vec::new();
    let mut ended = false;
    for (index, record) in Reader::new(text).enumerate() {
        let place = format!("record {}", index + 1);
        match record.map_err(|error| format!("{place} is no Intel HEX: {error}"))? {
            Record::Data { offset, value } => {
                let end = usize::from(offset) + value.len();
                if end > MOST {
                    return Err(format!(
                        "{place} reaches address {end}; no EEPROM of the family has more than {MOST} bytes"
                    ));
                }
                if content.len() < end {
                    content.resize(end, 0xff);
                }
                content[usize::from(offset)..end].copy_from_slice(&value);
            }
            Record::EndOfFile => ended = true,
            other => {
                return Err(format!(
                    "{place} is of type {}; an EEPROM needs data records only",
                    other.record_type()
                ));
            }
        }
    }
    if ended {
        Ok(content)
    } else {
        Err("the end-of-file record is missing: the file was cut short".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read_in_both_forms() {
        let folder = std::env::temp_dir().join(format!("cardan-eeprom-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let bytes: Vec<u8> = (0..66).map(|byte| byte * 3).collect();
        for name in ["unit.hex", "unit.EEP", "unit.bin"] {
            let file = folder.join(name);
            write(&file, &bytes).unwrap();
            assert_eq!(read(&file).unwrap().bytes, bytes, "{name}");
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn broken_hex_is_refused_with_its_record() {
        let cases: [(&[u8], &str); 5] = [
            (b":0100000001FE\n", "cut short"),
            (b":0100000001FF\n:00000001FF\n", "record 1"),
            (b":01FFFF000100\n:00000001FF\n", "address 65536"),
            (b":020000021000EC\n:00000001FF\n", "type 2"),
            (b"\xff\xfe", "not text"),
        ];
        for (text, named) in cases {
            let problem = parse(text).unwrap_err();
            assert!(problem.contains(named), "{problem}");
        }
    }
}
