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

/// One analog-to-digital conversion.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct Conversion {
    /// Position in the stream of all conversions, from 0.
    pub sequence: u64,
    /// MCU cycle of the hold instant.
    pub cycle: u64,
    /// Voltage in volts that an ideal chain would have held at that instant.
    pub ideal_volts: f64,
    /// Bipolar code that memoryless ideal sensors would have given; NaN where the true attitude is
    /// not known.
    pub direct_code: f64,
    /// Bipolar code that memoryless ideal sensors would have given of the true specific force and
    /// field.
    pub experienced_code: f64,
    /// The converter's code.
    pub code: u16,
    /// Multiplexer channel.
    pub channel: u8,
    /// Bits of [`Conversion::LATE`] and those after it.
    pub flags: u8,
}

impl Conversion {
    /// The result was fetched after its deadline.
    pub const LATE: u8 = 1;
    /// The result was overwritten before the firmware fetched it.
    pub const LOST: u8 = 2;
    /// A third tilt axis was read with this conversion, the last of a solution.
    pub const THIRD_TILT: u8 = 4;
    /// It told that the device is upside down.
    pub const UPSIDE_DOWN: u8 = 8;
    /// The true attitude is known there.
    pub const TRUTH: u8 = 16;
    /// The device truly is upside down.
    pub const TRULY_UPSIDE_DOWN: u8 = 32;

    /// True when all of `bits` are set.
    #[must_use]
    pub const fn has(&self, bits: u8) -> bool {
        self.flags & bits == bits
    }

    /// True when the firmware never saw this code.
    #[must_use]
    pub const fn is_lost(&self) -> bool {
        self.flags & Self::LOST != 0
    }

    /// True when the firmware fetched this code after its deadline.
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

/// The attitude that the scenario imposed.
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[repr(C)]
pub struct TruthSample {
    /// Time in seconds since the start of the run.
    pub time_s: f64,
    /// Roll in radians.
    pub roll_rad: f64,
    /// Pitch in radians.
    pub pitch_rad: f64,
    /// Yaw in radians.
    pub yaw_rad: f64,
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

impl Record for Conversion {
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

impl Record for TruthSample {}

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
