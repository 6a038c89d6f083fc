//! Frames off the wire, decoded with an independent COBS decoder.

use cardan_firmware::frame::{Frame, crc16};
use cardan_spec::MOST_CHANNELS;
use cardan_spec::frame::{DELIMITER, FRAC, MOST_PAYLOAD_LEN, PAYLOAD_LEN};

/// Yaw, pitch, roll in half turns and the status bits of a whole frame.
pub(super) fn decode(bytes: &[u8]) -> Option<([f64; 3], u16)> {
    let frame = decode_frame(bytes)?;
    let scale = f64::from(1_u32 << FRAC);
    Some((
        frame.angles.map(|angle| f64::from(angle) / scale),
        frame.flags,
    ))
}

/// A whole frame.
pub(super) fn decode_frame(bytes: &[u8]) -> Option<Frame> {
    let (&last, encoded) = bytes.split_last()?;
    if last != DELIMITER {
        return None;
    }
    let payload = cobs::decode_vec(encoded).ok()?;
    let third = match payload.len() {
        PAYLOAD_LEN => false,
        MOST_PAYLOAD_LEN => true,
        _ => return None,
    };
    let (content, _) = payload.split_last_chunk::<2>()?;
    let word = |offset: usize| u16::from_le_bytes([payload[offset], payload[offset + 1]]);
    if crc16(content) != word(content.len()) {
        return None;
    }
    let signed = |offset: usize| word(offset) as i16;
    let mut averages = [0; MOST_CHANNELS];
    for (average, offset) in averages.iter_mut().zip([2, 4, 6, 8]) {
        *average = signed(offset);
    }
    if third {
        averages[MOST_CHANNELS - 1] = signed(18);
    }
    Some(Frame {
        sequence: word(0),
        averages,
        third,
        angles: [10, 12, 14].map(signed),
        flags: word(16),
    })
}
