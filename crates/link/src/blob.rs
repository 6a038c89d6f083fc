//! Named byte strings of any length over a stream of bytes.
//!
//! Layout of one blob: length of the name (u32 LE), length of the body (u64 LE), name, body.

use crate::error::LinkError;
use crate::handle::{Reader, Writer};
use crate::role::Role;
use crate::stream::Blobs;

/// A named byte string: configuration, calibration, run summary.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Blob {
    /// What it is.
    pub name: String,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

const HEAD: usize = size_of::<u32>() + size_of::<u64>();

/// Longest name and body that a reader accepts: far above what is in use, and low enough that a
/// corrupt length cannot exhaust memory.
const MAX_NAME: usize = 256;
const MAX_BODY: u64 = 1 << 32;

/// Sends blobs to everyone downstream.
pub struct BlobWriter(pub(crate) Writer<Blobs>);

impl BlobWriter {
    /// Sends a blob; returns when the last byte is in the readers' buffers.
    ///
    /// # Errors
    /// Whatever ended the session; [`LinkError::BrokenBlob`] for a name above 256 bytes.
    pub fn send(&mut self, name: &str, bytes: &[u8]) -> Result<(), LinkError> {
        if name.len() > MAX_NAME || bytes.len() as u64 > MAX_BODY {
            return Err(LinkError::BrokenBlob {
                role: self.0.role(),
            });
        }
        self.0.extend(&(name.len() as u32).to_le_bytes())?;
        self.0.extend(&(bytes.len() as u64).to_le_bytes())?;
        self.0.extend(name.as_bytes())?;
        self.0.extend(bytes)?;
        self.0.flush()
    }

    /// Ends the stream of blobs.
    ///
    /// # Errors
    /// Whatever ended the session.
    pub fn finish(self) -> Result<(), LinkError> {
        self.0.finish()
    }
}

/// Receives the blobs of one participant.
pub struct BlobReader {
    reader: Reader<Blobs>,
    pending: Vec<u8>,
}

impl BlobReader {
    pub(crate) fn new(reader: Reader<Blobs>) -> Self {
        Self {
            reader,
            pending: Vec::new(),
        }
    }

    /// Waits for the next blob; `None` after the last one.
    ///
    /// # Errors
    /// Whatever ended the session; [`LinkError::BrokenBlob`] when the stream is malformed.
    #[expect(
        clippy::should_implement_trait,
        reason = "fails for good, which an iterator cannot"
    )]
    pub fn next(&mut self) -> Result<Option<Blob>, LinkError> {
        let role = self.reader.writer();
        loop {
            if let Some((blob, used)) = parse(&self.pending, role)? {
                self.pending.drain(..used);
                return Ok(Some(blob));
            }
            match self.reader.next_batch()? {
                Some(bytes) => self.pending.extend(bytes),
                None if self.pending.is_empty() => return Ok(None),
                None => return Err(LinkError::BrokenBlob { role }),
            }
        }
    }

    /// Waits for the next blob, which must be there and have this name.
    ///
    /// # Errors
    /// Whatever ended the session; [`LinkError::BrokenBlob`] for an end or another name.
    pub fn expect(&mut self, name: &str) -> Result<Vec<u8>, LinkError> {
        match self.next()? {
            Some(blob) if blob.name == name => Ok(blob.bytes),
            _ => Err(LinkError::BrokenBlob {
                role: self.reader.writer(),
            }),
        }
    }
}

/// The first blob in `bytes` and its length there; `None` while it is incomplete.
fn parse(bytes: &[u8], role: Role) -> Result<Option<(Blob, usize)>, LinkError> {
    let broken = || LinkError::BrokenBlob { role };
    let Some((head, rest)) = bytes.split_at_checked(HEAD) else {
        return Ok(None);
    };
    let (name_len, body_len) = head.split_at(size_of::<u32>());
    let name_len = u32::from_le_bytes(name_len.try_into().map_err(|_| broken())?) as usize;
    let body_len = u64::from_le_bytes(body_len.try_into().map_err(|_| broken())?);
    if name_len > MAX_NAME || body_len > MAX_BODY {
        return Err(broken());
    }
    let body_len = usize::try_from(body_len).map_err(|_| broken())?;
    let Some((name, rest)) = rest.split_at_checked(name_len) else {
        return Ok(None);
    };
    let Some(body) = rest.get(..body_len) else {
        return Ok(None);
    };
    let name = String::from_utf8(name.to_vec()).map_err(|_| broken())?;
    Ok(Some((
        Blob {
            name,
            bytes: body.to_vec(),
        },
        HEAD + name_len + body_len,
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framed(name: &str, body: &[u8]) -> Vec<u8> {
        let mut bytes = (name.len() as u32).to_le_bytes().to_vec();
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend(body);
        bytes
    }

    #[test]
    fn a_blob_is_parsed_only_once_its_last_byte_is_there() {
        let mut bytes = framed("scenario", b"x = 1");
        let whole = bytes.len();
        for cut in 0..whole {
            assert_eq!(
                parse(&bytes[..cut], Role::Emulated),
                Ok(None),
                "{cut} bytes"
            );
        }
        bytes.extend(framed("next", b""));
        let blob = Blob {
            name: "scenario".into(),
            bytes: b"x = 1".to_vec(),
        };
        assert_eq!(parse(&bytes, Role::Emulated), Ok(Some((blob, whole))));
        let blob = Blob {
            name: "next".into(),
            bytes: Vec::new(),
        };
        let left = bytes.len() - whole;
        assert_eq!(
            parse(&bytes[whole..], Role::Emulated),
            Ok(Some((blob, left)))
        );
    }

    #[test]
    fn absurd_lengths_and_names_that_are_no_text_are_refused() {
        let broken = Err(LinkError::BrokenBlob { role: Role::Golden });
        assert_eq!(parse(&[0xff; HEAD], Role::Golden), broken);
        let mut bytes = framed("ab", b"");
        bytes[HEAD] = 0xff;
        assert_eq!(parse(&bytes, Role::Golden), broken);
    }
}
