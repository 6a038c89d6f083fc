//! What is sent: plain `repr(C)` records without pointers, and the header in front of each slice.

use std::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;

/// A record that may cross a process border. Only this crate implements it.
pub trait Record: Copy + Debug + ZeroCopySend + 'static {
    /// MCU cycle that stamps a slice starting with this record, 0 where cycles have no meaning.
    fn cycle(&self) -> u64 {
        0
    }
}

/// Something that the firmware took in.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct Event {
    /// Position among all events of its kind, from 0.
    pub sequence: u64,
    /// MCU cycle at which it was taken: a conversion's hold instant, the end of a byte, a pin's edge.
    pub cycle: u64,
    /// A conversion's voltage in that instant, in volts, before the converter's own errors; else not a number.
    pub ideal: f64,
    /// The code, without steps, that ideal memoryless sensors would have given of what the sensors experienced;
    /// not a number where nobody knows.
    pub expected: f64,
    /// The converter's code, the byte, the level (0 or 1).
    pub value: u32,
    /// One of the constants below.
    pub kind: u8,
    /// Multiplexer channel, or number of the pin: 8 * port + bit, port 0 being B.
    pub channel: u8,
    /// Bits of [`Event::LATE`] and [`Event::LOST`].
    pub flags: u8,
}

impl Event {
    /// Kind: an analog-to-digital conversion.
    pub const CONVERSION: u8 = 0;
    /// Kind: the analog comparator's output, when the firmware read it.
    pub const COMPARATOR: u8 = 1;
    /// Kind: a byte on the serial line to the device.
    pub const BYTE: u8 = 2;
    /// Kind: an edge of an input pin.
    pub const EDGE: u8 = 3;

    /// The result was fetched after its deadline.
    pub const LATE: u8 = 1;
    /// The result was overwritten before the firmware fetched it.
    pub const LOST: u8 = 2;

    /// True when the firmware never saw this value.
    #[must_use]
    pub const fn is_lost(&self) -> bool {
        self.flags & Self::LOST != 0
    }

    /// True when the firmware fetched this value after its deadline.
    #[must_use]
    pub const fn is_late(&self) -> bool {
        self.flags & Self::LATE != 0
    }
}

/// A node's value as the raw word of its deployed format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
pub struct NodeWord {
    /// MCU cycle of the write (emulated), or of the conversion that caused it (native).
    pub cycle: u64,
    /// The raw word, sign extended.
    pub value: i64,
    /// Index of the node.
    pub node: u16,
}

/// A node's value as a real number in the node's unit.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct NodeReal {
    /// MCU cycle of the conversion that caused it.
    pub cycle: u64,
    /// The value in the node's unit; not finite where the arithmetic was not.
    pub value: f64,
    /// What rounding is expected to add to it on the average, in the same unit; 0 where that is not
    /// computed.
    pub bias: f64,
    /// Standard deviation of what rounding is expected to add; infinite where nothing bounds it.
    pub deviation: f64,
    /// Index of the node.
    pub node: u16,
}

/// A model's status of one solution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
pub struct Status {
    /// MCU cycle of the conversion that completed the solution.
    pub cycle: u64,
    /// Bits that are set.
    pub set: u32,
    /// Bits that rounding decides.
    pub doubtful: u32,
}

/// One frame exactly as its bytes left the serial port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
pub struct Frame {
    cycle: u64,
    bytes: [u8; Frame::MAX],
    len: u8,
}

impl Frame {
    /// Longest frame in bytes.
    pub const MAX: usize = 64;

    /// A frame whose last stop bit ended at `cycle`; `None` above [`Frame::MAX`] bytes.
    #[must_use]
    pub fn new(cycle: u64, bytes: &[u8]) -> Option<Self> {
        let mut frame = Self {
            cycle,
            bytes: [0; Self::MAX],
            len: u8::try_from(bytes.len()).ok()?,
        };
        frame.bytes.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(frame)
    }

    /// MCU cycle at which the frame's last stop bit ended.
    #[must_use]
    pub const fn cycle(&self) -> u64 {
        self.cycle
    }

    /// The frame's bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        // A peer of the same version wrote `len`; the bound keeps a corrupt one from panicking.
        &self.bytes[..usize::from(self.len).min(Self::MAX)]
    }
}

/// A value of a stage of the product's chain in one solution, or of a step between two stages.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct StageValue {
    /// MCU cycle of the event that completed the solution.
    pub cycle: u64,
    /// The value, in the group's own unit; not a number where it is not known.
    pub value: f64,
    /// Which stage, in the product's order; behind the last one the steps of the rounding, by node.
    pub stage: u16,
    /// Which member of the group.
    pub member: u16,
}

/// The instant that a solution stands for.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct Instant {
    /// MCU cycle at which the solution's inputs were complete.
    pub cycle: u64,
    /// Seconds after reset.
    pub time_s: f64,
}

/// A value of a signal that somebody wants to see: a pin's level, a voltage inside the front end.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct SignalValue {
    /// MCU cycle from which it holds, or at which it was taken.
    pub cycle: u64,
    /// Level (0 or 1) or volts.
    pub value: f64,
    /// Which signal; the product says what each number means.
    pub signal: u16,
}

impl Record for Event {
    fn cycle(&self) -> u64 {
        self.cycle
    }
}

impl Record for NodeWord {
    fn cycle(&self) -> u64 {
        self.cycle
    }
}

impl Record for NodeReal {
    fn cycle(&self) -> u64 {
        self.cycle
    }
}

impl Record for Status {
    fn cycle(&self) -> u64 {
        self.cycle
    }
}

impl Record for Frame {
    fn cycle(&self) -> u64 {
        self.cycle
    }
}

impl Record for StageValue {
    fn cycle(&self) -> u64 {
        self.cycle
    }
}

impl Record for Instant {
    fn cycle(&self) -> u64 {
        self.cycle
    }
}

impl Record for SignalValue {
    fn cycle(&self) -> u64 {
        self.cycle
    }
}

/// A byte of a [`Blob`](crate::Blob).
impl Record for u8 {}

/// What a participant tells all others beside its data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
pub struct Notice {
    /// One of the constants below.
    pub(crate) kind: u8,
    /// Index of the role that the notice is about.
    pub(crate) about: u8,
    /// How that role went, see [`Death`](crate::Death).
    pub(crate) death: u8,
}

impl Notice {
    /// The sender sees every stream it reads: data may flow.
    pub(crate) const READY: u8 = 1;
    /// The sender leaves early, because of the role the notice is about.
    pub(crate) const ABORT: u8 = 2;
}

impl Record for Notice {}

/// Stands in front of every slice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ZeroCopySend)]
#[repr(C)]
pub(crate) struct Header {
    /// Hash of the session id: a slice of another session is an error.
    pub(crate) session: u64,
    /// Hash of the format table: peers that disagree must not be compared.
    pub(crate) format: u64,
    /// Number of the slice in its stream, from 0 without gaps.
    pub(crate) sequence: u64,
    /// Records of the stream before this slice; on an end of stream the total.
    pub(crate) records_before: u64,
    /// MCU cycle of the first record.
    pub(crate) cycle: u64,
    /// 1 on the last slice of a stream, which carries no records, else 0.
    pub(crate) end: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_keeps_up_to_64_bytes_and_refuses_more() {
        for len in 0..=Frame::MAX {
            let bytes: Vec<u8> = (0..len as u8).collect();
            let frame = Frame::new(7, &bytes).expect("fits");
            assert_eq!((frame.cycle(), frame.bytes()), (7, bytes.as_slice()));
        }
        assert_eq!(Frame::new(0, &[0; Frame::MAX + 1]), None);
        assert_eq!(Frame::new(0, &[0; 300]), None);
    }
}
