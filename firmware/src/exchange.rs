//! New settings over the serial line (the host's side: [`cardan_spec::frame::COMMAND_SETTINGS`]).

use cardan_spec::calibration::LEN;
use cardan_spec::frame::DELIMITER;

use crate::calibration::Settings;
use crate::hal::{Bytes, Memory};

/// Takes an image from `line`, stores it in `memory` from address 0 if it is valid, and tells what
/// `memory` holds then. The board restarts afterwards, and also if a byte does not come in time; until
/// the image is complete nothing has changed.
#[expect(
    clippy::explicit_counter_loop,
    reason = "a counter of one byte: addresses are u8, and flash is short"
)]
pub fn take_settings(line: &mut impl Bytes, memory: &mut impl Memory) {
    // An empty frame, which the device never sends otherwise: ready.
    line.write(DELIMITER);
    line.write(DELIMITER);
    let mut image = [0; LEN];
    for byte in &mut image {
        *byte = line.read();
    }
    let is_valid = !Settings::from_image(&image).uncalibrated;
    let mut address = 0;
    for byte in image {
        if is_valid {
            memory.write(address, byte);
        }
        address += 1;
    }
    for address in 0..LEN as u8 {
        line.write(memory.read(address));
    }
}
