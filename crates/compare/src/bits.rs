//! Native against emulated, bit by bit: the compiled code must do what the model does.

use serde::Serialize;

use crate::format::hex;

/// Raw integers of a node from both participants.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BitComparison {
    /// Values that both wrote.
    pub compared: u64,
    /// Values that differ, and those that only one of them wrote.
    pub mismatches: u64,
    /// The first of them.
    pub first_mismatch: Option<BitMismatch>,
}

/// Where two streams first differ.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BitMismatch {
    /// Index of the value in the node's stream.
    pub sample: usize,
    /// Index of the solution.
    pub solution: usize,
    /// Native's raw integer; `None` where it wrote no such value.
    pub native: Option<i64>,
    /// The emulated raw integer; `None` where it wrote no such value.
    pub emulated: Option<i64>,
}

/// Frames from both participants, byte by byte.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FrameComparison {
    /// Frames that both sent.
    pub compared: u64,
    /// Frames that differ, and those that only one of them sent.
    pub mismatches: u64,
    /// The first of them.
    pub first_mismatch: Option<FrameMismatch>,
}

/// Where the frames first differ, bytes in hexadecimal.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameMismatch {
    /// Index of the frame.
    pub frame: usize,
    /// Native's bytes.
    pub native: Option<String>,
    /// The emulated bytes.
    pub emulated: Option<String>,
}

/// Counts partners that are unequal or missing, window by window.
#[derive(Clone, Debug, Default)]
pub(crate) struct Partners {
    native: usize,
    emulated: usize,
    mismatches: u64,
}

/// Where two streams differ first: the place in the whole streams, and what either has there.
pub(crate) struct Mismatch<'a, T> {
    pub(crate) at: usize,
    pub(crate) native: Option<&'a T>,
    pub(crate) emulated: Option<&'a T>,
}

impl Partners {
    /// Adds a window, in which both streams begin at the same place; the first difference of all, if it is here.
    pub(crate) fn add<'a, T: PartialEq>(
        &mut self,
        native: &'a [T],
        emulated: &'a [T],
    ) -> Option<Mismatch<'a, T>> {
        let before = self.mismatches;
        let offset = self.native.max(self.emulated);
        let mut first = None;
        for index in 0..native.len().max(emulated.len()) {
            let (native, emulated) = (native.get(index), emulated.get(index));
            if native != emulated {
                self.mismatches += 1;
                let at = offset + index;
                first.get_or_insert(Mismatch {
                    at,
                    native,
                    emulated,
                });
            }
        }
        self.native += native.len();
        self.emulated += emulated.len();
        first.filter(|_| before == 0)
    }

    fn compared(&self) -> u64 {
        self.native.min(self.emulated) as u64
    }
}

/// Adds up how words of a node compare.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bits {
    partners: Partners,
    first: Option<BitMismatch>,
}

impl Bits {
    pub(crate) fn add(&mut self, native: &[i64], emulated: &[i64], per_solution: usize) {
        if let Some(first) = self.partners.add(native, emulated) {
            self.first = Some(BitMismatch {
                sample: first.at,
                solution: first.at / per_solution,
                native: first.native.copied(),
                emulated: first.emulated.copied(),
            });
        }
    }

    pub(crate) fn found(&self) -> BitComparison {
        BitComparison {
            compared: self.partners.compared(),
            mismatches: self.partners.mismatches,
            first_mismatch: self.first.clone(),
        }
    }
}

/// Adds up how frames compare.
#[derive(Clone, Debug, Default)]
pub(crate) struct FrameBytes {
    partners: Partners,
    first: Option<FrameMismatch>,
}

impl FrameBytes {
    pub(crate) fn add(&mut self, native: &[Vec<u8>], emulated: &[Vec<u8>]) {
        if let Some(first) = self.partners.add(native, emulated) {
            self.first = Some(FrameMismatch {
                frame: first.at,
                native: first.native.map(|bytes| hex(bytes)),
                emulated: first.emulated.map(|bytes| hex(bytes)),
            });
        }
    }

    pub(crate) fn found(&self) -> FrameComparison {
        FrameComparison {
            compared: self.partners.compared(),
            mismatches: self.partners.mismatches,
            first_mismatch: self.first.clone(),
        }
    }
}
