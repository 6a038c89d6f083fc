//! Every field of a frame is where the layout (`cardan_spec::frame`) says, whatever the others are.

use cardan_firmware::frame::Frame;
use cardan_spec::frame::{MOST_PAYLOAD_LEN, PAYLOAD_LEN};
use proptest::prelude::*;

proptest! {
    #[test]
    fn each_field_has_its_own_place_in_the_layout(
        sequence: u16, averages: [i16; 5], angles: [i16; 3], flags: u16, third: bool,
    ) {
        let frame = Frame { sequence, averages, third, angles, flags };
        let wire = frame.encode();
        let payload = cobs::decode_vec(&wire[..wire.len() - 1]).expect("is COBS");
        // Bytes of the layout's table: number, four averages, yaw, pitch, roll, status, fifth average.
        let mut expected = sequence.to_le_bytes().to_vec();
        for word in [averages[0], averages[1], averages[2], averages[3]].into_iter().chain(angles) {
            expected.extend(word.to_le_bytes());
        }
        expected.extend(flags.to_le_bytes());
        if third {
            expected.extend(averages[4].to_le_bytes());
        }
        prop_assert_eq!(&payload[..payload.len() - 2], &expected[..]);
        let sum = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740).checksum(&expected);
        prop_assert_eq!(&payload[payload.len() - 2..], &sum.to_le_bytes()[..]);
        prop_assert_eq!(payload.len(), if third { MOST_PAYLOAD_LEN } else { PAYLOAD_LEN });
    }
}
