//! What fails a run, and that it says where.

mod support;

use cardan_compare::{
    Chain, Comparison, EmulatorStatistics, Expectation, Frames, Limit, LinkStatistics, Node,
    Reason, Tolerance, TruthTolerance, Verdict, compare,
};
use cardan_golden::Angles;
use cardan_outputs::{Check, Is, Message, Outputs, Quantity, Status, StatusBit};
use cardan_spec::flags;
use cardan_units::HalfTurns;

const LSB: f64 = 1.0 / 1024.0;

fn node(name: &str, per_solution: usize, solutions: usize) -> Node {
    let native: Vec<i64> = (0..per_solution * solutions)
        .map(|sample| (sample as i64 * 37) % 1000 - 500)
        .collect();
    let real = native.iter().map(|&raw| raw as f64 * LSB + 0.3 * LSB);
    Node {
        name: name.into(),
        unit: "1".into(),
        per_solution,
        lsb: LSB,
        emulated: Some(native.clone()),
        real: Some(real.clone().collect()),
        golden: Some(real.map(|value| value + 0.1 * LSB).collect()),
        native,
        tolerance: Some(Tolerance {
            max_abs: 0.5 * LSB,
            reason: "one rounding".into(),
        }),
        ..Node::default()
    }
}

/// A run in which everything agrees: 8 solutions, the sixth flagged.
fn passing() -> Comparison {
    let frames: Vec<Vec<u8>> = (0..8).map(|index| vec![index, 1, 2, 0]).collect();
    let mut flags = vec![0; 8];
    flags[5] = flags::SATURATION.into();
    let mut own = node("product", 2, 8);
    own.golden = None;
    Comparison {
        nodes: vec![node("sample", 4, 8), node("yaw", 1, 8), own],
        frames: Frames {
            native: frames.clone(),
            emulated: frames,
        },
        flags,
        ..Comparison::default()
    }
}

fn reasons(comparison: &Comparison) -> Vec<Reason> {
    let report = compare(comparison);
    let expected = if report.reasons.is_empty() {
        Verdict::Pass
    } else {
        Verdict::Fail
    };
    assert_eq!(report.verdict, expected);
    report.reasons
}

fn only_reason(comparison: &Comparison) -> Reason {
    let mut reasons = reasons(comparison);
    assert_eq!(reasons.len(), 1, "{reasons:?}");
    reasons.remove(0)
}

#[test]
fn a_run_in_which_everything_agrees_passes() {
    assert_eq!(reasons(&passing()), []);
}

#[test]
fn a_tolerance_is_missed_at_the_first_value_beyond_it_in_a_solution_without_flags() {
    let mut comparison = passing();
    let golden = comparison.nodes[0].golden.as_mut().unwrap();
    golden[5 * 4] += 1.0; // flagged
    golden[6 * 4 + 3] += LSB;
    golden[7 * 4] += 2.0 * LSB;
    let Reason::ToleranceMissed { node, first, .. } = only_reason(&comparison) else {
        panic!("another reason");
    };
    assert_eq!(
        (node.as_str(), first.sample, first.solution),
        ("sample", 27, 6)
    );
    let report = compare(&comparison);
    let (failed, passed) = (&report.nodes[0], &report.nodes[1]);
    assert!(!failed.pass && passed.pass);
    let text = report.reasons[0].to_string();
    assert!(
        text.contains("node sample") && text.contains("solution 6"),
        "{text}"
    );
}

#[test]
fn a_node_that_golden_does_not_know_is_judged_against_the_real_interpretation() {
    let mut comparison = passing();
    comparison.nodes[2].real.as_mut().unwrap()[1] += LSB;
    let Reason::ToleranceMissed { node, against, .. } = only_reason(&comparison) else {
        panic!("another reason");
    };
    assert_eq!((node.as_str(), against), ("product", "real"));
}

#[test]
fn a_shared_node_is_not_judged_against_the_real_interpretation() {
    let mut comparison = passing();
    comparison.nodes[0].real.as_mut().unwrap()[1] += 1.0;
    assert_eq!(reasons(&comparison), []);
}

#[test]
fn a_value_that_is_not_a_number_misses_every_tolerance() {
    let mut comparison = passing();
    comparison.nodes[1].golden.as_mut().unwrap()[3] = f64::NAN;
    assert!(matches!(
        only_reason(&comparison),
        Reason::ToleranceMissed { first, .. } if first.sample == 3
    ));
}

#[test]
fn a_tolerance_with_nothing_to_judge_is_not_met() {
    let mut comparison = passing();
    comparison.flags = vec![flags::HALF_SPACE.into(); 8];
    let all = reasons(&comparison);
    assert_eq!(all.len(), 3);
    assert!(
        all.iter()
            .all(|reason| matches!(reason, Reason::NothingJudged { .. }))
    );
    let mut comparison = passing();
    comparison.nodes[0].golden = None;
    comparison.nodes[0].real = None;
    assert!(matches!(
        only_reason(&comparison),
        Reason::NothingJudged { .. }
    ));
}

#[test]
fn a_missing_value_is_a_mismatch_and_a_difference_of_lengths() {
    let mut comparison = passing();
    comparison.nodes[1].emulated.as_mut().unwrap().pop();
    let all = reasons(&comparison);
    assert!(matches!(
        &all[0],
        Reason::LengthsDiffer {
            lengths: [8, 7],
            ..
        }
    ));
    assert!(matches!(
        &all[1],
        Reason::BitsDiffer { mismatches: 1, compared: 7, first, .. }
            if first.sample == 7 && first.emulated.is_none()
    ));
    let mut comparison = passing();
    comparison.nodes[0].golden.as_mut().unwrap().push(0.0);
    assert!(matches!(
        only_reason(&comparison),
        Reason::LengthsDiffer { .. }
    ));
    let mut comparison = passing();
    comparison.flags.push(0);
    assert_eq!(
        reasons(&comparison).len(),
        3,
        "every node misses a solution"
    );
}

#[test]
fn values_beyond_the_last_complete_solution_are_compared_bit_by_bit_and_counted() {
    let mut comparison = passing();
    let node = &mut comparison.nodes[0];
    node.native.push(7);
    node.emulated.as_mut().unwrap().push(7);
    node.real.as_mut().unwrap().push(99.0);
    node.golden.as_mut().unwrap().push(99.0);
    let report = compare(&comparison);
    assert_eq!(report.reasons, []);
    assert_eq!(report.nodes[0].unfinished, 1);
    comparison.nodes[0].emulated.as_mut().unwrap()[32] = 8;
    assert!(matches!(
        only_reason(&comparison),
        Reason::BitsDiffer { first, .. } if first.sample == 32
    ));
}

#[test]
fn frames_that_differ_are_missing_or_absent_fail() {
    let mut comparison = passing();
    comparison.frames.emulated[4][1] ^= 0x80;
    let reason = only_reason(&comparison);
    assert!(matches!(&reason, Reason::FramesDiffer { first, .. } if first.frame == 4));
    assert!(reason.to_string().contains("04010200") && reason.to_string().contains("04810200"));
    let mut comparison = passing();
    comparison.frames.emulated.pop();
    assert!(matches!(
        only_reason(&comparison),
        Reason::FramesDiffer {
            mismatches: 1,
            compared: 7,
            ..
        }
    ));
    let mut comparison = passing();
    comparison.frames = Frames::default();
    assert_eq!(only_reason(&comparison), Reason::NoFrames);
}

#[test]
fn an_image_without_taps_is_compared_by_its_frames() {
    let mut comparison = passing();
    for node in &mut comparison.nodes {
        node.emulated = None;
    }
    let report = compare(&comparison);
    assert_eq!(report.verdict, Verdict::Pass);
    assert!(!report.taps);
    comparison.frames.emulated[0][0] ^= 1;
    assert!(matches!(
        only_reason(&comparison),
        Reason::FramesDiffer { .. }
    ));
}

#[test]
fn any_loss_or_lateness_fails() {
    let timing = |emulator: EmulatorStatistics| Comparison {
        emulator,
        ..passing()
    };
    let none = EmulatorStatistics::default;
    for (comparison, expected) in [
        (
            timing(EmulatorStatistics {
                late_conversions: 1,
                ..none()
            }),
            Reason::LateConversions(1),
        ),
        (
            timing(EmulatorStatistics {
                lost_conversions: 2,
                ..none()
            }),
            Reason::LostConversions(2),
        ),
        (
            timing(EmulatorStatistics {
                missed_deadlines: 3,
                ..none()
            }),
            Reason::MissedDeadlines(3),
        ),
        (
            Comparison {
                link: LinkStatistics {
                    lost: 4,
                    ..LinkStatistics::default()
                },
                ..passing()
            },
            Reason::MessagesLost(4),
        ),
    ] {
        assert_eq!(only_reason(&comparison), expected);
    }
}

#[test]
fn the_error_against_truth_is_judged_only_where_the_scenario_limits_it() {
    let angles = |degrees: f64| Angles {
        yaw: HalfTurns::from_degrees(degrees),
        ..Angles::default()
    };
    let mut comparison = passing();
    comparison.outputs.group = Some(support::group());
    comparison.chain = Chain::new(&support::STAGES, 3);
    let mut set = |is: Is, values: &dyn Fn() -> Option<Angles>| {
        let series = support::series_of((0..8).map(|_| values()));
        *comparison.chain.values_mut(is).unwrap() = series;
    };
    set(Is::Truth, &|| Some(angles(10.0)));
    set(Is::Native, &|| Some(angles(12.0)));
    assert_eq!(reasons(&comparison), []);
    comparison.truth_tolerance = Some(TruthTolerance {
        rms: Some(2.1),
        p99: None,
        max: Some(1.9),
    });
    assert!(matches!(
        only_reason(&comparison),
        Reason::TruthMissed {
            statistic: "max",
            ..
        }
    ));
    *comparison.chain.values_mut(Is::Truth).unwrap() = support::series_of([None; 8]);
    let of = "attitude".to_owned();
    assert_eq!(only_reason(&comparison), Reason::NoTruth { of });
}

#[test]
fn a_series_of_another_length_is_reported() {
    let mut comparison = passing();
    comparison.outputs.group = Some(support::group());
    comparison.chain = Chain::new(&support::STAGES, 3);
    let codes = support::series_of([Some(Angles::default()); 7]);
    *comparison.chain.values_mut(Is::Golden).unwrap() = codes;
    let reason = only_reason(&comparison);
    assert!(reason.to_string().contains("codes 7"), "{reason}");
}

/// A node whose differences from real are `errors` in steps, each expected with a deviation of one.
fn expected(errors: &[f64]) -> Comparison {
    let solutions = errors.len();
    let native: Vec<i64> = (0..solutions as i64).map(|at| at * 37 % 1000).collect();
    let real = native
        .iter()
        .zip(errors)
        .map(|(&raw, error)| (raw as f64 - error) * LSB);
    let node = Node {
        name: "square".into(),
        unit: "1".into(),
        per_solution: 1,
        lsb: LSB,
        real: Some(real.collect()),
        expected: Some(vec![
            Expectation {
                bias: 0.0,
                deviation: LSB,
            };
            solutions
        ]),
        native,
        ..Node::default()
    };
    let frames = vec![vec![1, 2, 0]; solutions];
    Comparison {
        nodes: vec![node],
        frames: Frames {
            native: frames.clone(),
            emulated: frames,
        },
        flags: vec![0; solutions],
        ..Comparison::default()
    }
}

/// Errors of one deviation, of either sign.
fn ordinary(solutions: usize) -> Vec<f64> {
    (0..solutions)
        .map(|at| if at % 2 == 0 { 1.0 } else { -1.0 })
        .collect()
}

#[test]
fn differences_that_rounding_explains_pass_and_tell_how_much_of_the_limit_they_take() {
    let report = compare(&expected(&ordinary(1000)));
    assert_eq!(report.verdict, Verdict::Pass);
    let found = report.nodes[0].real_vs_native.as_ref().expect("compared");
    let normalised = found.normalised.expect("has deviations");
    assert!((normalised.rms - 1.0).abs() < 1e-9 && normalised.bias.abs() < 1e-9);
    // 1 + sqrt(2 ln 1000) deviations are permitted.
    assert!((found.used.expect("judged") - 1.0 / 4.717).abs() < 1e-3);
    assert_eq!(
        found.limit.map(|limit| (limit / LSB * 1000.0).round()),
        Some(4718.0)
    );
}

#[test]
fn one_value_beyond_what_rounding_explains_is_named_with_its_place() {
    let mut errors = ordinary(1000);
    errors[321] = 5.0;
    let Reason::ToleranceMissed { node, first, .. } = only_reason(&expected(&errors)) else {
        panic!("another reason");
    };
    assert_eq!((node.as_str(), first.solution), ("square", 321));
}

#[test]
fn more_spread_and_more_bias_than_rounding_explains_are_named_as_such() {
    let wide: Vec<f64> = ordinary(1000).iter().map(|error| 2.0 * error).collect();
    let told = only_reason(&expected(&wide)).to_string();
    assert!(
        told.starts_with("node square: the root mean square"),
        "{told}"
    );
    let shifted: Vec<f64> = ordinary(1000)
        .iter()
        .map(|error| 0.2 * error + 1.2)
        .collect();
    let told = only_reason(&expected(&shifted)).to_string();
    assert!(told.starts_with("node square: the mean"), "{told}");
}

#[test]
fn a_value_without_a_bound_is_not_judged_and_a_node_of_such_values_does_not_pass() {
    let mut comparison = expected(&ordinary(4));
    let all = comparison.nodes[0].expected.as_mut().expect("has them");
    for value in all.iter_mut() {
        value.deviation = f64::INFINITY;
    }
    assert!(matches!(
        only_reason(&comparison),
        Reason::NothingJudged { .. }
    ));
}

/// A message of each solution with one quantity, the node `yaw`, and one status bit.
fn messages(solutions: usize) -> Comparison {
    let mut comparison = passing();
    comparison.outputs = Outputs {
        quantities: vec![Quantity {
            name: "yaw".into(),
            node: "yaw".into(),
            write: 0,
            unit: "1".into(),
            period: None,
            step: LSB,
            in_flagged: false,
        }],
        status: vec![StatusBit {
            name: "saturation".into(),
            mask: 1,
        }],
        sequence_modulus: 4,
        group: None,
    };
    let yaw: Vec<f64> = comparison.nodes[1].native_values().collect();
    let sent = (0..solutions).map(|at| {
        Ok(Message {
            sequence: at as u64 % 4,
            values: vec![yaw[at]],
            status: u32::from(at == 5),
        })
    });
    comparison.messages.native = sent.collect();
    comparison.messages.emulated = comparison.messages.native.clone();
    comparison.status = (0..solutions)
        .map(|at| Status {
            set: u32::from(at == 5),
            doubtful: 0,
        })
        .collect();
    comparison
}

fn sent(comparison: &mut Comparison, at: usize, change: impl Fn(&mut Message)) {
    for side in [
        &mut comparison.messages.native,
        &mut comparison.messages.emulated,
    ] {
        change(side[at].as_mut().expect("is readable"));
    }
}

#[test]
fn messages_that_say_what_golden_says_pass() {
    let report = compare(&messages(8));
    assert_eq!(report.reasons, []);
    assert_eq!(report.outputs[0].against.golden.samples, 7);
    assert!(
        report.outputs[0]
            .against
            .golden
            .max
            .is_some_and(|max| max <= 0.5 * LSB)
    );
}

#[test]
fn a_message_with_another_value_number_or_status_is_named_with_its_place() {
    let told = |change: &dyn Fn(&mut Comparison)| {
        let mut comparison = messages(8);
        change(&mut comparison);
        only_reason(&comparison).to_string()
    };
    let value = told(&|c| sent(c, 3, |message| message.values[0] += 3.0 * LSB));
    assert!(
        value.starts_with("frames: native: yaw of message 3 is "),
        "{value}"
    );
    let missing = told(&|c| sent(c, 3, |message| message.values.clear()));
    assert!(
        missing.starts_with("frames: native: yaw of message 3 is NaN"),
        "{missing}"
    );
    let number = told(&|c| sent(c, 6, |message| message.sequence = 6));
    assert_eq!(
        number,
        "frames: native: message 6 has the number 6, expected 2"
    );
    let bit = told(&|c| sent(c, 5, |message| message.status = 0));
    assert!(
        bit.starts_with("status: saturation of native differs from golden's in 1 solution"),
        "{bit}"
    );
    let unknown = told(&|c| sent(c, 2, |message| message.status = 8));
    assert!(
        unknown.starts_with("frames: native: message 2 has the status 0x0008"),
        "{unknown}"
    );
    let unreadable = told(&|c| {
        for side in [&mut c.messages.native, &mut c.messages.emulated] {
            side[4] = Err("its check sum is wrong".into());
        }
    });
    assert_eq!(
        unreadable,
        "frames: native: message 4 cannot be read: its check sum is wrong"
    );
    // A fault of the chip alone is the emulated side's.
    let chip = told(&|c| c.messages.emulated[1].as_mut().expect("is readable").status = 1);
    assert!(
        chip.starts_with("status: saturation of emulated differs"),
        "{chip}"
    );
}

#[test]
fn a_status_bit_that_rounding_decides_is_not_judged_unless_that_is_the_rule() {
    let mut comparison = messages(8);
    sent(&mut comparison, 5, |message| message.status = 0);
    comparison.status[5].doubtful = 1;
    assert_eq!(reasons(&comparison), []);
    for at in [0, 1] {
        comparison.status[at].doubtful = 1;
    }
    let told = only_reason(&comparison).to_string();
    assert!(
        told.starts_with("status: rounding decides saturation in 38 % of the solutions"),
        "{told}"
    );
}

#[test]
fn a_share_of_flagged_solutions_beyond_its_limit_fails() {
    let mut comparison = messages(8);
    let limit = |most| Limit {
        most,
        reason: "one of eight".into(),
    };
    comparison.most_flagged = Some(limit(0.125));
    assert_eq!(reasons(&comparison), []);
    comparison.most_flagged = Some(limit(0.12));
    let told = only_reason(&comparison).to_string();
    assert!(
        told.starts_with("status: 12 % of the solutions carry status bits"),
        "{told}"
    );
}

#[test]
fn a_stage_s_own_check_beyond_its_limits_comes_first() {
    let mut comparison = passing();
    comparison.nodes[0].emulated.as_mut().expect("has taps")[0] ^= 1;
    for value in [0.6, f64::NAN, -0.1] {
        comparison.checks = vec![Check {
            party: "controller".into(),
            what: "load".into(),
            value,
            least: 0.0,
            most: 0.5,
            unit: "1".into(),
            reason: "measured 0.3".into(),
        }];
        let all = reasons(&comparison);
        assert_eq!(all.len(), 2);
        assert!(
            all[0].to_string().starts_with("controller: load is "),
            "{}",
            all[0]
        );
    }
    comparison.checks[0].value = 0.5;
    assert_eq!(reasons(&comparison).len(), 1);
}
