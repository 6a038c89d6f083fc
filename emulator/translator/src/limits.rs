//! What users set and see of the translator.

use std::time::Duration;

/// When and how much to translate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Arrivals at a place after which it is translated. With 0 everything is, at first sight.
    pub threshold: u32,
    /// Most bytes of host code; what comes later is interpreted.
    pub code_bytes: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            threshold: 8000,
            code_bytes: 16 << 20,
        }
    }
}

/// What the translator has done so far. Costs host time, so none of it belongs into results.
#[derive(Clone, Copy, Debug, Default)]
pub struct Work {
    /// Regions translated.
    pub regions: usize,
    /// Host code kept at present, in bytes.
    pub code_bytes: usize,
    /// Time spent on translating.
    pub time: Duration,
    /// Entries into translated code.
    pub entries: u64,
    /// Times that the interpreter had to go on.
    pub interpreted: u64,
}
