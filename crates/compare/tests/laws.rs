//! Laws: the budget adds up, metrics equal a naive computation, one flipped bit is always found.

mod support;

use cardan_compare::{
    Chain, Comparison, Frames, Judge, Node, Planned, Reason, RoundingStep, Series, Tolerance,
    Verdict, compare,
};
use cardan_golden::{Angles, rotation_angle, set_1_matrix};
use cardan_outputs::Outputs;
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
    prop::collection::vec(prop::option::weighted(0.9, angles()), solutions)
        .prop_map(support::series_of)
}

fn full(solutions: usize) -> impl Strategy<Value = Series> {
    prop::collection::vec(angles(), solutions)
        .prop_map(|all| support::series_of(all.into_iter().map(Some)))
}

const SOLUTIONS: usize = 30;

fn chain() -> impl Strategy<Value = Chain> {
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
            |(truth, direct, [experienced, ideal, codes, real, deployed, step])| {
                let emulated = deployed.clone();
                let steps = vec![RoundingStep {
                    node: "tilt_x".into(),
                    values: step,
                }];
                let stages = [
                    truth,
                    direct,
                    experienced,
                    ideal,
                    codes,
                    real,
                    deployed,
                    emulated,
                ];
                support::chain(stages, steps)
            },
        )
}

fn flags() -> impl Strategy<Value = Vec<u32>> {
    prop::collection::vec(prop_oneof![3 => Just(0u32), 1 => 1u32..128], SOLUTIONS)
}

fn with(chain: Chain, flags: Vec<u32>) -> Comparison {
    let frames = vec![vec![0u8; 22]; SOLUTIONS];
    Comparison {
        chain,
        flags,
        outputs: Outputs {
            group: Some(support::group()),
            ..Outputs::default()
        },
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
        chain in chain(), flags in flags(),
    ) {
        let known = (0..SOLUTIONS)
            .filter(|&at| flags[at] == 0)
            .filter(|&at| chain.stages[..2].iter().all(|stage| stage.values.at(at).is_some()))
            .count();
        let report = compare(&with(chain, flags));
        let detail = &report.error_budget_detail;
        prop_assert_eq!(detail.closure_samples, known as u64);
        prop_assert!(detail.closure.is_none_or(|open| open < 1e-9));
        prop_assert_eq!(detail.closure.is_some(), known > 0);
        prop_assert_eq!(detail.parts.len(), 7);
        // Shares add to the whole, however the parts are correlated.
        let shares: Option<f64> = detail.parts.iter().map(|part| part.share).sum();
        prop_assert!(known == 0 || shares.is_some_and(|sum| (sum - 1.0).abs() < 1e-9), "{:?}", shares);
        let unflagged = report.unflagged_solutions > 0;
        prop_assert_eq!(report.error_budget.part("compiled"), unflagged.then_some(0.0));
        prop_assert_eq!(report.verdict, Verdict::Pass);
    }

    #[test]
    fn each_part_is_the_rms_of_the_rotation_between_its_series(
        chain in chain(), flags in flags(),
    ) {
        let report = compare(&with(chain.clone(), flags.clone()));
        let stage = |at: usize| &chain.stages[at].values;
        let naive = |from: &Series, to: &Series| {
            let squares: Vec<f64> = (0..SOLUTIONS)
                .filter(|&at| flags[at] == 0)
                .filter_map(|at| Some((from.at(at)?, to.at(at)?)))
                .map(|(a, b)| [a, b].map(|values| set_1_matrix(support::angles(values))))
                .map(|[a, b]| rotation_angle(&a, &b).degrees().powi(2))
                .collect();
            (!squares.is_empty())
                .then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
        };
        let budget = report.error_budget;
        let names = ["latency", "motion", "sensor_frontend", "adc", "algorithm", "rounding"];
        for (at, name) in names.into_iter().enumerate() {
            let (part, from, to) = (budget.part(name), stage(at), stage(at + 1));
            let expected = naive(from, to);
            prop_assert_eq!(part.is_some(), expected.is_some());
            prop_assert!(part.zip(expected).is_none_or(|(part, naive)| close(part, naive)));
        }
        let steps = &chain.steps[0].values;
        let shares = &report.error_budget_detail.rounding_shares;
        prop_assert_eq!(shares.len(), 2);
        for (share, (from, to)) in shares
            .iter()
            .zip([(stage(5), steps), (steps, stage(6))])
        {
            let expected = naive(from, to);
            prop_assert_eq!(share.size.rms.is_some(), expected.is_some());
            prop_assert!(share.size.rms.zip(expected).is_none_or(|(a, b)| close(a, b)));
        }
        let whole = naive(stage(0), stage(7));
        let total = report.truth.and_then(|errors| errors.whole()?.rms);
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
        let flags: Vec<u32> = (0..solutions).map(|at| u32::from(seed >> (at % 64) & 3 == 0)).collect();
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
        flags[sample / 4] = u32::from(flagged);
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
    #[test]
    fn windows_of_any_length_give_the_report_of_the_whole_run(
        solutions in 1usize..120, lengths in prop::collection::vec(1usize..40, 1..8), broken: bool,
    ) {
        let mut comparison = support::comparison(solutions);
        if broken {
            let at = solutions / 2;
            comparison.nodes[15].emulated.as_mut().unwrap()[at] ^= 1 << 3;
            comparison.nodes[13].golden.as_mut().unwrap()[at] += 0.5;
            comparison.frames.emulated[at][2] ^= 8;
        }
        let either = comparison.flags.iter().zip(&comparison.status).map(|(a, b)| a | b.set);
        let planned = Planned {
            solutions,
            judged: either.filter(|&word| word == 0).count(),
        };
        let expected = serde_json::to_string(&compare(&comparison)).unwrap();
        let mut left = comparison.clone();
        let mut judge = Judge::new(&left.facts(), planned, false);
        for length in lengths.into_iter().chain([solutions]) {
            judge.add(&left.take(length));
        }
        let (report, _) = judge.finish(&comparison.facts());
        prop_assert_eq!(serde_json::to_string(&report).unwrap(), expected);
    }
}
