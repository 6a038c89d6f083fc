//! Faults before and around the firmware: sensors, front end, converter, truth, controller, link. What
//! lies before the firmware changes the conversions, from which firmware and golden model are run
//! again: they agree with each other, and only the stage's own checks can tell.

use cardan::rig::Collected;
use cardan_bench::Conversion;

use crate::{Fault, Run, fault};

/// Steps of the converter per volt.
const LSB_PER_V: f64 = 1024.0 / 5.0;

/// A fault that changes every conversion.
fn conversions(
    name: &'static str,
    expected: &'static str,
    change: impl Fn(&mut Conversion) + Send + Sync + 'static,
) -> Fault {
    let change = move |c: &mut Collected| c.conversions.iter_mut().for_each(&change);
    Fault::new(name, Run::Tumble, expected, change).recomputed()
}

/// Both what the converter holds and what it makes of it move by this many steps.
fn shift(conversion: &mut Conversion, channel: u8, lsb: f64) {
    if conversion.channel == channel {
        conversion.ideal_volts += lsb / LSB_PER_V;
        let code = f64::from(conversion.code) + lsb.round();
        conversion.code = code.clamp(0.0, 1023.0) as u16;
    }
}

/// A pair of channels wired to each other's pins.
fn crossed(name: &'static str, expected: &'static str, first: usize) -> Fault {
    let change = move |c: &mut Collected| {
        for round in c.conversions.chunks_exact_mut(4) {
            let (x, y) = (round[first], round[first + 1]);
            (round[first].code, round[first + 1].code) = (y.code, x.code);
            (round[first].ideal_volts, round[first + 1].ideal_volts) =
                (y.ideal_volts, x.ideal_volts);
        }
    };
    Fault::new(name, Run::Tumble, expected, change).recomputed()
}

pub(crate) fn faults() -> Vec<Fault> {
    let mut all = sensors();
    all.extend(converter());
    all.extend(truth());
    all.extend(controller());
    all
}

fn sensors() -> Vec<Fault> {
    const FRONT: &str = "sensors and front end: |error budget, sensor_frontend";
    let mut all = vec![
        crossed("field x and y wired to each other's pins", FRONT, 2),
        crossed("tilt x and y wired to each other's pins", FRONT, 0),
        conversions("all channels lose a tenth of their gain", FRONT, |c| {
            let centred = (c.ideal_volts - 2.5) * 0.9;
            c.ideal_volts = 2.5 + centred;
            c.code = ((f64::from(c.code) - 511.5) * 0.9 + 511.5).round() as u16;
        }),
        conversions("voltages of another moment", FRONT, |c| {
            // Ideal sensors are told of another attitude than the device was in.
            c.experienced_code = -c.experienced_code;
        }),
    ];
    for (channel, name) in ["tilt_x", "tilt_y", "field_x", "field_y"]
        .into_iter()
        .enumerate()
    {
        let title: &'static str =
            Box::leak(format!("{name} with its polarity inverted").into_boxed_str());
        all.push(conversions(title, FRONT, move |c| {
            if usize::from(c.channel) == channel {
                c.ideal_volts = 5.0 - c.ideal_volts;
                c.code = 1023 - c.code;
            }
        }));
        let title: &'static str = Box::leak(format!("49 mV on {name}").into_boxed_str());
        all.push(conversions(title, FRONT, move |c| {
            shift(c, channel as u8, 10.0)
        }));
    }
    all
}

fn converter() -> Vec<Fault> {
    vec![
        conversions(
            "ideal voltages 50 mV too high",
            "sensors and front end: |converter: ",
            |c| {
                c.ideal_volts += 0.05;
            },
        ),
        conversions(
            "the converter gives one code more",
            "converter: mean",
            |c| {
                c.code = (c.code + 1).min(1023);
            },
        ),
        conversions(
            "the converter measures against 4.75 V",
            "converter: ",
            |c| {
                c.code = (f64::from(c.code) * 5.0 / 4.75).min(1023.0) as u16;
            },
        ),
        conversions("the converter's last bit is stuck", "converter: ", |c| {
            c.code |= 1
        }),
        conversions(
            "the converter's last three bits are stuck",
            "converter: ",
            |c| c.code &= !7,
        ),
        conversions("the converter's noise is trebled", "converter: ", |c| {
            let noise = if c.sequence / 4 % 2 == 0 { 2 } else { -2 };
            c.code = c.code.saturating_add_signed(noise).min(1023);
        }),
        Fault::new(
            "each code is that of the channel before",
            Run::Tumble,
            "converter: ",
            |c| {
                for at in (1..c.conversions.len()).rev() {
                    c.conversions[at].code = c.conversions[at - 1].code;
                }
            },
        )
        .recomputed(),
    ]
}

/// Yaw, pitch and roll of the true attitude, in half turns, solution by solution.
fn true_angles(collected: &mut Collected) -> &mut Vec<Vec<f64>> {
    let angles = collected.stages.get_mut(&0).expect("the first stage");
    assert_eq!(angles.len(), 3, "yaw, pitch, roll");
    angles
}

fn truth() -> Vec<Fault> {
    vec![
        fault(
            "truth is told 96 ms late",
            Run::Tumble,
            "truth: |error budget, latency",
            |c| {
                for angles in true_angles(c) {
                    angles.rotate_right(12);
                }
            },
        ),
        fault(
            "output instants 100 ms late",
            Run::Tumble,
            "truth: largest difference of the output instants",
            |c| {
                for instant in &mut c.instants {
                    instant.time_s += 0.1;
                }
            },
        ),
        fault(
            "output instants one conversion late",
            Run::Tumble,
            "truth: largest difference of the output instants",
            |c| {
                for instant in &mut c.instants {
                    instant.time_s += 125e-6;
                }
            },
        ),
        fault(
            "pitch and roll of the truth swapped",
            Run::Tumble,
            "error budget, latency",
            |c| {
                true_angles(c).swap(1, 2);
            },
        ),
        fault(
            "yaw of the truth counted the other way",
            Run::Tumble,
            "error budget, latency",
            |c| {
                for yaw in &mut true_angles(c)[0] {
                    *yaw = -*yaw;
                }
            },
        ),
        fault(
            "yaw of the truth half a degree off",
            Run::Tumble,
            "error budget, latency",
            |c| {
                for yaw in &mut true_angles(c)[0] {
                    *yaw += 0.5 / 180.0;
                }
            },
        ),
        fault(
            "a truth too few",
            Run::Tumble,
            "values along the chain: lengths",
            |c| {
                for angles in true_angles(c) {
                    angles.pop();
                }
            },
        ),
    ]
}

fn controller() -> Vec<Fault> {
    vec![
        fault(
            "the core never sleeps",
            Run::Tumble,
            "controller: share of the time awake",
            |c| {
                c.tail.emulated.sleeping_cycles = 0;
            },
        ),
        fault(
            "an interrupt waits 400 cycles",
            Run::Tumble,
            "controller: longest interrupt latency",
            |c| {
                c.tail.emulated.isr_latency_max_cycles = 400;
            },
        ),
        fault(
            "the stack meets the data",
            Run::Tumble,
            "controller: stack",
            |c| {
                c.tail.emulated.stack_peak = 1600;
            },
        ),
        fault(
            "one late conversion",
            Run::Tumble,
            "timing: 1 conversion taken late",
            |c| {
                c.tail.emulated.late_conversions = 1;
            },
        ),
        fault(
            "one lost conversion",
            Run::Tumble,
            "timing: 1 conversion lost",
            |c| {
                c.tail.emulated.lost_conversions = 1;
            },
        ),
        fault(
            "one missed deadline",
            Run::Tumble,
            "timing: 1 deadline missed",
            |c| {
                c.tail.emulated.missed_deadlines = 1;
            },
        ),
        fault(
            "one edge off its schedule",
            Run::Tumble,
            "1 event off the design's schedule",
            |c| {
                c.tail.emulated.mistimed = 1;
                c.tail.emulated.first_mistimed = Some("a strobe edge".to_owned());
            },
        ),
        fault(
            "one message lost on the link",
            Run::Tumble,
            "link: 1 message lost",
            |c| c.tail.lost = 1,
        ),
    ]
}
