//! The key `sensors.third_tilt`: a word, or true and false as when the comparator was the only way.

use std::fmt;

use cardan_spec::ThirdTilt;
use serde::Deserializer;
use serde::de::Visitor;

use crate::check::range;
use crate::error::Error;

/// Its full key.
pub const KEY: &str = "sensors.third_tilt";

/// What a message expects.
pub const EXPECTED: &str = "measured (2), comparator or true (1), absent or false (0)";

/// The words.
const NAMES: &[&str] = &["measured", "comparator", "absent"];

/// What a word means.
#[must_use]
pub fn named(word: &str) -> Option<ThirdTilt> {
    ThirdTilt::ALL.into_iter().find(|kind| kind.name() == word)
}

/// What a number means, as in the options of the EEPROM image.
pub(crate) fn numbered(value: f64) -> Result<ThirdTilt, Error> {
    let kind = ThirdTilt::ALL
        .into_iter()
        .find(|&kind| f64::from(kind as u8) == value);
    kind.ok_or_else(|| range(KEY, value, EXPECTED))
}

/// Reads a word or a truth value.
pub(crate) fn read<'de, D: Deserializer<'de>>(from: D) -> Result<ThirdTilt, D::Error> {
    from.deserialize_any(Word)
}

struct Word;

impl Visitor<'_> for Word {
    type Value = ThirdTilt;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "one of {}, true (comparator), false (absent)",
            NAMES.join(", ")
        )
    }

    fn visit_bool<E: serde::de::Error>(self, fitted: bool) -> Result<ThirdTilt, E> {
        Ok(if fitted {
            ThirdTilt::Comparator
        } else {
            ThirdTilt::Absent
        })
    }

    fn visit_str<E: serde::de::Error>(self, word: &str) -> Result<ThirdTilt, E> {
        named(word).ok_or_else(|| E::unknown_variant(word, NAMES))
    }
}
