//! Self-programming (data sheet section 26): SPMCSR, page buffer, programming times.
//!
//! Inaccuracies: boot lock bits do not protect anything; the RWW section stays readable while it
//! is programmed.

const SPMIE: u8 = 0x80;
const RWWSB: u8 = 0x40;
const SIGRD: u8 = 0x20;
const RWWSRE: u8 = 0x10;
const BLBSET: u8 = 0x08;
const PGWRT: u8 = 0x04;
const PGERS: u8 = 0x02;
const SELFPRGEN: u8 = 0x01;
/// Cycles within which SPM (or LPM, three) must follow the write of SPMCSR.
const WINDOW: u64 = 4;
const LPM_WINDOW: u64 = 3;
/// Longest programming time of a page (table 26-8), in microseconds.
pub(crate) const PROGRAM_US: u64 = 4500;

/// What SPM does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Operation {
    Nothing,
    Fill,
    Erase,
    Write,
    EnableRww,
}

/// What LPM reads instead of program memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SpecialRead {
    FuseOrLock,
    Signature,
}

/// Control register and page buffer.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Spm {
    control: u8,
    armed_until: u64,
    lpm_until: u64,
    is_rww_busy: bool,
    busy_until: Option<u64>,
    /// Words written to the page buffer; the rest is erased.
    pub(crate) buffer: Vec<(usize, u16)>,
}

impl Spm {
    pub(crate) fn next_event(&self) -> Option<u64> {
        self.busy_until
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.busy_until.is_some()
    }

    pub(crate) fn finish(&mut self) {
        self.busy_until = None;
    }

    /// SPM_READY is a level.
    pub(crate) fn requests(&self, at: u64) -> bool {
        self.control & SPMIE != 0 && self.busy_until.is_none() && at > self.armed_until
    }

    pub(crate) fn read(&self, at: u64) -> u8 {
        let command = SIGRD | RWWSRE | BLBSET | PGWRT | PGERS | SELFPRGEN;
        let is_pending = self.busy_until.is_some() || at < self.armed_until;
        let pending = if is_pending {
            self.control & command
        } else {
            0
        };
        self.control & SPMIE | pending | if self.is_rww_busy { RWWSB } else { 0 }
    }

    /// SPMCSR with effect at cycle `at`.
    pub(crate) fn write(&mut self, value: u8, at: u64) {
        self.control = value & !RWWSB;
        if value & SELFPRGEN != 0 && !self.is_busy() {
            self.armed_until = at + WINDOW;
            self.lpm_until = at + LPM_WINDOW;
        }
    }

    /// Whether LPM may have to read something else soon.
    pub(crate) fn redirects_lpm(&self) -> bool {
        self.lpm_until > 0
    }

    /// What an LPM that begins at cycle `at` reads.
    pub(crate) fn special_read(&mut self, at: u64) -> Option<SpecialRead> {
        if at > std::mem::take(&mut self.lpm_until) {
            return None;
        }
        match self.control & (SIGRD | BLBSET) {
            0 => None,
            SIGRD => Some(SpecialRead::Signature),
            _ => Some(SpecialRead::FuseOrLock),
        }
    }

    /// The operation of an SPM that begins at cycle `at`.
    pub(crate) fn operation(&mut self, at: u64) -> Operation {
        if at > std::mem::take(&mut self.armed_until) || self.is_busy() {
            return Operation::Nothing;
        }
        match self.control & (RWWSRE | BLBSET | PGWRT | PGERS | SELFPRGEN) {
            SELFPRGEN => Operation::Fill,
            0x03 => Operation::Erase,
            0x05 => Operation::Write,
            0x11 => Operation::EnableRww,
            _ => Operation::Nothing,
        }
    }

    /// Programming of a page has begun and ends at cycle `until`.
    pub(crate) fn begin(&mut self, until: u64, is_rww: bool) {
        self.is_rww_busy |= is_rww;
        self.busy_until = Some(until);
    }

    pub(crate) fn enable_rww(&mut self) {
        self.is_rww_busy = false;
        self.buffer.clear();
    }
}
