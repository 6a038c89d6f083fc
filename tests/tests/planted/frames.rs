//! Faults in what the device sends, on both sides alike, so that native and emulated still agree.

use cardan::rig::Collected;
use cardan_firmware::frame::Frame;
use cardan_golden::frame::decode;
use cardan_spec::flags;
use cardan_spec::frame::{DELIMITER, PAYLOAD_LEN};
use crc::{CRC_16_XMODEM, Crc};

use crate::{Fault, Run, fault};

fn raw(fraction: f64) -> i16 {
    (fraction * 32768.0) as i16
}

/// Both sides' frames, changed field by field and sent with a right check sum.
pub(crate) fn edit(collected: &mut Collected, mut change: impl FnMut(usize, &mut Frame)) {
    for frames in [&mut collected.native_frames, &mut collected.emulated_frames] {
        for (index, bytes) in frames.iter_mut().enumerate() {
            let decoded = decode(bytes).expect("the unchanged frame is whole");
            let [a, b, c, d] = decoded.averages.map(raw);
            let mut frame = Frame {
                sequence: decoded.sequence,
                averages: [a, b, c, d, decoded.tilt_z.map_or(0, raw)],
                third: decoded.tilt_z.is_some(),
                angles: decoded.angles.map(raw),
                flags: decoded.status,
            };
            change(index, &mut frame);
            *bytes = frame.encode().to_vec();
        }
    }
}

fn each(collected: &mut Collected, change: impl Fn(&mut Vec<Vec<u8>>)) {
    change(&mut collected.native_frames);
    change(&mut collected.emulated_frames);
}

/// The payload with a check sum of another start value.
fn with_other_check_sum(bytes: &mut Vec<u8>) {
    let mut payload = cobs::decode_vec(&bytes[..bytes.len() - 1]).expect("COBS");
    payload.truncate(PAYLOAD_LEN - 2);
    let sum = Crc::<u16>::new(&CRC_16_XMODEM).checksum(&payload);
    payload.extend(sum.to_le_bytes());
    *bytes = cobs::encode_vec(&payload);
    bytes.push(DELIMITER);
}

/// A bit that is never set.
fn never(collected: &mut Collected, bit: u16) {
    edit(collected, |_, frame| frame.flags &= !bit);
}

/// A bit that is set in one solution of `every`.
fn sometimes(collected: &mut Collected, bit: u16, every: usize) {
    edit(collected, |index, frame| {
        if index % every == every / 2 {
            frame.flags |= bit;
        }
    });
}

pub(crate) fn faults() -> Vec<Fault> {
    vec![
        fault(
            "pitch and roll swapped in frames",
            Run::Tumble,
            "frames: native: yaw|frames: native: pitch",
            |c| {
                edit(c, |_, f| f.angles.swap(1, 2));
            },
        ),
        fault(
            "yaw and pitch swapped in frames",
            Run::Tumble,
            "frames: native: yaw",
            |c| {
                edit(c, |_, f| f.angles.swap(0, 1));
            },
        ),
        fault(
            "yaw negated in frames",
            Run::Tumble,
            "frames: native: yaw",
            |c| {
                edit(c, |_, f| f.angles[0] = f.angles[0].wrapping_neg());
            },
        ),
        fault(
            "yaw 0.1 degrees off in frames",
            Run::Tumble,
            "frames: native: yaw",
            |c| {
                edit(c, |_, f| f.angles[0] = f.angles[0].wrapping_add(18));
            },
        ),
        fault(
            "angles with 14 fractional bits in frames",
            Run::Tumble,
            "frames: native: yaw",
            |c| {
                edit(c, |_, f| f.angles = f.angles.map(|angle| angle / 2));
            },
        ),
        fault(
            "roll of the previous solution in frames",
            Run::Tumble,
            "frames: native: roll",
            |c| {
                let mut before = [0_i16; 2];
                edit(c, |index, f| {
                    if index == 0 {
                        before = [0; 2];
                    }
                    before = [before[1], f.angles[2]];
                    f.angles[2] = before[0];
                });
            },
        ),
        fault(
            "averages of tilt swapped in frames",
            Run::Tumble,
            "frames: native: average_tilt_x",
            |c| {
                edit(c, |_, f| f.averages.swap(0, 1));
            },
        ),
        fault(
            "averages of field swapped in frames",
            Run::Tumble,
            "frames: native: average_field_x",
            |c| {
                edit(c, |_, f| f.averages.swap(2, 3));
            },
        ),
        fault(
            "averages not sent",
            Run::Tumble,
            "frames: native: average_tilt_x",
            |c| {
                edit(c, |_, f| f.averages = [0; 5]);
            },
        ),
        fault(
            "one average one step off in frames",
            Run::Tumble,
            "frames: native: average_field_y",
            |c| {
                edit(c, |_, f| f.averages[3] += 2);
            },
        ),
        fault(
            "sequence steps by three",
            Run::Tumble,
            "frames: native: message 1 has the number 3",
            |c| {
                edit(c, |index, f| f.sequence = 3 * index as u16);
            },
        ),
        fault(
            "sequence starts at one",
            Run::Tumble,
            "frames: native: message 0 has the number 1",
            |c| {
                edit(c, |index, f| f.sequence = index as u16 + 1);
            },
        ),
        fault(
            "sequence stands still",
            Run::Tumble,
            "frames: native: message 1 has the number 0",
            |c| {
                edit(c, |_, f| f.sequence = 0);
            },
        ),
        fault(
            "check sum with another start",
            Run::Tumble,
            "frames: native: message 0 cannot be read: its check sum",
            |c| {
                each(c, |frames| frames.iter_mut().for_each(with_other_check_sum));
            },
        ),
        fault(
            "frames without delimiter",
            Run::Tumble,
            "frames: native: message 0 cannot be read: its last byte",
            |c| {
                each(c, |frames| {
                    for frame in frames {
                        frame.pop();
                    }
                });
            },
        ),
        fault(
            "a frame that is not COBS",
            Run::Tumble,
            "frames: native: message 7 cannot be read",
            |c| {
                each(c, |frames| frames[7] = vec![200, 1, 2, DELIMITER]);
            },
        ),
        fault(
            "a frame that both sides leave out",
            Run::Tumble,
            "frames: native: message 9 has the number 10",
            |c| {
                each(c, |frames| {
                    frames.remove(9);
                });
            },
        ),
        fault(
            "a frame that both sides send twice",
            Run::Tumble,
            "frames: native: message 10 has the number 9",
            |c| {
                each(c, |frames| frames.insert(9, frames[9].clone()));
            },
        ),
        fault(
            "no frame at all",
            Run::Tumble,
            "frames: none|device: ",
            |c| {
                each(c, Vec::clear);
            },
        ),
        fault(
            "DISTURBED never set",
            Run::Magnet,
            "status: disturbed of native",
            |c| {
                never(c, flags::DISTURBED);
            },
        ),
        fault(
            "HALF_SPACE never set",
            Run::Somersault,
            "status: half_space of native",
            |c| {
                never(c, flags::HALF_SPACE);
            },
        ),
        fault(
            "SATURATION never set",
            Run::Clipped,
            "status: saturation of native",
            |c| {
                never(c, flags::SATURATION);
            },
        ),
        fault("status word never set", Run::Magnet, "status: ", |c| {
            edit(c, |_, f| f.flags = 0);
        }),
        fault(
            "SATURATION set without reason",
            Run::Tumble,
            "status: saturation of native",
            |c| {
                sometimes(c, flags::SATURATION, 40);
            },
        ),
        fault(
            "DISTURBED set in half of the good solutions",
            Run::Tumble,
            "status: disturbed of native",
            |c| {
                sometimes(c, flags::DISTURBED, 2);
            },
        ),
        fault(
            "LATE set without reason",
            Run::Tumble,
            "status: late of native",
            |c| {
                sometimes(c, flags::LATE, 100);
            },
        ),
        fault(
            "UNCALIBRATED set with a good calibration",
            Run::Tumble,
            "status: uncalibrated of native",
            |c| {
                sometimes(c, flags::UNCALIBRATED, 1);
            },
        ),
        fault(
            "YAW_HELD set without reason",
            Run::Tumble,
            "status: yaw_held of native",
            |c| {
                sometimes(c, flags::YAW_HELD, 60);
            },
        ),
        fault(
            "DOMAIN set without reason",
            Run::Tumble,
            "status: domain of native",
            |c| {
                sometimes(c, flags::DOMAIN, 60);
            },
        ),
        fault(
            "HALF_SPACE set without reason",
            Run::Tumble,
            "status: half_space of native",
            |c| {
                sometimes(c, flags::HALF_SPACE, 60);
            },
        ),
        fault(
            "a status bit that the product does not have",
            Run::Tumble,
            "frames: native: message",
            |c| {
                sometimes(c, 1 << 15, 50);
            },
        ),
        fault(
            "status bits moved up by one",
            Run::Magnet,
            "status: ",
            |c| {
                edit(c, |_, f| f.flags <<= 1);
            },
        ),
        fault(
            "status of the previous solution",
            Run::Magnet,
            "status: ",
            |c| {
                let mut before = 0;
                edit(c, |index, f| {
                    let previous = if index == 0 { 0 } else { before };
                    before = f.flags;
                    f.flags = previous;
                });
            },
        ),
    ]
}
