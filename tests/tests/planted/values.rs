//! Faults in the values that participants compute: the firmware's on both sides, the chip's alone,
//! golden's.

use cardan::rig::Collected;
use cardan_firmware::nodes::NODES;
use cardan_spec::nodes::SHARED;

use crate::frames::edit;
use crate::{Fault, Run, fault};

pub(crate) fn node(name: &str) -> usize {
    let found = NODES.iter().position(|node| node.name == name);
    found.expect("a node of the firmware")
}

pub(crate) fn shared(name: &str) -> usize {
    let found = SHARED.iter().position(|node| node.name == name);
    found.expect("a node of golden's")
}

/// A node's words, changed on host and chip.
pub(crate) fn firmware(collected: &mut Collected, name: &str, change: impl Fn(usize, i64) -> i64) {
    for streams in [&mut collected.native, &mut collected.emulated] {
        let words = streams.get_mut(&node(name)).expect("was written");
        for (index, word) in words.iter_mut().enumerate() {
            *word = change(index, *word);
        }
    }
}

fn golden(collected: &mut Collected, name: &str, change: impl Fn(usize, f64) -> f64) {
    let values = collected
        .golden
        .get_mut(&shared(name))
        .expect("was written");
    for (index, value) in values.iter_mut().enumerate() {
        *value = change(index, *value);
    }
}

fn chip<'a>(collected: &'a mut Collected, name: &str) -> &'a mut Vec<i64> {
    collected
        .emulated
        .get_mut(&node(name))
        .expect("was written")
}

pub(crate) fn faults() -> Vec<Fault> {
    let mut all = firmware_faults();
    all.extend(chip_faults());
    all.extend(golden_faults());
    all
}

fn firmware_faults() -> Vec<Fault> {
    let mut all = vec![
        fault("yaw 0.195 degrees off", Run::Tumble, "node yaw:", |c| {
            firmware(c, "yaw", |_, word| word + 35);
            edit(c, |_, f| f.angles[0] = f.angles[0].wrapping_add(35));
        }),
        fault("pitch 0.02 degrees off", Run::Tumble, "node pitch:", |c| {
            firmware(c, "pitch", |_, word| word + 4);
            edit(c, |_, f| f.angles[1] += 4);
        }),
        fault("roll of twice its noise", Run::Tumble, "node roll:", |c| {
            firmware(c, "roll", |index, word| {
                word + if index % 2 == 0 { 4 } else { -4 }
            });
        }),
        fault("yaw stands still", Run::Tumble, "node yaw:", |c| {
            firmware(c, "yaw", |_, _| 1000);
        }),
        fault(
            "one yaw of the whole run is wrong",
            Run::Tumble,
            "node yaw:",
            |c| {
                firmware(
                    c,
                    "yaw",
                    |index, word| if index == 200 { word + 400 } else { word },
                );
            },
        ),
        fault(
            "the exact average loses its last places",
            Run::Tumble,
            "node average:",
            |c| {
                firmware(c, "average", |_, word| word & !7);
            },
        ),
        fault(
            "samples are one step too low",
            Run::Tumble,
            "node sample:",
            |c| {
                firmware(c, "sample", |_, word| word - 1);
            },
        ),
    ];
    // Nodes that golden does not have are held against the real interpretation.
    for name in [
        "square",
        "sin_roll",
        "level_x",
        "level_cos",
        "cross_1",
        "weight_x",
        "residual",
        "vertical_sum",
        "asin_sum",
        "down_square",
    ] {
        let title: &'static str =
            Box::leak(format!("{name}, which golden lacks, is four steps off").into_boxed_str());
        let expected: &'static str = Box::leak(format!("node {name}:").into_boxed_str());
        all.push(Fault::new(title, Run::Tumble, expected, move |c| {
            // Wide words are exact products: their operands' places count, not their own.
            let step = if NODES[node(name)].format.word > 16 {
                1 << 18
            } else {
                4
            };
            firmware(c, name, |_, word| word + step);
        }));
    }
    all
}

fn chip_faults() -> Vec<Fault> {
    vec![
        fault(
            "one bit of one word of the chip",
            Run::Tumble,
            "node tilt_x: native and emulated differ in 1 value",
            |c| {
                chip(c, "tilt_x")[100] ^= 1;
            },
        ),
        fault(
            "a word that the chip does not publish",
            Run::Tumble,
            "node pitch: native and emulated differ|node pitch: lengths",
            |c| {
                chip(c, "pitch").pop();
            },
        ),
        fault(
            "a word that the chip publishes twice",
            Run::Tumble,
            "node weight_1: native and emulated differ|node weight_1: lengths",
            |c| {
                let words = chip(c, "weight_1");
                words.insert(5, words[5]);
            },
        ),
        fault(
            "two nodes of the chip exchanged",
            Run::Tumble,
            "node cos_1: native and emulated differ",
            |c| {
                let cos_1 = chip(c, "cos_1").clone();
                let cos_2 = std::mem::replace(chip(c, "cos_2"), cos_1);
                *chip(c, "cos_1") = cos_2;
            },
        ),
        fault(
            "one bit of one frame of the chip",
            Run::Tumble,
            "frames: emulated: message 33 cannot be read: its check sum",
            |c| {
                c.emulated_frames[33][5] ^= 0x40;
            },
        ),
        fault(
            "a frame that the chip does not send",
            Run::Tumble,
            "frames: native and emulated differ|device: gave",
            |c| {
                c.emulated_frames.pop();
            },
        ),
        fault(
            "frames of the chip alone with swapped angles",
            Run::Plain,
            "frames: native and emulated differ",
            |c| {
                let native = c.native_frames.clone();
                edit(c, |_, f| f.angles.swap(1, 2));
                c.native_frames = native;
            },
        ),
    ]
}

fn golden_faults() -> Vec<Fault> {
    let mut all = Vec::new();
    for name in [
        "tilt_x",
        "tilt_y",
        "field_x",
        "field_y",
        "cos_1",
        "cos_2",
        "down",
        "heading_cos_1",
        "heading_sin_2",
        "yaw",
        "pitch",
        "roll",
        "weight_1",
        "dip_product",
        "field_z_square",
    ] {
        let title: &'static str =
            Box::leak(format!("golden's {name} is 0.0002 off").into_boxed_str());
        let expected: &'static str = Box::leak(format!("node {name}:").into_boxed_str());
        all.push(Fault::new(title, Run::Tumble, expected, move |c| {
            golden(c, name, |_, value| value + 2e-4)
        }));
    }
    all.extend([
        fault(
            "golden's yaw has the other sign",
            Run::Tumble,
            "node yaw:",
            |c| {
                golden(c, "yaw", |_, value| -value);
            },
        ),
        fault(
            "golden's pitch is not a number once",
            Run::Tumble,
            "node pitch:",
            |c| {
                golden(
                    c,
                    "pitch",
                    |index, value| if index == 12 { f64::NAN } else { value },
                );
            },
        ),
        fault(
            "golden leaves a solution out",
            Run::Tumble,
            "node roll: lengths",
            |c| {
                c.golden
                    .get_mut(&shared("roll"))
                    .expect("was written")
                    .pop();
            },
        ),
        fault(
            "golden's status is always clear",
            Run::Magnet,
            "status: ",
            |c| {
                for status in &mut c.golden_status {
                    status.set = 0;
                }
            },
        ),
        fault(
            "golden's status is missing",
            Run::Tumble,
            "status flags: lengths",
            |c| {
                c.golden_status.truncate(10);
            },
        ),
        fault(
            "the real interpretation doubts everything",
            Run::Tumble,
            "status: rounding decides",
            |c| {
                for status in &mut c.real_status {
                    status.doubtful = u32::MAX;
                }
            },
        ),
        fault(
            "the real interpretation is missing",
            Run::Tumble,
            "node ",
            |c| {
                for values in c.real.values_mut() {
                    values.truncate(3);
                }
            },
        ),
    ]);
    all
}
