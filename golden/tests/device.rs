//! The golden model as a device: conversions in, nodes and solutions out, and every status bit.

mod common;

use cardan_golden::solve::{Memory, solve_readings};
use cardan_golden::{Golden, Readings, Solution, codes_of, ideal_readings, node, rotation_angle};
use cardan_spec::calibration::Calibration;
use cardan_spec::nodes::SHARED;
use cardan_spec::timing::{Averaging, BLOCK_CONVERSIONS, BLOCK_ROUNDS, WARM_UP_BLOCKS};
use cardan_spec::{Channel, DOMAIN_MARGIN, flags};
use common::{EARTH, attitude};
use proptest::prelude::*;

fn calibration() -> Calibration {
    Calibration::nominal(46.2, EARTH.horizontal, EARTH.vertical)
}

/// Feeds `solutions` times the same four codes; `clip` is the conversion that is marked as clipped.
fn run(
    codes: [f64; 4],
    solutions: usize,
    clip: Option<usize>,
) -> (Vec<Solution>, Vec<(usize, f64)>) {
    let mut golden = Golden::new(&calibration());
    let (mut solved, mut written) = (Vec::new(), Vec::new());
    for conversion in 0..solutions * BLOCK_CONVERSIONS {
        let channel = Channel::ALL[conversion % 4];
        solved.extend(golden.convert(
            channel,
            codes[channel as usize],
            clip == Some(conversion),
            &mut |index, value| written.push((index, value)),
        ));
    }
    (solved, written)
}

fn of(readings: Readings) -> Solution {
    solve_readings(&readings, EARTH, &mut Memory::default(), &mut |_, _| {})
}

#[test]
fn the_warm_up_is_ignored_and_then_each_solution_takes_its_number_of_conversions() {
    let (solved, written) = run([1.0, 2.0, 3.0, 4.0], WARM_UP_BLOCKS, None);
    assert!(solved.is_empty() && written.is_empty());
    let (solved, _) = run([1.0, 2.0, 3.0, 4.0], WARM_UP_BLOCKS + 3, None);
    assert_eq!(solved.len(), 3);
}

#[test]
fn every_node_is_written_in_signal_order_as_often_as_it_is_declared() {
    let (_, written) = run([10.0, -20.0, 30.0, -40.0], WARM_UP_BLOCKS + 1, None);
    for (index, shared) in SHARED.iter().enumerate() {
        let writes = written.iter().filter(|(at, _)| *at == index).count();
        let expected = shared.per_solution(Averaging::DEFAULT);
        assert_eq!(writes, expected, "{}", shared.name);
    }
    let after_the_sums = &written[2 * BLOCK_CONVERSIONS..];
    assert!(after_the_sums.is_sorted_by_key(|(index, _)| index));
}

#[test]
fn sums_and_averages_are_those_of_each_channel() {
    let codes = [10.0, -20.0, 30.0, -40.0];
    let (_, written) = run(codes, WARM_UP_BLOCKS + 2, None);
    let values = |index: usize| {
        let of_node = written.iter().filter(move |(at, _)| *at == index);
        of_node.map(|(_, value)| *value).collect::<Vec<_>>()
    };
    let sums = values(node::ACCUMULATOR);
    for (write, sum) in sums.iter().enumerate() {
        let turn = write % BLOCK_CONVERSIONS / 4 + 1;
        assert_eq!(*sum, codes[write % 4] * turn as f64);
    }
    assert_eq!(
        values(node::AVERAGE)[4..],
        codes.map(|code| code / 512.0),
        "{BLOCK_ROUNDS} conversions each"
    );
}

#[test]
fn an_average_takes_the_last_conversions_of_a_period_and_no_other() {
    for (log2, period_log2) in [(0, 4), (3, 5), (4, 6), (6, 6), (5, 8), (8, 8)] {
        let averaging = Averaging::new(log2, period_log2).unwrap();
        let mut golden = Golden::with_averaging(&calibration(), averaging);
        let mut written = Vec::new();
        let settled = WARM_UP_BLOCKS * BLOCK_CONVERSIONS;
        let mut solved = 0;
        for conversion in 0..settled + 2 * averaging.conversions() {
            let round = conversion.saturating_sub(settled) / 4 % averaging.period();
            let code = (round * round % 997) as f64 - 500.0;
            let channel = Channel::ALL[conversion % 4];
            let solution = golden.convert(channel, code, false, &mut |at, value| {
                written.push((at, value));
            });
            solved += usize::from(solution.is_some());
        }
        assert_eq!(solved, 2);
        let rounds = averaging.period() - averaging.length()..averaging.period();
        let sum: f64 = rounds.map(|k| (k * k % 997) as f64 - 500.0).sum();
        let values = |node: usize| written.iter().filter(move |(at, _)| *at == node);
        for (_, average) in values(node::AVERAGE) {
            assert_eq!(*average, sum / averaging.length() as f64 / 512.0);
        }
        for (index, shared) in SHARED.iter().enumerate() {
            let expected = 2 * shared.per_solution(averaging);
            assert_eq!(values(index).count(), expected, "{}", shared.name);
        }
    }
}

#[test]
fn exact_codes_give_the_attitude_back() {
    let truth = attitude(-123.0, 31.0, -44.0);
    let codes = codes_of(&ideal_readings(&truth, EARTH), &calibration()).unwrap();
    let (solved, _) = run(codes, WARM_UP_BLOCKS + 2, None);
    assert_eq!(solved.len(), 2);
    for solution in solved {
        assert!(rotation_angle(&solution.attitude, &truth).degrees() < 1e-9);
        assert_eq!(solution.flags, 0);
    }
}

/// Upside down from the first solution: four readings read that as upright, a comparator does not.
#[test]
fn what_a_third_axis_at_the_comparator_tells_holds_for_every_solution() {
    let truth = attitude(20.0, 10.0, -170.0);
    let codes = codes_of(&ideal_readings(&truth, EARTH), &calibration()).unwrap();
    let error = |told: Option<bool>| {
        let mut golden = Golden::new(&calibration());
        golden.third_tilt(told);
        let conversions = (0..(WARM_UP_BLOCKS + 2) * BLOCK_CONVERSIONS).map(|at| at % 4);
        let solved: Vec<Solution> = conversions
            .filter_map(|at| golden.convert(Channel::ALL[at], codes[at], false, &mut |_, _| {}))
            .collect();
        let errors = solved.iter().map(|solution| {
            assert_eq!(solution.flags & flags::HALF_SPACE, 0);
            rotation_angle(&solution.attitude, &truth).degrees()
        });
        errors.collect::<Vec<f64>>()
    };
    for (told, most) in [(Some(true), 0.0..1e-9), (None, 90.0..181.0)] {
        let errors = error(told);
        assert_eq!(errors.len(), 2);
        assert!(
            errors.iter().all(|error| most.contains(error)),
            "{told:?}: {errors:?}"
        );
    }
}

#[test]
fn one_clipped_conversion_flags_its_own_solution_and_no_other() {
    let first = WARM_UP_BLOCKS * BLOCK_CONVERSIONS;
    let clip = first + BLOCK_CONVERSIONS + 17;
    let (solved, _) = run([1.0, 2.0, 180.0, 4.0], WARM_UP_BLOCKS + 3, Some(clip));
    let saturated: Vec<bool> = solved
        .iter()
        .map(|solution| solution.flags & flags::SATURATION != 0)
        .collect();
    assert_eq!(saturated, [false, true, false]);
    let (solved, _) = run([1.0; 4], WARM_UP_BLOCKS + 1, Some(first - 1));
    assert_eq!(solved[0].flags & flags::SATURATION, 0, "warm-up is ignored");
}

#[test]
fn a_heading_cosine_beyond_one_is_noise_within_the_margin_and_flagged_beyond_it() {
    let level = |cosine: f64| Readings {
        tilt: [0.0, 0.0],
        field: [EARTH.horizontal * cosine, 0.0],
    };
    for (cosine, flagged) in [
        (1.0 + 0.9 * DOMAIN_MARGIN, false),
        (-1.0 - 0.9 * DOMAIN_MARGIN, false),
        (1.0 + 1.1 * DOMAIN_MARGIN, true),
    ] {
        let solution = of(level(cosine));
        assert_eq!(solution.flags & flags::DOMAIN != 0, flagged, "{cosine}");
        let expected = if cosine > 0.0 { 0.0 } else { -1.0 };
        assert_eq!(solution.yaw.wrapped().0, expected);
    }
}

#[test]
fn ninety_degrees_of_tilt_is_a_zero_divisor_and_flagged() {
    for tilt in [[1.0, 0.0], [0.0, -1.0], [1.0, 1.0], [0.8, 0.7]] {
        let solution = of(Readings {
            tilt,
            field: [0.3, -0.2],
        });
        assert_ne!(solution.flags & flags::DOMAIN, 0, "{tilt:?}");
        assert_ne!(solution.flags & flags::HALF_SPACE, 0, "{tilt:?}");
    }
}

#[test]
fn a_field_that_the_calibration_does_not_explain_is_flagged_as_disturbed() {
    let readings = ideal_readings(&attitude(0.0, 0.0, 0.0), EARTH);
    assert_eq!(of(readings).flags & flags::DISTURBED, 0);
    let disturbed = Readings {
        field: [readings.field[0] + 0.3, readings.field[1]],
        ..readings
    };
    assert_ne!(of(disturbed).flags & flags::DISTURBED, 0);
}

#[test]
fn where_east_nearly_meets_body_z_the_last_defined_yaw_is_repeated() {
    let mut memory = Memory::default();
    let mut solve =
        |readings: &Readings| solve_readings(readings, EARTH, &mut memory, &mut |_, _| {});
    let defined = attitude(50.0, 10.0, -20.0);
    let east_down = |roll: f64| attitude(0.0, 0.0, roll);
    let first = solve(&ideal_readings(&east_down(88.0), EARTH));
    assert_ne!(first.flags & flags::YAW_HELD, 0);
    assert_eq!(first.yaw.0, 0.0, "before any yaw was defined it is 0");
    let before = solve(&ideal_readings(&defined, EARTH));
    assert_eq!(before.flags & flags::YAW_HELD, 0);
    let held = solve(&ideal_readings(&east_down(88.0), EARTH));
    assert_ne!(held.flags & flags::YAW_HELD, 0);
    assert_eq!(held.yaw, before.yaw);
    assert!((held.roll.degrees() - 88.0).abs() < 1e-9);
    let east_up_at_80_degrees = solve(&ideal_readings(&east_down(80.0), EARTH));
    assert_eq!(east_up_at_80_degrees.flags & flags::YAW_HELD, 0);
}

proptest! {
    #[test]
    fn every_operation_is_total_on_any_readings(
        tilt in prop::array::uniform2(-1.5..1.5f64), field in prop::array::uniform2(-2.0..2.0f64),
        edge in prop::sample::select(vec![0.0, 1.0, -1.0]), pick in 0usize..5,
    ) {
        let mut readings = Readings { tilt, field };
        if pick < 2 {
            readings.tilt[pick] = edge;
        } else if pick < 4 {
            readings.field[pick - 2] = edge;
        }
        let solution = solve_readings(
            &readings, EARTH, &mut Memory::default(),
            &mut |index, value| assert!(value.is_finite(), "{}", SHARED[index].name),
        );
        prop_assert!(solution.attitude.iter().all(|value| value.is_finite()));
        prop_assert!((-1.0..1.0).contains(&solution.yaw.0));
    }
}
