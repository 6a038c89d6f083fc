//! Formats as they are reported, and what overflows do to a node in them.

use std::fmt;

use serde::Serialize;

use crate::input::Node;

/// A fixed-point format.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Format {
    /// Word length in bits, sign included.
    pub word: u32,
    /// Fractional bits.
    pub frac: i32,
    /// Rounding mode.
    pub rounding: String,
    /// Overflow mode.
    pub overflow: String,
}

impl Format {
    /// Smallest and largest raw word.
    #[must_use]
    pub fn raw_range(&self) -> (i64, i64) {
        let half = 1i128 << self.word.clamp(1, 64).saturating_sub(1);
        ((-half) as i64, (half - 1) as i64)
    }

    /// True if the word covers one turn of an angle in half turns exactly, so that wrapping is right.
    fn is_one_turn(&self) -> bool {
        i64::from(self.word) - i64::from(self.frac) == 1
    }
}

/// What a node's overflows do to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OnOverflow {
    /// It stays at the end of its range.
    Saturates,
    /// It comes back at the other end, which is wrong for what it holds.
    Wraps,
    /// It comes back at the other end, as angles do.
    Turns,
}

impl Node {
    /// What an overflow does to it.
    #[must_use]
    pub fn on_overflow(&self) -> OnOverflow {
        match &self.format {
            Some(format) if format.overflow == "wrap" => {
                if self.unit == crate::metrics::WRAPPING_UNIT && format.is_one_turn() {
                    OnOverflow::Turns
                } else {
                    OnOverflow::Wraps
                }
            }
            _ => OnOverflow::Saturates,
        }
    }
}

impl fmt::Display for Format {
    /// Integer bits (the sign among them) and fractional bits: `2.14`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}.{}",
            i64::from(self.word) - i64::from(self.frac),
            self.frac
        )
    }
}
