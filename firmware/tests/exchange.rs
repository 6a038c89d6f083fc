//! Settings over the serial line: what the memory holds afterwards, and what the host is told.

use std::collections::VecDeque;

use cardan_firmware::calibration::{NOMINAL, Settings};
use cardan_firmware::exchange::take_settings;
use cardan_firmware::hal::{Bytes, Memory};
use cardan_spec::ThirdTilt;
use cardan_spec::calibration::LEN;
use cardan_spec::timing::Averaging;
use proptest::prelude::*;

struct Line {
    sent: VecDeque<u8>,
    told: Vec<u8>,
}

impl Bytes for Line {
    fn read(&mut self) -> u8 {
        assert_eq!(self.told, [0, 0], "the device was ready before");
        self.sent
            .pop_front()
            .expect("asks for no more than an image")
    }

    fn write(&mut self, byte: u8) {
        self.told.push(byte);
    }
}

struct Eeprom([u8; 256]);

impl Memory for Eeprom {
    fn read(&mut self, address: u8) -> u8 {
        self.0[usize::from(address)]
    }

    fn write(&mut self, address: u8, byte: u8) {
        self.0[usize::from(address)] = byte;
    }
}

/// What the memory holds and the host is told after `sent`.
fn after(sent: &[u8; LEN], before: [u8; 256]) -> ([u8; 256], Vec<u8>) {
    let mut line = Line {
        sent: sent.iter().copied().collect(),
        told: Vec::new(),
    };
    let mut memory = Eeprom(before);
    take_settings(&mut line, &mut memory);
    assert!(line.sent.is_empty());
    (memory.0, line.told[2..].to_vec())
}

fn settings(seed: i32) -> Settings {
    Settings {
        words: NOMINAL.map(|word| word.wrapping_add(seed)),
        averaging: Averaging::new(3, 5).expect("admissible"),
        third_tilt: ThirdTilt::Comparator,
        uncalibrated: false,
    }
}

proptest! {
    #[test]
    fn a_valid_image_is_stored_and_told_back(seed: i32, filler: u8) {
        let image = settings(seed).image();
        let (memory, told) = after(&image, [filler; 256]);
        prop_assert_eq!(&memory[..LEN], &image[..]);
        prop_assert!(memory[LEN..].iter().all(|&byte| byte == filler));
        prop_assert_eq!(told, image.to_vec());
    }

    #[test]
    fn a_damaged_image_changes_nothing_and_the_host_sees_it(
        seed: i32,
        at in 0..LEN,
        damage in 1_u8..,
    ) {
        let mut before = [0xff; 256];
        before[..LEN].copy_from_slice(&settings(7).image());
        let mut image = settings(seed).image();
        image[at] ^= damage;
        let (memory, told) = after(&image, before);
        prop_assert_eq!(memory, before);
        prop_assert_eq!(&told[..], &before[..LEN]);
    }
}
