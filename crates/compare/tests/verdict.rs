//! What fails a run, and that it says where.

use cardan_compare::{
    Comparison, EmulatorStatistics, Frames, LinkStatistics, Node, Reason, Tolerance,
    TruthTolerance, Verdict, compare,
};
use cardan_golden::Angles;
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
    flags[5] = flags::SATURATION;
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
    comparison.flags = vec![flags::HALF_SPACE; 8];
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
    comparison.attitudes.truth = (0..8).map(|_| angles(10.0)).collect();
    comparison.attitudes.deployed = (0..8).map(|_| angles(12.0)).collect();
    assert_eq!(reasons(&comparison), []);
    comparison.truth_tolerance = Some(TruthTolerance {
        rms_deg: Some(2.1),
        p99_deg: None,
        max_deg: Some(1.9),
    });
    assert!(matches!(
        only_reason(&comparison),
        Reason::TruthMissed {
            statistic: "max",
            ..
        }
    ));
    comparison.attitudes.truth = (0..8).map(|_| None).collect();
    assert_eq!(only_reason(&comparison), Reason::NoTruth);
}

#[test]
fn a_series_of_another_length_is_reported() {
    let mut comparison = passing();
    comparison.attitudes.codes = (0..7).map(|_| Angles::default()).collect();
    let reason = only_reason(&comparison);
    assert!(reason.to_string().contains("golden on codes 7"), "{reason}");
}
