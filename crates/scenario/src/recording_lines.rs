//! The lines of a recording: unpacked, decoded, and never more than a bounded piece of them at once.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Chain, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use encoding_rs::{UTF_16BE, UTF_16LE, WINDOWS_1252};
use encoding_rs_io::DecodeReaderBytesBuilder;
use flate2::CrcReader;
use flate2::bufread::{DeflateDecoder, MultiGzDecoder};
use rawzip::{CompressionMethod, RECOMMENDED_BUFFER_SIZE, ZipArchive};

use crate::source;

/// Longest line in bytes.
const MOST_LINE: usize = 64 * 1024;
/// Bytes by which kind and encoding are told.
const PEEKED: usize = 512;

/// Files of an archive that are looked at.
const MOST_NAMES: usize = 8;

/// What begins files that are no text, and what to do with them.
const FOREIGN: [(&[u8], &str); 9] = [
    (b"\x89HDF", "an HDF5 file; export a table as CSV"),
    (b"MATLAB 5.0", "a MATLAB file; export a table as CSV"),
    (b"PAR1", "a Parquet file; export it as CSV"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook; save it as CSV"),
    (b"\xfd7zXZ", "compressed with xz; unpack it: unxz"),
    (b"BZh", "compressed with bzip2; unpack it: bunzip2"),
    (
        b"\x28\xb5\x2f\xfd",
        "compressed with zstd; unpack it: unzstd",
    ),
    (b"7z\xbc\xaf", "a 7-Zip archive; unpack it"),
    (b"\x7fELF", "a program; expected a table in CSV"),
];

type Peeked<R> = Chain<Cursor<Vec<u8>>, R>;

/// Reads a recording line by line.
pub(crate) struct Lines {
    reader: Box<dyn BufRead>,
    /// Number of the last line read, from 1.
    pub(crate) number: u64,
    /// A line ended with a carriage return, so that a line feed after it ends nothing.
    after_return: bool,
    bytes: Vec<u8>,
}

impl Lines {
    /// Opens a text, plain, in gzip, or alone in a zip archive; UTF-8, UTF-16 or Windows-1252.
    ///
    /// # Errors
    /// The system's; another kind of file, with what to do.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        let mut file = source::open(path)?;
        let mut magic = Vec::new();
        file.by_ref().take(PEEKED as u64).read_to_end(&mut magic)?;
        file.rewind()?;
        let foreign = FOREIGN.iter().find(|(start, _)| magic.starts_with(start));
        if let Some((_, what)) = foreign {
            return Err(io::Error::other(format!("it is {what}")));
        }
        let unpacked: Box<dyn Read> = if magic.starts_with(b"\x1f\x8b") {
            Box::new(MultiGzDecoder::new(BufReader::new(file)))
        } else if magic.starts_with(b"PK\x03\x04") {
            archived(file)?
        } else {
            Box::new(file)
        };
        Ok(Self {
            reader: decoded(unpacked)?,
            number: 0,
            after_return: false,
            bytes: Vec::new(),
        })
    }

    /// The next line without its end; none after the last.
    ///
    /// # Errors
    /// The system's, a damaged archive, a line that is too long.
    pub(crate) fn next(&mut self) -> io::Result<Option<String>> {
        self.bytes.clear();
        if !self.fill()? {
            return Ok(None);
        }
        self.number += 1;
        let text = match std::str::from_utf8(&self.bytes) {
            Ok(text) => text.to_owned(),
            Err(_) => WINDOWS_1252
                .decode_without_bom_handling(&self.bytes)
                .0
                .into_owned(),
        };
        Ok(Some(text))
    }

    /// Collects bytes up to the end of the line; false if there is no line any more.
    fn fill(&mut self) -> io::Result<bool> {
        loop {
            let there = self.reader.fill_buf()?;
            if there.is_empty() {
                return Ok(!self.bytes.is_empty());
            }
            if std::mem::take(&mut self.after_return) && there[0] == b'\n' {
                self.reader.consume(1);
                continue;
            }
            let end = there.iter().position(|byte| matches!(byte, b'\n' | b'\r'));
            let count = end.unwrap_or(there.len());
            if self.bytes.len() + count > MOST_LINE {
                let line = self.number + 1;
                return Err(io::Error::other(format!(
                    "line {line} is longer than {MOST_LINE} bytes; expected a table with one sample \
                     per line"
                )));
            }
            self.bytes.extend_from_slice(&there[..count]);
            self.after_return = end.is_some_and(|at| there[at] == b'\r');
            self.reader.consume(count + usize::from(end.is_some()));
            if end.is_some() {
                return Ok(true);
            }
        }
    }
}

/// The only file of a zip archive.
fn archived(mut file: File) -> io::Result<Box<dyn Read>> {
    let damaged = |error: rawzip::Error| io::Error::other(format!("the zip archive: {error}"));
    let mut buffer = vec![0; RECOMMENDED_BUFFER_SIZE];
    let archive = ZipArchive::from_file(file.try_clone()?, &mut buffer).map_err(damaged)?;
    let mut found = Vec::new();
    let mut entries = archive.entries(&mut buffer);
    while let Some(entry) = entries.next_entry().map_err(damaged)? {
        let name = String::from_utf8_lossy(entry.file_path().as_bytes()).into_owned();
        if name == "[Content_Types].xml" {
            return Err(io::Error::other("it is an Excel workbook; save it as CSV"));
        }
        // What other systems put beside a file is none of ours.
        if !entry.is_dir() && !name.starts_with("__MACOSX/") && found.len() < MOST_NAMES {
            let is_encrypted = entry.flags().is_encrypted();
            let method = entry.compression_method();
            found.push((name, entry.wayfinder(), method, is_encrypted, entry.crc32()));
        }
    }
    let [(name, place, method, is_encrypted, sum)] = &found[..] else {
        let names: Vec<_> = found.iter().map(|(name, ..)| name.as_str()).collect();
        return Err(io::Error::other(format!(
            "the zip archive holds {} files ({}); expected one: unpack the one that is meant",
            names.len(),
            names.join(", ")
        )));
    };
    if *is_encrypted {
        let what = format!("'{name}' in the zip archive is encrypted; unpack it");
        return Err(io::Error::other(what));
    }
    let entry = archive.get_entry(*place).map_err(damaged)?;
    let (start, end) = entry.compressed_data_range();
    file.seek(SeekFrom::Start(start))?;
    let packed = BufReader::new(file.take(end.saturating_sub(start)));
    let unpacked: Box<dyn Read> = match *method {
        CompressionMethod::STORE => Box::new(packed),
        CompressionMethod::DEFLATE => Box::new(DeflateDecoder::new(packed)),
        other => {
            let what = format!("'{name}' in the zip archive is compressed by {other:?}; unpack it");
            return Err(io::Error::other(what));
        }
    };
    Ok(Box::new(Checked {
        reader: CrcReader::new(unpacked),
        sum: *sum,
    }))
}

/// Fails at the end if the check sum is another.
struct Checked {
    reader: CrcReader<Box<dyn Read>>,
    sum: u32,
}

impl Read for Checked {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.reader.read(bytes)?;
        if count == 0 && !bytes.is_empty() && self.reader.crc().sum() != self.sum {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(count)
    }
}

/// The text in UTF-8 (or what is left as it is, and looked at line by line).
fn decoded(mut raw: Box<dyn Read>) -> io::Result<Box<dyn BufRead>> {
    let mut first = Vec::new();
    raw.by_ref().take(PEEKED as u64).read_to_end(&mut first)?;
    let utf16 = match first[..] {
        [0xff, 0xfe, 0, 0, ..] | [0, 0, 0xfe, 0xff, ..] => {
            return Err(io::Error::other("it is text in UTF-32; save it in UTF-8"));
        }
        [0xff, 0xfe, ..] => Some(UTF_16LE),
        [0xfe, 0xff, ..] => Some(UTF_16BE),
        [a, 0, b, 0, ..] if a != 0 && b != 0 => Some(UTF_16LE),
        [0, a, 0, b, ..] if a != 0 && b != 0 => Some(UTF_16BE),
        _ => None,
    };
    if utf16.is_none() && first.contains(&0) && !first.contains(&b'\n') {
        return Err(io::Error::other("it is no text; expected a table in CSV"));
    }
    if first.starts_with(b"\xef\xbb\xbf") {
        first.drain(..3);
    }
    let whole: Peeked<Box<dyn Read>> = Cursor::new(first).chain(raw);
    Ok(match utf16 {
        None => Box::new(BufReader::new(whole)),
        encoding => Box::new(BufReader::new(
            DecodeReaderBytesBuilder::new()
                .encoding(encoding)
                .build(whole),
        )),
    })
}
