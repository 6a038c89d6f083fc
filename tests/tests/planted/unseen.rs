//! Faults where nothing looked once: streams that end early or are not there, what flagged solutions hold,
//! messages that are not the device's own values, single conversions, and small faults of the front end under
//! noise.

use cardan::rig::Collected;
use cardan_bench::Conversion;

use crate::frames::edit;
use crate::values::{firmware, node, shared};
use crate::{Fault, Run, fault};

/// Steps of the converter per volt.
const LSB_PER_V: f64 = 1024.0 / 5.0;
/// Conversions that come before the first solution (12 blocks of 64), and in a solution.
const WARM_UP: usize = 768;
const PER_SOLUTION: usize = 64;

/// Whether either side flags a solution.
fn flagged(collected: &Collected) -> Vec<bool> {
    let golden = collected.golden_status.iter().map(|status| status.set != 0);
    let decoded = collected.native_frames.iter().map(|bytes| {
        let frame = cardan_golden::frame::decode(bytes).expect("whole");
        frame.status != 0
    });
    golden
        .zip(decoded)
        .map(|(golden, native)| golden || native)
        .collect()
}

pub(crate) fn faults() -> Vec<Fault> {
    let mut all = ends();
    all.extend(missing());
    all.extend(in_flagged());
    all.extend(own_words());
    all.extend(conversions());
    all.extend(front_end());
    all
}

/// The device stops, or counts what cannot be.
fn ends() -> Vec<Fault> {
    vec![
        fault(
            "the device stops at a block's end after half of the run",
            Run::Tumble,
            "device: gave",
            |c| {
                let solutions = c.native_frames.len() / 2;
                c.conversions.truncate(WARM_UP + PER_SOLUTION * solutions);
                c.instants.truncate(solutions);
                for streams in [&mut c.native, &mut c.emulated] {
                    for words in streams.values_mut() {
                        words.truncate(words.len() / (2 * solutions) * solutions);
                    }
                }
                for values in c.real.values_mut().chain(c.golden.values_mut()) {
                    values.truncate(values.len() / (2 * solutions) * solutions);
                }
                for values in c.expected.values_mut() {
                    values.truncate(values.len() / (2 * solutions) * solutions);
                }
                for values in c.stages.values_mut().flatten() {
                    values.truncate(solutions);
                }
                for frames in [&mut c.native_frames, &mut c.emulated_frames] {
                    frames.truncate(solutions);
                }
                c.emulated_frame_cycles.truncate(solutions);
                c.real_status.truncate(solutions);
                c.golden_status.truncate(solutions);
            },
        ),
        fault(
            "every message a second late",
            Run::Tumble,
            "device: longest time",
            |c| {
                for cycle in &mut c.emulated_frame_cycles {
                    *cycle += 16_000_000;
                }
            },
        ),
        fault(
            "no message has a time",
            Run::Tumble,
            "device: longest time",
            |c| c.emulated_frame_cycles.clear(),
        ),
        fault(
            "late conversions that nobody counted",
            Run::Tumble,
            "controller: late conversions",
            |c| {
                for conversion in c.conversions.iter_mut().step_by(7) {
                    conversion.late = true;
                }
            },
        ),
        fault(
            "lost conversions that nobody counted",
            Run::Tumble,
            "controller: lost conversions",
            |c| c.conversions[2000].lost = true,
        ),
        fault(
            "the core sleeps longer than it runs",
            Run::Tumble,
            "controller: share of the time awake",
            |c| c.tail.emulated.sleeping_cycles = 10 * c.tail.emulated.cycles,
        ),
        fault("no stack", Run::Tumble, "controller: stack", |c| {
            c.tail.emulated.stack_peak = 0;
        }),
        fault(
            "half of the run's cycles",
            Run::Tumble,
            "device: length of the run|controller: share",
            |c| c.tail.emulated.cycles /= 2,
        ),
    ]
}

/// What should be there is not.
fn missing() -> Vec<Fault> {
    vec![
        fault(
            "golden gives no status",
            Run::Tumble,
            "status flags: lengths",
            |c| c.golden_status.clear(),
        ),
        fault(
            "nobody says what rounding explains",
            Run::Tumble,
            "node sample: lengths",
            |c| c.expected.clear(),
        ),
        fault(
            "rounding explains ten times too much",
            Run::Tumble,
            "nodes: the differences of all nodes",
            |c| {
                for expected in c.expected.values_mut().flatten() {
                    expected.deviation *= 10.0;
                }
            },
        ),
        fault(
            "native leaves a node out",
            Run::Tumble,
            "node tilt_x: lengths",
            |c| {
                c.native.remove(&node("tilt_x"));
            },
        ),
        fault(
            "host and chip leave a node out",
            Run::Tumble,
            "node tilt_x: lengths",
            |c| {
                c.native.remove(&node("tilt_x"));
                c.emulated.remove(&node("tilt_x"));
            },
        ),
        fault(
            "golden leaves a node out",
            Run::Tumble,
            "node cos_1: lengths",
            |c| {
                c.golden.remove(&shared("cos_1"));
            },
        ),
        fault(
            "the truth is known in one solution of a hundred",
            Run::Tumble,
            "attitude: tolerance.truth is set, but the truth is known in",
            |c| {
                for values in c.stages.get_mut(&0).expect("the truth") {
                    for (at, value) in values.iter_mut().enumerate() {
                        if at % 100 != 0 {
                            *value = f64::NAN;
                        }
                    }
                }
            },
        ),
    ]
}

/// Values of solutions that carry a status bit.
fn in_flagged() -> Vec<Fault> {
    vec![
        fault(
            "frames of flagged solutions tell no angles",
            Run::Somersault,
            "frames: native: yaw",
            |c| {
                let flagged = flagged(c);
                edit(c, |at, f| {
                    if flagged[at] {
                        f.angles = [0; 3];
                    }
                });
            },
        ),
        fault(
            "averages of flagged solutions tell other codes",
            Run::Somersault,
            "node average:",
            |c| {
                let flagged = flagged(c);
                firmware(c, "average", |sample, word| {
                    word + if flagged[sample / 4] { 100 << 6 } else { 0 }
                });
            },
        ),
        fault(
            "samples of flagged solutions are others",
            Run::Somersault,
            "node sample:",
            |c| {
                let flagged = flagged(c);
                firmware(c, "sample", |sample, word| {
                    word + if flagged[sample / PER_SOLUTION] {
                        100
                    } else {
                        0
                    }
                });
            },
        ),
    ]
}

/// Messages that are not the words of the device's own nodes.
fn own_words() -> Vec<Fault> {
    vec![
        fault(
            "yaw in frames three steps up",
            Run::Tumble,
            "frames: native: yaw",
            |c| edit(c, |_, f| f.angles[0] = f.angles[0].wrapping_add(3)),
        ),
        fault(
            "pitch in frames two steps up",
            Run::Tumble,
            "frames: native: pitch",
            |c| edit(c, |_, f| f.angles[1] = f.angles[1].wrapping_add(2)),
        ),
        fault(
            "yaw in frames without its last bit",
            Run::Tumble,
            "frames: native: yaw",
            |c| edit(c, |_, f| f.angles[0] &= !1),
        ),
        fault(
            "averages in frames one step up",
            Run::Tumble,
            "frames: native: average",
            |c| {
                edit(c, |_, f| {
                    for average in &mut f.averages {
                        *average += 1;
                    }
                });
            },
        ),
    ]
}

/// A few conversions of the run.
fn conversions() -> Vec<Fault> {
    const CONVERTER: &str = "converter: largest";
    let one = |name, change: fn(&mut Conversion)| {
        Fault::new(name, Run::Tumble, CONVERTER, move |c: &mut Collected| {
            change(&mut c.conversions[4000]);
        })
        .recomputed()
    };
    vec![
        one("one code of the run 60 steps up", |c| {
            c.code = (c.code + 60).min(1023)
        }),
        one("one code of the run 30 steps down", |c| {
            c.code = c.code.saturating_sub(30)
        }),
        one("one code of the run at the end of the scale", |c| {
            c.code = 1023
        }),
        one("one code of the run is 0", |c| c.code = 0),
        Fault::new(
            "a channel holds more than its supply",
            Run::Tumble,
            "sensors and front end: |converter: largest",
            |c: &mut Collected| {
                for conversion in &mut c.conversions {
                    if conversion.channel == 0 {
                        conversion.ideal_volts = 6.0;
                    }
                }
            },
        )
        .recomputed(),
    ]
}

/// Voltages and codes of a channel, changed alike: `change` gives what is added, in steps, from the place of the
/// conversion among all of them and its voltage in steps from the middle.
fn moved(
    name: &'static str,
    expected: &'static str,
    channel: Option<u8>,
    change: impl Fn(usize, f64) -> f64 + Send + Sync + 'static,
) -> Fault {
    Fault::new(name, Run::Tumble, expected, move |c: &mut Collected| {
        for (at, conversion) in c.conversions.iter_mut().enumerate() {
            if channel.is_some_and(|channel| channel != conversion.channel) {
                continue;
            }
            let lsb = change(at, (conversion.ideal_volts - 2.5) * LSB_PER_V);
            conversion.ideal_volts += lsb / LSB_PER_V;
            let code = (f64::from(conversion.code) + lsb).round();
            conversion.code = code.clamp(0.0, 1023.0) as u16;
        }
    })
    .recomputed()
}

fn front_end() -> Vec<Fault> {
    const GAIN: &str = "sensors and front end: gain";
    const PEAK: &str = "sensors and front end: largest mean";
    let disturbed = |at: usize, from: usize, solutions: usize| {
        let first = WARM_UP + from * PER_SOLUTION;
        (first..first + solutions * PER_SOLUTION).contains(&at)
    };
    vec![
        moved("tilt_x loses 2 % of its gain", GAIN, Some(0), |_, lsb| {
            -0.02 * lsb
        }),
        moved("tilt_y loses 3 % of its gain", GAIN, Some(1), |_, lsb| {
            -0.03 * lsb
        }),
        moved(
            "field_x gains 3 %",
            "sensors and front end: ",
            Some(2),
            |_, lsb| 0.03 * lsb,
        ),
        moved(
            "tilt_y is off by 80 steps in four solutions",
            PEAK,
            Some(1),
            move |at, _| if disturbed(at, 300, 4) { 80.0 } else { 0.0 },
        ),
        moved(
            "field_y is off by 80 steps in one solution",
            PEAK,
            Some(3),
            move |at, _| if disturbed(at, 300, 1) { 80.0 } else { 0.0 },
        ),
        Fault::new(
            "all channels are 16 ms late",
            Run::Tumble,
            "sensors and front end: delay|sensors and front end: gain",
            |c: &mut Collected| {
                // 32 rounds of the four channels.
                for at in (128..c.conversions.len()).rev() {
                    let before = c.conversions[at - 128];
                    c.conversions[at].code = before.code;
                    c.conversions[at].ideal_volts = before.ideal_volts;
                }
            },
        )
        .recomputed(),
    ]
}
