//! The text mode's line: every digit, zero and both ends of the range.

use cardan_firmware::frame::Frame;

#[test]
fn digits_of_both_kinds_zero_and_the_ends_of_the_range_are_written() {
    let frame = Frame {
        sequence: 65535,
        angles: [0, -1, 32767],
        flags: 0x9afe,
        ..Frame::default()
    };
    assert_eq!(&frame.text()[..], b"65535 0 -1 17999 0x9afe\r\n");
}
