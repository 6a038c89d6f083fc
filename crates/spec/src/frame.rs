//! Layout of the frames on the serial line (115200 8N1, binary).
//!
//! A frame is COBS-encoded and ends with a zero byte. Before encoding, all little-endian:
//!
//! | offset | type | content |
//! |---|---|---|
//! | 0 | u16 | sequence number of the solution; the first after settling is 0 |
//! | 2 | 4 x i16 | averages over full scale per channel, in conversion order, 15 fractional bits: the average bipolar code with 6 fractional bits, exact for up to 64 conversions, rounded beyond |
//! | 10 | 3 x i16 | yaw, pitch, roll of set 1 (Z-Y-X) in half turns, 15 fractional bits |
//! | 16 | u16 | status bits ([`crate::flags`]) |
//! | 18 | u16 | CRC-16/CCITT (polynomial 0x1021, start 0xFFFF, as "CRC-16/IBM-3740") of bytes 0..18 |
//!
//! A device that measures its third tilt axis sends a longer one, by which it is told apart: at 18 the
//! average of that axis (i16, as the others), at 20 the CRC of bytes 0..20.

/// Bytes of a frame before COBS, with its CRC.
pub const PAYLOAD_LEN: usize = 20;
/// The same where the third tilt axis is measured.
pub const MOST_PAYLOAD_LEN: usize = PAYLOAD_LEN + 2;
/// Bytes that a payload grows by on the wire: COBS adds one for payloads up to 254, the zero another.
pub const WIRE_OVERHEAD: usize = 2;
/// Bytes of a frame on the wire.
pub const WIRE_LEN: usize = PAYLOAD_LEN + WIRE_OVERHEAD;
/// The same where the third tilt axis is measured.
pub const MOST_WIRE_LEN: usize = MOST_PAYLOAD_LEN + WIRE_OVERHEAD;
/// The byte that ends a frame.
pub const DELIMITER: u8 = 0;
/// Fractional bits of averages and angles.
pub const FRAC: u32 = 15;
/// A received byte that switches the device to text lines.
pub const COMMAND_TEXT: u8 = b't';
/// A received byte that switches the device to binary frames.
pub const COMMAND_BINARY: u8 = b'b';
/// A received byte that tells the device that it is upright: its half-space is known again.
pub const COMMAND_UPRIGHT: u8 = b'u';
/// A received byte that announces new settings ([`crate::calibration`]). The device stops measuring and
/// sends an empty frame (two delimiters in a row); then the host sends the image, at the line's full
/// speed and without a pause of [`SETTINGS_PAUSE_MS`]. A valid image is stored; what the device holds
/// then comes back, [`crate::calibration::LEN`] bytes, and it restarts with that. A host that finds
/// other bytes than its own sends them again: a damaged image, or one that does not come, changes
/// nothing.
pub const COMMAND_SETTINGS: u8 = b'c';
/// Silence, in milliseconds, after which the device gives up waiting for settings and restarts.
pub const SETTINGS_PAUSE_MS: u32 = 1000;
