//! Analog comparator (data sheet section 23).
//!
//! Inaccuracies: hysteresis, offset and propagation time; the output is looked at when the
//! environment announces a change ([`crate::Environment::next_input`]) and when ACSR is read.

const ACD: u8 = 0x80;
const ACBG: u8 = 0x40;
const ACO: u8 = 0x20;
const ACI: u8 = 0x10;
const ACIE: u8 = 0x08;
const ACIC: u8 = 0x04;

/// Comparator registers.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Comparator {
    control: u8,
    output: bool,
    flag: bool,
    /// The program has touched ACSR, so the output is worth watching.
    in_use: bool,
}

impl Comparator {
    pub(crate) fn is_watched(&self) -> bool {
        self.in_use && self.control & ACD == 0
    }

    /// The positive input is the bandgap, not AIN0.
    pub(crate) fn uses_bandgap(&self) -> bool {
        self.control & ACBG != 0
    }

    /// The output, not ICP1, drives the capture unit of Timer1.
    pub(crate) fn drives_capture(&self) -> bool {
        self.control & ACIC != 0
    }

    pub(crate) fn output(&self) -> bool {
        self.output
    }

    pub(crate) fn requests(&self) -> bool {
        self.flag && self.control & ACIE != 0
    }

    pub(crate) fn clear_flag(&mut self) {
        self.flag = false;
    }

    /// Takes the comparison of both inputs. Returns whether the output changed.
    pub(crate) fn compare(&mut self, output: bool) -> bool {
        let (was, is) = (self.output, output && self.control & ACD == 0);
        self.output = is;
        let is_event = match self.control & 3 {
            0 => was != is,
            2 => was && !is,
            3 => !was && is,
            _ => false,
        };
        self.flag |= is_event;
        was != is
    }

    pub(crate) fn read(&mut self) -> u8 {
        let flag = if self.flag { ACI } else { 0 };
        let output = if self.output { ACO } else { 0 };
        self.control | flag | output
    }

    /// Starts watching: the first comparison after this is no edge.
    pub(crate) fn begin(&mut self, output: bool) {
        if !self.in_use {
            self.in_use = true;
            self.output = output && self.control & ACD == 0;
        }
    }

    pub(crate) fn write(&mut self, value: u8) {
        self.control = value & !(ACO | ACI);
        if value & ACI != 0 {
            self.flag = false;
        }
    }
}
