//! How node values leave the chip in tapped builds.
//!
//! The firmware keeps a table of `i32`, one word per node in the order of [`crate::nodes`], in SRAM
//! under the symbol [`TABLE_SYMBOL`]. To publish a node it stores the raw word there and then writes
//! the node's index to GPIOR0; an emulator that sees the write reads the word. One slot per node, so
//! that an interrupt between store and strobe disturbs nothing.

/// ELF symbol of the table in SRAM.
pub const TABLE_SYMBOL: &str = "CARDAN_TAPS";
/// ELF symbol of the format table in flash or in a section of its own: the hash and, per node,
/// word length, fractional bits, rounding and overflow.
pub const FORMATS_SYMBOL: &str = "CARDAN_FORMATS";

/// Symbol of the digest of the sources that an image was made of, beside the format table: hexadecimal
/// digits. Images without it say nothing of their sources.
pub const SOURCES_SYMBOL: &str = "CARDAN_SOURCES";
