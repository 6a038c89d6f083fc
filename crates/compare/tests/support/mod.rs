//! A run as the bench would deliver it, small but whole: a tumble through the golden model, with a
//! deployed participant that rounds every node and slow sensors before the converter.

#![allow(dead_code, reason = "each test program uses a part of it")]

use cardan_compare::{
    Assumed, Chain, Comparison, EmulatorStatistics, Format, Frames, LinkStatistics, Messages, Node,
    Reproduce, RoundingStep, Run, Series, Tolerance,
};
use cardan_golden::{
    Angles, Attitude, EarthField, Golden, Solution, angles_of, codes_of, ideal_readings,
    rotation_angle, set_1_matrix,
};
use cardan_outputs::{Combined, Group, Is, Member, Outputs, Shown, Stage, Status, StatusBit};
use cardan_spec::calibration::Calibration;
use cardan_spec::nodes::SHARED;
use cardan_spec::timing::{Averaging, BLOCK_CONVERSIONS, WARM_UP_BLOCKS};
use cardan_spec::{Channel, flags};
use cardan_units::HalfTurns;

const SOLUTION_SECONDS: f64 = 0.008;

fn truth(seconds: f64) -> Attitude {
    let turn = |hertz: f64, phase: f64| libm::sin(std::f64::consts::TAU * hertz * seconds + phase);
    set_1_matrix(Angles {
        yaw: HalfTurns::from_degrees(40.0 * seconds),
        pitch: HalfTurns::from_degrees(45.0 * turn(0.21, 0.4)),
        roll: HalfTurns::from_degrees(50.0 * turn(0.13, 0.0)),
    })
}

/// Solutions of one golden run, and its node values per shared node.
struct Golden64 {
    solutions: Vec<Solution>,
    nodes: Vec<Vec<f64>>,
}

/// Feeds golden with `code(conversion, channel, seconds)`.
fn golden(
    solutions: usize,
    calibration: &Calibration,
    mut code: impl FnMut(usize, Channel, f64) -> f64,
) -> Golden64 {
    let mut golden = Golden::new(calibration);
    let mut run = Golden64 {
        solutions: Vec::new(),
        nodes: vec![Vec::new(); SHARED.len()],
    };
    for conversion in 0..(WARM_UP_BLOCKS + solutions) * BLOCK_CONVERSIONS {
        let channel = Channel::ALL[conversion % 4];
        let from_start = conversion as f64 / BLOCK_CONVERSIONS as f64;
        let seconds = (from_start - WARM_UP_BLOCKS as f64) * SOLUTION_SECONDS;
        let code = code(conversion, channel, seconds);
        let nodes = &mut run.nodes;
        run.solutions
            .extend(golden.convert(channel, code, false, &mut |index, value| {
                nodes[index].push(value);
            }));
    }
    run
}

/// Three angles of an attitude, followed along the chain.
pub(crate) fn group() -> Group {
    let member = |name: &str| Member {
        name: name.into(),
        node: name.into(),
        scale: 180.0,
        period: Some(2.0),
    };
    Group {
        key: "attitude".into(),
        title: "Attitude".into(),
        note: String::new(),
        member: "angle".into(),
        unit: Shown {
            suffix: "deg".into(),
            symbol: "°".into(),
            words: "degrees".into(),
        },
        members: ["yaw", "pitch", "roll"].map(member).into(),
        combined: Some(Combined {
            name: "total".into(),
            what: "rotation".into(),
            error: rotation,
        }),
    }
}

pub(crate) fn angles(values: &[f64]) -> Angles {
    Angles {
        yaw: HalfTurns(values[0]),
        pitch: HalfTurns(values[1]),
        roll: HalfTurns(values[2]),
    }
}

fn rotation(values: &[f64], references: &[f64]) -> f64 {
    let (value, reference) = (angles(values), angles(references));
    if value == reference {
        return 0.0;
    }
    rotation_angle(&set_1_matrix(value), &set_1_matrix(reference)).degrees()
}

/// The stages of the chain.
pub(crate) const STAGES: [Stage; 8] = [
    Stage::new(Is::Truth, "truth", "", "", ""),
    Stage::new(Is::Model, "direct", "latency", "Latency and skew", ""),
    Stage::new(Is::Model, "experienced", "motion", "Motion", ""),
    Stage::new(
        Is::Model,
        "ideal",
        "sensor_frontend",
        "Sensor and front end",
        "",
    ),
    Stage::new(Is::Golden, "codes", "adc", "ADC", ""),
    Stage::new(Is::Real, "real", "algorithm", "Algorithm", ""),
    Stage::new(Is::Native, "deployed", "rounding", "Rounding", ""),
    Stage::new(Is::Emulated, "emulated", "compiled", "Compiled code", ""),
];

/// The chain of all stages with these values.
pub(crate) fn chain(values: [Series; 8], steps: Vec<RoundingStep>) -> Chain {
    let mut chain = Chain::new(&STAGES, 3);
    for (stage, values) in chain.stages.iter_mut().zip(values) {
        stage.values = values;
    }
    chain.steps = steps;
    chain
}

pub(crate) fn series_of(angles: impl IntoIterator<Item = Option<Angles>>) -> Series {
    let values = |angles: Angles| [angles.yaw.0, angles.pitch.0, angles.roll.0];
    Series::of(3, angles.into_iter().map(|angles| angles.map(values)))
}

fn series(solutions: &[Solution]) -> Series {
    series_of(solutions.iter().map(|solution| Some(solution.angles())))
}

/// The same angles on a grid of 2^-bits half turns.
fn rounded(series: &Series, bits: i32) -> Series {
    let step = f64::from(2f32.powi(-bits));
    let round = |angle: HalfTurns| HalfTurns((angle.0 / step).round() * step);
    let each = (0..series.len()).map(|at| series.at(at).map(angles));
    series_of(each.map(|found| {
        found.map(|angles| Angles {
            yaw: round(angles.yaw),
            pitch: round(angles.pitch),
            roll: round(angles.roll),
        })
    }))
}

fn frac(unit: &str) -> i32 {
    match unit {
        "lsb" => 0,
        "half_turn" => 15,
        _ => 13,
    }
}

fn nodes(golden: &Golden64) -> Vec<Node> {
    let mut nodes: Vec<Node> = SHARED
        .iter()
        .zip(&golden.nodes)
        .map(|(shared, values)| {
            let frac = frac(shared.unit);
            let lsb = f64::from(2f32.powi(-frac));
            let native: Vec<i64> = values
                .iter()
                .map(|value| (value / lsb).floor() as i64)
                .collect();
            Node {
                name: shared.name.into(),
                unit: shared.unit.into(),
                per_solution: shared.per_solution(Averaging::DEFAULT),
                format: Some(Format {
                    word: 16,
                    frac,
                    rounding: "floor".into(),
                    overflow: "saturate".into(),
                }),
                lsb,
                emulated: Some(native.clone()),
                real: Some(values.clone()),
                golden: Some(values.clone()),
                native,
                expected: None,
                overflows: 0,
                allowance: None,
                tuned: None,
                meaning: format!("what {} is", shared.name),
                inputs: Vec::new(),
                operations: Vec::new(),
                position: None,
                writes: Vec::new(),
                tolerance: Some(Tolerance {
                    max_abs: if frac == 0 { 0.0 } else { 1.5 * lsb },
                    reason: "one rounding down, and half a step of the reference".into(),
                }),
            }
        })
        .collect();
    let own = Node {
        name: "asin_term_1".into(),
        unit: "1".into(),
        golden: None,
        ..nodes[7].clone()
    };
    nodes.insert(10, own);
    nodes
}

/// The product's status bits, without any quantity.
pub(crate) fn status_bits() -> Outputs {
    Outputs {
        quantities: Vec::new(),
        status: flags::NAMES
            .iter()
            .map(|&(mask, name)| StatusBit {
                name: name.into(),
                mask: mask.into(),
            })
            .collect(),
        sequence_modulus: 1 << 16,
        group: Some(group()),
    }
}

/// The run; `solutions` of 8 ms.
pub(crate) fn comparison(solutions: usize) -> Comparison {
    let (horizontal, vertical) = (0.510_087_9, 0.860_122_3);
    let calibration = Calibration::nominal(46.2, horizontal, vertical);
    let earth = EarthField {
        horizontal,
        vertical,
    };
    let ideal_code = |channel: Channel, seconds: f64| {
        let readings = ideal_readings(&truth(seconds), earth);
        codes_of(&readings, &calibration).expect("the nominal matrices have inverses")
            [channel as usize]
    };
    let slow = |channel: Channel, seconds: f64| {
        (0..8)
            .map(|lag| ideal_code(channel, seconds - 0.0005 * f64::from(lag)))
            .sum::<f64>()
            / 8.0
    };
    let half = 0.5 * SOLUTION_SECONDS;
    let direct = golden(solutions, &calibration, |_, channel, at| {
        ideal_code(channel, at)
    });
    let ideal = golden(solutions, &calibration, |_, channel, at| slow(channel, at));
    let codes = golden(solutions, &calibration, |at, channel, seconds| {
        let dither = (at * 7919 % 1000) as f64 / 1000.0 - 0.5;
        (slow(channel, seconds) + dither).round()
    });
    let flags: Vec<u32> = (0..solutions)
        .map(|at| {
            let d3 = codes.nodes[9][at];
            let low = u16::from(d3 < 0.55) * flags::HALF_SPACE;
            (low | (u16::from(at % 611 == 300) * flags::DISTURBED)).into()
        })
        .collect();
    let frames: Vec<Vec<u8>> = (0..solutions)
        .map(|at| {
            (at as u16)
                .to_le_bytes()
                .into_iter()
                .chain([0; 20])
                .collect()
        })
        .collect();
    let real = series(&codes.solutions);
    let deployed = rounded(&real, 12);
    let nodes = nodes(&codes);
    Comparison {
        run: Run {
            app: "attitude".into(),
            scenario: "tumble".into(),
            seed: 1,
            session: "a1b2c3".into(),
            seconds: solutions as f64 * SOLUTION_SECONDS,
            samples: ((WARM_UP_BLOCKS + solutions) * BLOCK_CONVERSIONS) as u64,
            solution_seconds: SOLUTION_SECONDS,
        },
        nodes,
        frames: Frames {
            native: frames.clone(),
            emulated: frames,
        },
        outputs: status_bits(),
        messages: Messages::default(),
        status: flags
            .iter()
            .map(|&set| Status { set, doubtful: 0 })
            .collect(),
        checks: Vec::new(),
        stage_limits: Vec::new(),
        stale: None,
        tuned: None,
        most_flagged: None,
        flags,
        chain: chain(
            [
                series_of(
                    (0..solutions)
                        .map(|at| Some(angles_of(&truth(at as f64 * SOLUTION_SECONDS + half)))),
                ),
                series(&direct.solutions),
                series(&direct.solutions),
                series(&ideal.solutions),
                series(&codes.solutions),
                real.clone(),
                deployed.clone(),
                deployed,
            ],
            [("tilt_x", 15), ("cos_1", 14), ("yaw", 13)]
                .map(|(node, bits)| RoundingStep {
                    node: node.into(),
                    values: rounded(&real, bits),
                })
                .into(),
        ),
        output_limits: Vec::new(),
        required: None,
        truth_tolerance: None,
        widening: 1.0,
        emulator: EmulatorStatistics {
            cycles: solutions as u64 * 128_000,
            instructions: solutions as u64 * 41_000,
            realtime_factor: 18.4,
            cpu_load: 0.372,
            stack_peak: Some(212),
            isr_latency_max_cycles: 61,
            ..EmulatorStatistics::default()
        },
        link: LinkStatistics {
            messages: 5210,
            bytes: 18_302_144,
            lost: 0,
        },
        assumed: vec![
            Assumed {
                name: "magnetometer.quality".into(),
                value: "100".into(),
                reason: "Q in air is not published; 10 ms response allows at most 503".into(),
            },
            Assumed {
                name: "frontend.lna.noise_nv_rthz".into(),
                value: "8 nV/√Hz".into(),
                reason: "typical of a CMOS instrumentation amplifier".into(),
            },
        ],
        reproduce: Reproduce {
            command: "cardan compare --scenario tumble --seconds 10 --seed 1".into(),
            provenance: vec![
                ("cardan".into(), "0.1.0".into()),
                ("image".into(), "sha256 5f2c…".into()),
            ],
        },
    }
}
