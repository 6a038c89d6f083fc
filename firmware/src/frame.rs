//! Frames on the serial line, binary and text. Layout: [`cardan_spec::frame`].

use cardan_spec::frame::{DELIMITER, MOST_PAYLOAD_LEN, MOST_WIRE_LEN};
use cardan_spec::{CHANNELS, MOST_CHANNELS};
use heapless::Vec;

/// Longest text line with its end.
pub const TEXT_LEN: usize = 48;

/// What a frame says, as raw words.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// Number of the solution, modulo 2^16.
    pub sequence: u16,
    /// Average per channel over full scale with 15 fractional bits.
    pub averages: [i16; MOST_CHANNELS],
    /// The third tilt axis is measured: the last average is its own.
    pub third: bool,
    /// Yaw, pitch, roll in half turns with 15 fractional bits.
    pub angles: [i16; 3],
    /// Status bits.
    pub flags: u16,
}

/// CRC-16/CCITT: polynomial 0x1021, start 0xFFFF, most significant bit first. Bytewise without a
/// table: the table's 512 bytes would take a quarter of the controller's RAM.
#[must_use]
#[inline(never)]
pub fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc: u16, &byte| {
        let x = (crc >> 8) as u8 ^ byte;
        let x = x ^ (x >> 4);
        let x = u16::from(x);
        (crc << 8) ^ (x << 12) ^ (x << 5) ^ x
    })
}

impl Frame {
    /// The bytes before encoding, with the checksum.
    #[must_use]
    pub fn payload(&self) -> Vec<u8, MOST_PAYLOAD_LEN> {
        let mut payload = Vec::new();
        let mut put = |word: u16| {
            let _ = payload.extend_from_slice(&word.to_le_bytes());
        };
        put(self.sequence);
        let (channels, third) = self.averages.split_at(CHANNELS);
        channels.iter().for_each(|&average| put(average as u16));
        self.angles.iter().for_each(|&angle| put(angle as u16));
        put(self.flags);
        if self.third {
            third.iter().for_each(|&average| put(average as u16));
        }
        let crc = crc16(&payload);
        let _ = payload.extend_from_slice(&crc.to_le_bytes());
        payload
    }

    /// The bytes on the wire: COBS and the delimiter.
    #[must_use]
    pub fn encode(&self) -> Vec<u8, MOST_WIRE_LEN> {
        let mut wire = Vec::new();
        // A payload of 22 bytes never reaches COBS's 254-byte blocks. The capacity is exact, so that
        // pushing cannot fail.
        let mut start = 0;
        let _ = wire.push(1);
        for &byte in &self.payload() {
            let is_end = byte == 0;
            if is_end {
                start = wire.len();
            } else if let Some(length) = wire.get_mut(start) {
                *length += 1;
            }
            let _ = wire.push(if is_end { 1 } else { byte });
        }
        let _ = wire.push(DELIMITER);
        wire
    }

    /// A text line: sequence, yaw, pitch, roll in hundredths of a degree, status bits in hex.
    #[must_use]
    pub fn text(&self) -> Vec<u8, TEXT_LEN> {
        let mut line = Vec::new();
        decimal(&mut line, i32::from(self.sequence));
        for angle in self.angles {
            put(&mut line, b' ');
            // 18000 / 32768 hundredths of a degree per place, rounded to nearest.
            decimal(&mut line, (i32::from(angle) * 1125 + 1024) >> 11);
        }
        put(&mut line, b' ');
        put(&mut line, b'0');
        put(&mut line, b'x');
        let mut rest = self.flags;
        for _ in 0..4 {
            let digit = (rest >> 12) as u8;
            put(&mut line, digit + if digit < 10 { b'0' } else { b'a' - 10 });
            rest <<= 4;
        }
        put(&mut line, b'\r');
        put(&mut line, b'\n');
        line
    }
}

/// Not inlined: a text line has a dozen of places that put something. The capacity is that of the
/// longest line, so that pushing cannot fail.
#[inline(never)]
fn put(line: &mut Vec<u8, TEXT_LEN>, byte: u8) {
    let _ = line.push(byte);
}

fn decimal(line: &mut Vec<u8, TEXT_LEN>, value: i32) {
    if value < 0 {
        put(line, b'-');
    }
    let mut rest = value.unsigned_abs() as u16;
    let mut started = false;
    for power in [10_000_u16, 1000, 100, 10, 1] {
        let mut digit = b'0';
        while rest >= power {
            rest -= power;
            digit += 1;
        }
        started |= digit != b'0' || power == 1;
        if started {
            put(line, digit);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardan_spec::frame::{PAYLOAD_LEN, WIRE_OVERHEAD};

    fn frame(sequence: u16, word: i16, third: bool) -> Frame {
        let mut averages = [word; MOST_CHANNELS];
        averages[CHANNELS] = if third { word / 2 } else { 0 };
        Frame {
            sequence,
            averages,
            third,
            angles: [0, word, -word],
            flags: 0x55,
        }
    }

    #[test]
    fn the_checksum_is_the_published_one() {
        assert_eq!(crc16(b"123456789"), 0x29b1);
    }

    proptest::proptest! {
        #[test]
        fn a_frame_decodes_with_an_independent_cobs_and_crc(
            sequence: u16, word in -32767_i16.., third: bool,
        ) {
            let frame = frame(sequence, word, third);
            let wire = frame.encode();
            let len = if third { MOST_PAYLOAD_LEN } else { PAYLOAD_LEN };
            proptest::prop_assert_eq!(wire.len(), len + WIRE_OVERHEAD);
            proptest::prop_assert_eq!(wire.iter().filter(|&&byte| byte == 0).count(), 1);
            let payload = cobs::decode_vec(&wire[..wire.len() - 1]).unwrap();
            proptest::prop_assert_eq!(&payload[..], &frame.payload()[..]);
            let (content, sent) = payload.split_at(len - 2);
            let crc = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(content);
            proptest::prop_assert_eq!(&crc.to_le_bytes()[..], sent);
            let word = |at: usize| i16::from_le_bytes([payload[at], payload[at + 1]]);
            proptest::prop_assert_eq!(&[2, 4, 6, 8].map(word)[..], &frame.averages[..CHANNELS]);
            proptest::prop_assert!(!third || word(18) == frame.averages[CHANNELS]);
        }
    }

    #[test]
    fn a_text_line_gives_hundredths_of_degrees() {
        let frame = Frame {
            sequence: 7,
            angles: [16384, -32768, 1],
            flags: 0x41,
            ..frame(7, 0, false)
        };
        assert_eq!(&frame.text()[..], b"7 9000 -18000 1 0x0041\r\n");
    }
}
