//! The name under which participants meet.

use std::fmt;
use std::str::FromStr;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::error::LinkError;

/// A checked session id: part of every service and node name, so that sessions never meet.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct SessionId(String);

impl SessionId {
    /// Longest id in bytes.
    pub const MAX: usize = 48;

    /// An id that no other session of this machine has: process id and time of day.
    #[must_use]
    pub fn fresh() -> Self {
        // A clock before 1970 leaves the process id, which is unique among the living.
        let since = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        Self(format!("{}-{:x}", std::process::id(), since.as_nanos()))
    }

    /// The id as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// FNV-1a hash of the id, which every header carries.
    pub(crate) fn hash(&self) -> u64 {
        let step = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        self.0.bytes().fold(0xcbf2_9ce4_8422_2325, step)
    }
}

impl FromStr for SessionId {
    type Err = LinkError;

    fn from_str(text: &str) -> Result<Self, LinkError> {
        let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
        if (1..=Self::MAX).contains(&text.len()) && text.bytes().all(is_plain) {
            Ok(Self(text.to_owned()))
        } else {
            Err(LinkError::BadSessionId {
                id: text.to_owned(),
            })
        }
    }
}

impl fmt::Display for SessionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_that_could_leave_their_name_space_are_refused() {
        for bad in ["", "a/b", "a b", "é", "..", &"x".repeat(49)] {
            assert!(bad.parse::<SessionId>().is_err(), "{bad}");
        }
        for good in ["a", "run_1-B", &"x".repeat(48)] {
            assert_eq!(good.parse::<SessionId>().expect("plain").as_str(), good);
        }
    }

    #[test]
    fn fresh_ids_are_valid_and_differ() {
        let (one, two) = (SessionId::fresh(), SessionId::fresh());
        assert_ne!(one, two);
        assert_eq!(one.as_str().parse::<SessionId>().as_ref(), Ok(&one));
    }

    #[test]
    fn the_hash_is_fnv_1a() {
        // Published test vectors of the FNV authors.
        assert_eq!(SessionId("a".into()).hash(), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(SessionId("foobar".into()).hash(), 0x8594_4171_f739_67e8);
    }
}
