//! Laws: the budget adds up, metrics equal a naive computation, one flipped bit is always found.

use cardan_compare::{
    Attitudes, Comparison, Frames, Node, Reason, RoundingStep, Series, Tolerance, Verdict, compare,
};
use cardan_golden::{Angles, rotation_angle, set_1_matrix};
use cardan_units::HalfTurns;
use proptest::prelude::*;

fn angles() -> impl Strategy<Value = Angles> {
    (-1.0..1.0f64, -0.5..0.5f64, -1.0..1.0f64).prop_map(|(yaw, pitch, roll)| Angles {
        yaw: HalfTurns(yaw),
        pitch: HalfTurns(pitch),
        roll: HalfTurns(roll),
    })
}

fn series(solutions: usize) -> impl Strategy<Value = Series> {
    prop::collection::vec(prop::option::weighted(0.9, angles()), solutions).prop_map(Series)
}

fn full(solutions: usize) -> impl Strategy<Value = Series> {
    prop::collection::vec(angles(), solutions).prop_map(Series::from_iter)
}

const SOLUTIONS: usize = 30;

fn attitudes() -> impl Strategy<Value = Attitudes> {
    (
        series(SOLUTIONS),
        series(SOLUTIONS),
        [
            full(SOLUTIONS),
            full(SOLUTIONS),
            full(SOLUTIONS),
            full(SOLUTIONS),
            full(SOLUTIONS),
            full(SOLUTIONS),
        ],
    )
        .prop_map(
            |(truth, direct, [experienced, ideal, codes, real, deployed, step])| Attitudes {
                truth,
                direct,
                experienced,
                ideal,
                codes,
                real,
                emulated: deployed.clone(),
                deployed,
                rounding_steps: vec![RoundingStep {
                    node: "tilt_x".into(),
                    attitudes: step,
                }],
            },
        )
}

fn flags() -> impl Strategy<Value = Vec<u16>> {
    prop::collection::vec(prop_oneof![3 => Just(0u16), 1 => 1u16..128], SOLUTIONS)
}

fn with(attitudes: Attitudes, flags: Vec<u16>) -> Comparison {
    let frames = vec![vec![0u8; 22]; SOLUTIONS];
    Comparison {
        attitudes,
        flags,
        frames: Frames {
            native: frames.clone(),
            emulated: frames,
        },
        ..Comparison::default()
    }
}

fn close(left: f64, right: f64) -> bool {
    (left - right).abs() <= 1e-12 * (1.0 + left.abs().max(right.abs()))
}

proptest! {
    #[test]
    fn the_parts_of_the_budget_add_up_to_the_whole_error(
        attitudes in attitudes(), flags in flags(),
    ) {
        let known = (0..SOLUTIONS)
            .filter(|&at| flags[at] == 0)
            .filter(|&at| attitudes.truth.at(at).is_some() && attitudes.direct.at(at).is_some())
            .count();
        let report = compare(&with(attitudes, flags));
        let detail = &report.error_budget_detail;
        prop_assert_eq!(detail.closure_samples, known as u64);
        prop_assert!(detail.closure_deg.is_none_or(|open| open < 1e-9));
        prop_assert_eq!(detail.closure_deg.is_some(), known > 0);
        prop_assert_eq!(detail.parts.len(), 7);
        let unflagged = report.unflagged_solutions > 0;
        prop_assert_eq!(report.error_budget.compiled, unflagged.then_some(0.0));
        prop_assert_eq!(report.verdict, Verdict::Pass);
    }

    #[test]
    fn each_part_is_the_rms_of_the_rotation_between_its_series(
        attitudes in attitudes(), flags in flags(),
    ) {
        let report = compare(&with(attitudes.clone(), flags.clone()));
        let naive = |from: &Series, to: &Series| {
            let squares: Vec<f64> = (0..SOLUTIONS)
                .filter(|&at| flags[at] == 0)
                .filter_map(|at| Some((from.at(at)?, to.at(at)?)))
                .map(|(a, b)| rotation_angle(&set_1_matrix(a), &set_1_matrix(b)).degrees().powi(2))
                .collect();
            (!squares.is_empty())
                .then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
        };
        let budget = report.error_budget;
        for (part, from, to) in [
            (budget.latency, &attitudes.truth, &attitudes.direct),
            (budget.motion, &attitudes.direct, &attitudes.experienced),
            (budget.sensor_frontend, &attitudes.experienced, &attitudes.ideal),
            (budget.adc, &attitudes.ideal, &attitudes.codes),
            (budget.algorithm, &attitudes.codes, &attitudes.real),
            (budget.rounding, &attitudes.real, &attitudes.deployed),
        ] {
            let expected = naive(from, to);
            prop_assert_eq!(part.is_some(), expected.is_some());
            prop_assert!(part.zip(expected).is_none_or(|(part, naive)| close(part, naive)));
        }
        let steps = &attitudes.rounding_steps[0].attitudes;
        let shares = &report.error_budget_detail.rounding_shares;
        prop_assert_eq!(shares.len(), 2);
        for (share, (from, to)) in shares
            .iter()
            .zip([(&attitudes.real, steps), (steps, &attitudes.deployed)])
        {
            let expected = naive(from, to);
            prop_assert_eq!(share.rms_deg.is_some(), expected.is_some());
            prop_assert!(share.rms_deg.zip(expected).is_none_or(|(a, b)| close(a, b)));
        }
        let whole = naive(&attitudes.truth, &attitudes.emulated);
        let total = report.attitude.and_then(|attitude| attitude.total.rms_deg);
        prop_assert_eq!(whole.is_some(), total.is_some());
        prop_assert!(whole.zip(total).is_none_or(|(a, b)| close(a, b)));
    }

    #[test]
    fn metrics_equal_a_naive_computation(
        values in prop::collection::vec((-512i64..512, -2.0..2.0f64), 1..200),
        per_solution in 1usize..5, wrap: bool, seed: u64,
    ) {
        let lsb = 1.0 / 512.0;
        let native: Vec<i64> = values.iter().map(|(raw, _)| *raw).collect();
        let golden: Vec<f64> = values.iter().map(|(raw, off)| *raw as f64 * lsb + off).collect();
        let solutions = native.len() / per_solution;
        let flags: Vec<u16> = (0..solutions).map(|at| u16::from(seed >> (at % 64) & 3 == 0)).collect();
        let differences: Vec<(f64, f64)> = (0..native.len())
            .filter(|at| flags.get(at / per_solution) == Some(&0))
            .map(|at| {
                let plain = native[at] as f64 * lsb - golden[at];
                let turned = [plain, plain - 2.0, plain + 2.0];
                let short = turned.into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap();
                (if wrap { short } else { plain }, golden[at])
            })
            .collect();
        let node = Node {
            name: "n".into(),
            unit: if wrap { "half_turn" } else { "1" }.into(),
            per_solution,
            lsb,
            golden: Some(golden),
            emulated: Some(native.clone()),
            native,
            ..Node::default()
        };
        let report = compare(&Comparison { nodes: vec![node], flags, ..Comparison::default() });
        let found = report.nodes[0].golden_vs_native.clone().unwrap();
        let count = differences.len();
        prop_assert_eq!(found.samples, count as u64);
        prop_assert_eq!(report.nodes[0].native_vs_emulated.as_ref().unwrap().mismatches, 0);
        if count == 0 {
            prop_assert_eq!(found.max_abs, None);
            return Ok(());
        }
        let power = |values: &mut dyn Iterator<Item = f64>| values.map(|x| x * x).sum::<f64>();
        let error = power(&mut differences.iter().map(|(d, _)| *d));
        let signal = power(&mut differences.iter().map(|(_, g)| *g));
        let max = differences.iter().map(|(d, _)| d.abs()).fold(0.0, f64::max);
        let bias = differences.iter().map(|(d, _)| d).sum::<f64>() / count as f64;
        prop_assert!(close(found.max_abs.unwrap(), max));
        prop_assert!(close(found.rms.unwrap(), (error / count as f64).sqrt()));
        prop_assert!(wrap || close(found.bias.unwrap(), bias));
        prop_assert!(close(found.max_lsb.unwrap(), max / lsb));
        if error > 0.0 && signal > 0.0 {
            prop_assert!(close(found.sqnr_db.unwrap(), 10.0 * (signal / error).log10()));
        } else {
            prop_assert_eq!(found.sqnr_db, None);
        }
    }

    #[test]
    fn one_flipped_bit_is_found_at_its_node_and_sample(
        streams in prop::collection::vec(prop::collection::vec(-32768i64..32768, 40), 1..6),
        node in any::<prop::sample::Index>(), sample in 0usize..40, bit in 0u32..16,
        flagged: bool,
    ) {
        let at = node.index(streams.len());
        let nodes: Vec<Node> = streams
            .iter()
            .enumerate()
            .map(|(index, native)| {
                let mut emulated = native.clone();
                if index == at {
                    emulated[sample] ^= 1 << bit;
                }
                Node {
                    name: format!("node {index}"),
                    per_solution: 4,
                    lsb: 1.0,
                    golden: Some(native.iter().map(|&raw| raw as f64).collect()),
                    tolerance: Some(Tolerance { max_abs: 0.0, reason: String::new() }),
                    native: native.clone(),
                    emulated: Some(emulated),
                    ..Node::default()
                }
            })
            .collect();
        let frames = vec![vec![1u8]];
        // Even a solution that is not judged against golden must have equal bits.
        let mut flags = vec![0; 10];
        flags[sample / 4] = u16::from(flagged);
        let report = compare(&Comparison {
            nodes,
            flags,
            frames: Frames { native: frames.clone(), emulated: frames },
            ..Comparison::default()
        });
        prop_assert_eq!(report.verdict, Verdict::Fail);
        prop_assert_eq!(report.reasons.len(), 1);
        let Reason::BitsDiffer { node, mismatches, first, .. } = &report.reasons[0] else {
            panic!("another reason");
        };
        prop_assert_eq!(node, &format!("node {at}"));
        prop_assert_eq!((*mismatches, first.sample, first.solution), (1, sample, sample / 4));
        let native = streams[at][sample];
        prop_assert_eq!((first.native, first.emulated), (Some(native), Some(native ^ 1 << bit)));
        for (index, node) in report.nodes.iter().enumerate() {
            prop_assert_eq!(node.pass, index != at);
        }
    }
}
