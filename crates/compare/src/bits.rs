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

/// The number of unequal or missing partners, and the first.
fn mismatches<T: PartialEq>(native: &[T], emulated: &[T]) -> (u64, Option<usize>) {
    let mut different = (0..native.len().max(emulated.len()))
        .filter(|&index| native.get(index) != emulated.get(index));
    let first = different.next();
    (u64::from(first.is_some()) + different.count() as u64, first)
}

impl BitComparison {
    pub(crate) fn of(native: &[i64], emulated: &[i64], per_solution: usize) -> Self {
        let (mismatches, first) = mismatches(native, emulated);
        Self {
            compared: native.len().min(emulated.len()) as u64,
            mismatches,
            first_mismatch: first.map(|sample| BitMismatch {
                sample,
                solution: sample / per_solution,
                native: native.get(sample).copied(),
                emulated: emulated.get(sample).copied(),
            }),
        }
    }
}

impl FrameComparison {
    pub(crate) fn of(native: &[Vec<u8>], emulated: &[Vec<u8>]) -> Self {
        let (mismatches, first) = mismatches(native, emulated);
        Self {
            compared: native.len().min(emulated.len()) as u64,
            mismatches,
            first_mismatch: first.map(|frame| FrameMismatch {
                frame,
                native: native.get(frame).map(|bytes| hex(bytes)),
                emulated: emulated.get(frame).map(|bytes| hex(bytes)),
            }),
        }
    }
}
