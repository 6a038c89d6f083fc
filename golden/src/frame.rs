//! Frames off the serial line, read by the layout in [`cardan_spec::frame`] alone.
//!
//! This is the second implementation of the wire format. It shares no code with the firmware that
//! writes it: framing and check sum come from the `cobs` and `crc` crates.

use cardan_spec::CHANNELS;
use cardan_spec::frame::{DELIMITER, FRAC, MOST_PAYLOAD_LEN, PAYLOAD_LEN};
use crc::{CRC_16_IBM_3740, Crc};

/// CRC-16/CCITT with the start 0xFFFF, as the layout names it.
const CHECK_SUM: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_3740);

/// What a frame says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Number of the solution, modulo 2^16.
    pub sequence: u16,
    /// Average per channel over full scale, in conversion order.
    pub averages: [f64; CHANNELS],
    /// Average of the third tilt axis over full scale, where it is measured.
    pub tilt_z: Option<f64>,
    /// Yaw, pitch, roll of set 1 in half turns.
    pub angles: [f64; 3],
    /// Status bits ([`cardan_spec::flags`]).
    pub status: u16,
}

/// Why bytes are no frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// The last byte is not the delimiter.
    NoDelimiter,
    /// The encoding is not COBS.
    Encoding,
    /// The payload has another length than the layout's.
    Length(usize),
    /// The check sum is not that of the payload.
    CheckSum {
        /// As sent.
        sent: u16,
        /// Of the payload.
        computed: u16,
    },
}

impl std::fmt::Display for FrameError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoDelimiter => write!(f, "its last byte is not the delimiter {DELIMITER:#04x}"),
            Self::Encoding => write!(f, "it is not COBS-encoded"),
            Self::Length(length) => {
                write!(
                    f,
                    "its payload has {length} bytes, expected {PAYLOAD_LEN}, or {MOST_PAYLOAD_LEN} with a \
                     third tilt axis"
                )
            }
            Self::CheckSum { sent, computed } => write!(
                f,
                "its check sum is {sent:#06x}, that of its payload {computed:#06x}"
            ),
        }
    }
}

impl std::error::Error for FrameError {}

/// Decodes one frame with its delimiter.
///
/// # Errors
/// Bytes that are no frame of the layout.
pub fn decode(bytes: &[u8]) -> Result<Frame, FrameError> {
    let Some((&DELIMITER, encoded)) = bytes.split_last() else {
        return Err(FrameError::NoDelimiter);
    };
    let payload = cobs::decode_vec(encoded).map_err(|_| FrameError::Encoding)?;
    let has_third = match payload.len() {
        PAYLOAD_LEN => false,
        MOST_PAYLOAD_LEN => true,
        length => return Err(FrameError::Length(length)),
    };
    let word = |at: usize| u16::from_le_bytes([payload[at], payload[at + 1]]);
    let content = payload.len() - 2;
    let sent = word(content);
    let computed = CHECK_SUM.checksum(&payload[..content]);
    if sent != computed {
        return Err(FrameError::CheckSum { sent, computed });
    }
    let fraction = |at: usize| f64::from(word(at).cast_signed()) / f64::from(1_u32 << FRAC);
    Ok(Frame {
        sequence: word(0),
        averages: [2, 4, 6, 8].map(fraction),
        tilt_z: has_third.then(|| fraction(18)),
        angles: [10, 12, 14].map(fraction),
        status: word(16),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame written byte by byte from the layout's table, with a zero in it, and its CRC and COBS
    /// code worked out by hand (CRC-16/IBM-3740 of "123456789" is 0x29B1).
    fn payload() -> Vec<u8> {
        let mut payload = vec![0x01, 0x02];
        for average in [0x4000_i16, -0x4000, 0x0100, -1] {
            payload.extend(average.to_le_bytes());
        }
        for angle in [0x2000_i16, -0x2000, 0x7fff] {
            payload.extend(angle.to_le_bytes());
        }
        payload.extend(0x0142_u16.to_le_bytes());
        payload
    }

    fn sent(payload: &[u8]) -> Vec<u8> {
        let mut whole = payload.to_vec();
        whole.extend(CHECK_SUM.checksum(payload).to_le_bytes());
        let mut bytes = cobs::encode_vec(&whole);
        bytes.push(0);
        bytes
    }

    #[test]
    fn the_check_sum_is_the_one_that_the_layout_names() {
        assert_eq!(CHECK_SUM.checksum(b"123456789"), 0x29B1);
    }

    #[test]
    fn every_field_is_read_from_its_place() {
        let frame = decode(&sent(&payload())).expect("is a frame");
        let expected = Frame {
            sequence: 0x0201,
            averages: [0.5, -0.5, 256.0 / 32768.0, -1.0 / 32768.0],
            tilt_z: None,
            angles: [0.25, -0.25, 32767.0 / 32768.0],
            status: 0x0142,
        };
        assert_eq!(frame, expected);
        let mut longer = payload();
        longer.extend(0x2000_i16.to_le_bytes());
        let with_third = decode(&sent(&longer)).expect("is a frame");
        let tilt_z = Some(0.25);
        assert_eq!(with_third, Frame { tilt_z, ..expected });
    }

    #[test]
    fn what_is_no_frame_is_refused_with_its_reason() {
        let good = sent(&payload());
        assert_eq!(decode(&[]), Err(FrameError::NoDelimiter));
        assert_eq!(
            decode(&good[..good.len() - 1]),
            Err(FrameError::NoDelimiter)
        );
        assert_eq!(decode(&[200, 1, 2, 0]), Err(FrameError::Encoding));
        assert_eq!(decode(&sent(&payload()[..16])), Err(FrameError::Length(18)));
        for at in 0..good.len() - 1 {
            let mut damaged = good.clone();
            damaged[at] ^= 0x10;
            assert!(decode(&damaged).is_err(), "byte {at}");
        }
    }
}
