//! Frames off the wire, decoded with an independent COBS decoder.

use cardan_firmware::frame::crc16;
use cardan_spec::frame::{DELIMITER, FRAC, PAYLOAD_LEN};

/// Yaw, pitch, roll in half turns and the status bits of a whole frame.
pub(super) fn decode(bytes: &[u8]) -> Option<([f64; 3], u16)> {
    let (&last, encoded) = bytes.split_last()?;
    if last != DELIMITER {
        return None;
    }
    let payload = cobs::decode_vec(encoded).ok()?;
    let payload: &[u8; PAYLOAD_LEN] = payload.as_slice().try_into().ok()?;
    let word = |offset: usize| u16::from_le_bytes([payload[offset], payload[offset + 1]]);
    if crc16(&payload[..PAYLOAD_LEN - 2]) != word(PAYLOAD_LEN - 2) {
        return None;
    }
    let scale = f64::from(1_u32 << FRAC);
    let angle = |offset: usize| f64::from(word(offset) as i16) / scale;
    Some(([angle(10), angle(12), angle(14)], word(16)))
}
