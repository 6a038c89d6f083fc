//! Every status bit that the golden model computes, at its limit from both sides; motion's memory; and the
//! attitudes of a measured third tilt axis.

mod common;

use cardan_golden::half_space::Vertical;
use cardan_golden::solve::{Memory, Third, solve_readings};
use cardan_golden::{
    Attitude, EarthField, Readings, Solution, ideal_readings, node, rotation_angle,
};
use cardan_spec::timing::Averaging;
use cardan_spec::{
    ACCELERATION_LIMIT, DOMAIN_MARGIN, FIELD_RESIDUAL_LIMIT, HALF_SPACE_LEAST_DOWN_SQUARE,
    HALF_SPACE_LEAST_SUM, INCONSISTENCY_LIMIT, YAW_LEAST_EAST_SQUARE, flags,
};
use common::attitude;
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

/// A right-angled triangle of whole numbers: the field's length is 1 to the last place.
const EARTH: EarthField = EarthField {
    horizontal: 0.6,
    vertical: 0.8,
};
/// By how much a quantity is moved off its limit.
const STEP: f64 = 1e-7;

fn cold(readings: &Readings) -> Solution {
    solve_readings(readings, EARTH, &mut Memory::default(), &mut |_, _| {})
}

/// A solution of a measured third axis, from a cold start.
fn measured(readings: &Readings, t3: f64) -> Solution {
    let mut memory = Memory::default();
    memory.third = Some(Third::Measured(t3));
    solve_readings(readings, EARTH, &mut memory, &mut |_, _| {})
}

fn has(solution: &Solution, flag: u16) -> bool {
    solution.flags & flag != 0
}

/// Readings whose horizontal field is `length` times that of the calibration: C^2 + S^2 is its square,
/// at any attitude.
fn stretched(truth: &Attitude, length: f64) -> Readings {
    let field = EarthField {
        horizontal: length * EARTH.horizontal,
        ..EARTH
    };
    ideal_readings(truth, field)
}

/// An attitude whose body z has these components along north, east and down.
fn with_z(north: f64, down: f64) -> Attitude {
    let east = (1.0 - north * north - down * down).sqrt();
    let z = Vector3::new(north, east, down);
    let x = Vector3::new(0.3, -0.5, 0.8).cross(&z).normalize();
    let y = z.cross(&x);
    Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()])
}

#[test]
fn a_horizontal_field_too_long_or_too_short_by_the_limit_is_inconsistent() {
    for yaw in [-170.0, -95.0, -20.0, 45.0, 133.0] {
        for (pitch, roll) in [(0.0, 0.0), (40.0, -30.0), (-25.0, 60.0), (-60.0, 30.0)] {
            let truth = attitude(yaw, pitch, roll);
            for (square, expected) in [
                (1.0 + INCONSISTENCY_LIMIT - STEP, false),
                (1.0 + INCONSISTENCY_LIMIT + STEP, true),
                (1.0 - INCONSISTENCY_LIMIT + STEP, false),
                (1.0 - INCONSISTENCY_LIMIT - STEP, true),
            ] {
                let readings = stretched(&truth, square.sqrt());
                let mut found = f64::NAN;
                let solution = solve_readings(
                    &readings,
                    EARTH,
                    &mut Memory::default(),
                    &mut |index, value| {
                        found = if index == node::HEADING_SQUARE {
                            value
                        } else {
                            found
                        };
                    },
                );
                assert!((found - square).abs() < 1e-12, "{found} {square}");
                assert_eq!(has(&solution, flags::INCONSISTENT), expected, "{square}");
            }
        }
    }
}

/// How many solutions after one with an excess a status bit stays, all others having none.
fn remembered(averaging: Averaging, first: &Readings, third: Option<Third>, flag: u16) -> usize {
    let mut memory = Memory::new(averaging);
    memory.third = third;
    let solution = solve_readings(first, EARTH, &mut memory, &mut |_, _| {});
    assert!(has(&solution, flag));
    memory.third = None;
    let calm = ideal_readings(&attitude(30.0, 0.0, 0.0), EARTH);
    let mut solutions = 0;
    while has(
        &solve_readings(&calm, EARTH, &mut memory, &mut |_, _| {}),
        flag,
    ) {
        solutions += 1;
    }
    solutions
}

/// The same by the closed form: excess left^n falls to the limit.
fn expected_memory(excess: f64, limit: f64, left: f64) -> usize {
    if left == 0.0 {
        return 0;
    }
    ((limit / excess).ln() / left.ln()).ceil() as usize - 1
}

#[test]
fn an_excess_is_remembered_for_as_long_as_it_takes_to_fade_to_its_limit() {
    let level = attitude(30.0, 0.0, 0.0);
    for (period_log2, left) in [
        (4, 31.0 / 32.0),
        (5, 15.0 / 16.0),
        (6, 0.875),
        (7, 0.75),
        (8, 0.5),
        (9, 0.0),
        (10, 0.0),
        (12, 0.0),
    ] {
        let averaging = Averaging::new(4, period_log2).unwrap();
        for (length, excess) in [(2.1_f64.sqrt(), 1.1), (1.9_f64.sqrt(), 0.9), (4.0, 3.0)] {
            let first = stretched(&level, length);
            let solutions = remembered(averaging, &first, None, flags::INCONSISTENT);
            let expected = expected_memory(excess, INCONSISTENCY_LIMIT, left);
            assert_eq!(solutions, expected, "period {period_log2}, excess {excess}");
        }
        for (square, excess) in [(1.8, 0.8), (0.3, 0.7), (25.0_f64, 3.0)] {
            let t3 = square.sqrt();
            let first = Readings {
                tilt: [0.0, 0.0],
                ..ideal_readings(&level, EARTH)
            };
            let third = Some(Third::Measured(t3));
            let solutions = remembered(averaging, &first, third, flags::ACCELERATED);
            let expected = expected_memory(excess, ACCELERATION_LIMIT, left);
            assert_eq!(solutions, expected, "period {period_log2}, excess {excess}");
        }
    }
}

#[test]
fn a_smaller_excess_does_not_shorten_the_memory_of_a_larger_one() {
    let level = attitude(30.0, 0.0, 0.0);
    let mut memory = Memory::default();
    let mut inconsistency = Vec::new();
    for square in [3.0_f64, 1.2, 1.0, 2.9, 1.0] {
        let readings = stretched(&level, square.sqrt());
        solve_readings(&readings, EARTH, &mut memory, &mut |index, value| {
            if index == node::INCONSISTENCY {
                inconsistency.push(value);
            }
        });
    }
    let left = 31.0 / 32.0;
    let expected = [2.0, 2.0 * left, 2.0 * left * left, 1.9, 1.9 * left];
    for (found, expected) in inconsistency.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    assert_eq!(inconsistency.len(), expected.len());
}

#[test]
fn a_specific_force_too_long_or_with_a_third_axis_too_short_is_an_acceleration() {
    for (pitch, roll) in [(0.0, 0.0), (40.0, -30.0), (-25.0, 150.0)] {
        let truth = attitude(70.0, pitch, roll);
        let ideal = ideal_readings(&truth, EARTH);
        for (square, expected) in [
            (1.0 + ACCELERATION_LIMIT - STEP, false),
            (1.0 + ACCELERATION_LIMIT + STEP, true),
            (1.0 - ACCELERATION_LIMIT + STEP, false),
            (1.0 - ACCELERATION_LIMIT - STEP, true),
        ] {
            let length = f64::sqrt(square);
            let readings = Readings {
                tilt: ideal.tilt.map(|t| t * length),
                ..ideal
            };
            let solution = measured(&readings, truth[(2, 2)] * length);
            assert_eq!(has(&solution, flags::ACCELERATED), expected, "{square}");
        }
    }
}

/// Values of `node` that a measured third axis gives.
fn recorded(readings: &Readings, t3: f64, index: usize) -> f64 {
    let mut memory = Memory::default();
    memory.third = Some(Third::Measured(t3));
    let mut found = f64::NAN;
    solve_readings(readings, EARTH, &mut memory, &mut |at, value| {
        found = if at == index { value } else { found };
    });
    found
}

#[test]
fn a_measured_force_is_scaled_to_1_g_up_to_the_limit_and_as_at_the_limit_beyond() {
    let tilt = [0.36, -0.48];
    let t3 = -0.8_f64;
    for (square, scale) in [
        (1.0, 1.0),
        (1.2, 1.0 / f64::sqrt(1.2)),
        (0.8, 1.0 / f64::sqrt(0.8)),
        (1.25, 1.0 / f64::sqrt(1.25)),
        (2.0, 1.0 / f64::sqrt(1.25)),
        (0.75, 1.0 / f64::sqrt(0.75)),
        (0.1, 1.0 / f64::sqrt(0.75)),
        (0.0, 1.0 / f64::sqrt(0.75)),
    ] {
        let length = f64::sqrt(square);
        let readings = Readings {
            tilt: tilt.map(|t| t * length),
            field: [0.3, 0.2],
        };
        for (index, expected) in [
            (node::GRAVITY_X, tilt[0]),
            (node::GRAVITY_Y, tilt[1]),
            (node::DOWN, t3.abs()),
        ] {
            let found = recorded(&readings, t3 * length, index);
            let expected = expected * length * scale;
            assert!(
                (found - expected).abs() < 1e-12,
                "{square}: {found} {expected}"
            );
        }
    }
}

/// Gravity's readings alone longer than 1 g: the quotient stands as it is, the angle ends at 90 degrees.
#[test]
fn readings_beyond_the_horizon_leave_an_angle_of_90_degrees_and_say_so() {
    for (tilt, sign) in [([0.6, 0.81], 1.0), ([0.6, -0.81], -1.0), ([-0.8, 0.7], 1.0)] {
        let readings = Readings {
            tilt,
            field: [0.3, 0.2],
        };
        let solution = cold(&readings);
        assert_eq!(solution.roll.degrees(), 90.0 * sign, "{tilt:?}");
        assert!(solution.attitude.iter().all(|value| value.is_finite()));
        assert!(has(&solution, flags::DOMAIN), "{tilt:?}");
    }
}

#[test]
fn without_a_third_axis_only_too_long_a_plane_force_is_an_acceleration() {
    let along = |square: f64, direction: f64| Readings {
        tilt: [
            square.sqrt() * direction.cos(),
            square.sqrt() * direction.sin(),
        ],
        field: [0.3, 0.2],
    };
    for direction in [0.0, 1.0, 2.5, 4.0] {
        for (square, expected) in [
            (0.0, false),
            (0.5, false),
            (1.0 + ACCELERATION_LIMIT - STEP, false),
            (1.0 + ACCELERATION_LIMIT + STEP, true),
        ] {
            let solution = cold(&along(square, direction));
            assert_eq!(has(&solution, flags::ACCELERATED), expected, "{square}");
        }
    }
}

#[test]
fn both_headings_leave_their_domain_at_the_margin_on_either_side() {
    let margin = 1.0 + DOMAIN_MARGIN;
    for (pitch, roll) in [(0.0, 0.0), (30.0, 0.0), (0.0, -35.0)] {
        let gravity = ideal_readings(&attitude(0.0, pitch, roll), EARTH).tilt;
        let [t1, t2] = gravity;
        let (cos_1, cos_2) = ((1.0 - t1 * t1).sqrt(), (1.0 - t2 * t2).sqrt());
        for side in [1.0, -1.0] {
            for (size, expected) in [(margin - STEP, false), (margin + STEP, true)] {
                // C of set 1 alone, with S of set 2 at 0, and the other way round.
                let cosine = EARTH.horizontal * cos_1 * side * size;
                let sine = EARTH.horizontal * cos_2 * side * size;
                let fields = [
                    [EARTH.vertical * t1 + cosine, EARTH.vertical * t2],
                    [EARTH.vertical * t1, EARTH.vertical * t2 - sine],
                ];
                for field in fields {
                    let solution = cold(&Readings {
                        tilt: gravity,
                        field,
                    });
                    assert_eq!(has(&solution, flags::DOMAIN), expected, "{field:?} {size}");
                }
            }
        }
    }
}

#[test]
fn gravity_in_the_plane_of_two_axes_is_a_zero_divisor_and_just_short_of_it_none() {
    for direction in [0.0_f64, 0.7, 2.0, 3.9, 5.5] {
        for (square, expected) in [(1.0 - STEP, false), (1.0 + STEP, true)] {
            let (sine, cosine) = direction.sin_cos();
            let length = f64::sqrt(square);
            let down = (1.0 - square).max(0.0).sqrt();
            // Body z along north but for `down`; the field's part in the plane is what gravity brings.
            let tilt = [length * cosine, length * sine];
            let field = tilt.map(|t| t * (EARTH.vertical - EARTH.horizontal * down));
            let solution = cold(&Readings { tilt, field });
            assert_eq!(
                has(&solution, flags::DOMAIN),
                expected,
                "{direction} {square}"
            );
        }
    }
}

#[test]
fn a_residual_beyond_the_limit_on_either_side_is_disturbed() {
    let (h, v) = (EARTH.horizontal, EARTH.vertical);
    for yaw in [0.0_f64, 1.0, 2.5, -2.0] {
        for (residual, expected) in [
            (FIELD_RESIDUAL_LIMIT - STEP, false),
            (FIELD_RESIDUAL_LIMIT + STEP, true),
            (-FIELD_RESIDUAL_LIMIT + STEP, false),
            (-FIELD_RESIDUAL_LIMIT - STEP, true),
        ] {
            // Level: v^2 - (1 - b^2) = residual.
            let plane = (h * h + residual).sqrt();
            let readings = Readings {
                tilt: [0.0, 0.0],
                field: [plane * yaw.cos(), -plane * yaw.sin()],
            };
            assert_eq!(has(&cold(&readings), flags::DISTURBED), expected);
            let vertical = Vertical::of(&readings, EARTH);
            assert!((vertical.dip_product - v).abs() < 1e-15);
        }
    }
}

#[test]
fn the_residual_is_that_of_the_heading_on_every_slope() {
    let (h, truth) = (EARTH.horizontal, attitude(110.0, 35.0, -50.0));
    let readings = stretched(&truth, 1.1);
    let vertical = Vertical::of(&readings, EARTH);
    let residual = vertical.dip_product.powi(2) - vertical.down_square * vertical.field_square;
    let expected = 0.21 * vertical.down_square * h * h;
    assert!((residual - expected).abs() < 1e-12, "{residual} {expected}");
}

#[test]
fn a_slope_is_too_steep_from_its_limit_on() {
    // Body z in the north-down plane: the field along it stays clear of zero.
    for north in [1.0, -1.0] {
        for (square, expected) in [
            (HALF_SPACE_LEAST_DOWN_SQUARE + STEP, false),
            (HALF_SPACE_LEAST_DOWN_SQUARE - STEP, true),
        ] {
            let down = f64::sqrt(square);
            let truth = with_z(north * (1.0 - square).sqrt() * 0.999_999, down);
            let readings = ideal_readings(&truth, EARTH);
            let field = EARTH.horizontal * truth[(2, 0)] + EARTH.vertical * down;
            assert!(square + field * field > HALF_SPACE_LEAST_SUM);
            assert_eq!(has(&cold(&readings), flags::HALF_SPACE), expected);
            let mut memory = Memory::default();
            memory.third = Some(Third::Sign { upside_down: false });
            let compared = solve_readings(&readings, EARTH, &mut memory, &mut |_, _| {});
            assert_eq!(has(&compared, flags::HALF_SPACE), expected);
            for t3 in [down, -down] {
                let solution = measured(&readings, t3);
                assert_eq!(has(&solution, flags::HALF_SPACE), expected);
            }
        }
    }
}

#[test]
fn the_signs_are_lost_where_both_z_components_vanish_and_stay_lost() {
    let down: f64 = 0.3;
    let calm = ideal_readings(&attitude(10.0, 5.0, 5.0), EARTH);
    for side in [1.0, -1.0] {
        for (sum, expected) in [
            (HALF_SPACE_LEAST_SUM + STEP, false),
            (HALF_SPACE_LEAST_SUM - STEP, true),
        ] {
            let field = side * (sum - down * down).sqrt();
            let north = (field - EARTH.vertical * down) / EARTH.horizontal;
            let readings = ideal_readings(&with_z(north, down), EARTH);
            let mut memory = Memory::default();
            let mut flagged = |readings: &Readings| {
                let solution = solve_readings(readings, EARTH, &mut memory, &mut |_, _| {});
                has(&solution, flags::HALF_SPACE)
            };
            assert!(!flagged(&calm));
            assert_eq!(flagged(&readings), expected, "{sum}");
            assert_eq!(flagged(&calm), expected, "{sum}");
            // A third axis does not need them.
            memory.third = Some(Third::Sign { upside_down: false });
            let solution = solve_readings(&readings, EARTH, &mut memory, &mut |_, _| {});
            assert!(!has(&solution, flags::HALF_SPACE));
        }
    }
}

#[test]
fn yaw_is_held_from_the_limit_on() {
    for (east_square, expected) in [
        (YAW_LEAST_EAST_SQUARE + STEP, false),
        (YAW_LEAST_EAST_SQUARE - STEP, true),
    ] {
        for (north, down) in [(0.6, 0.8), (-0.6, 0.8), (0.0, 1.0)] {
            let length = f64::sqrt(east_square);
            let truth = with_z(length * north, length * down);
            let solution = cold(&ideal_readings(&truth, EARTH));
            assert_eq!(has(&solution, flags::YAW_HELD), expected);
            if expected {
                assert_eq!(solution.yaw.0, 0.0);
            } else {
                assert!(rotation_angle(&solution.attitude, &truth).degrees() < 1e-6);
            }
        }
    }
}

#[test]
fn nothing_at_all_is_total_and_flagged() {
    let nothing = Readings {
        tilt: [0.0, 0.0],
        field: [0.0, 0.0],
    };
    let solution = measured(&nothing, 0.0);
    assert!(solution.attitude.iter().all(|value| value.is_finite()));
    assert!(has(&solution, flags::DOMAIN) && has(&solution, flags::ACCELERATED));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn a_measured_axis_gives_every_attitude_off_the_horizon_whatever_the_length_of_gravity(
        yaw in -180.0..180.0f64, pitch in -75.0..75.0f64, roll in -180.0..180.0f64,
        square in 0.76..1.24f64,
    ) {
        let truth = attitude(yaw, pitch, roll);
        let down = truth[(2, 2)];
        prop_assume!(down * down > HALF_SPACE_LEAST_DOWN_SQUARE + STEP);
        let ideal = ideal_readings(&truth, EARTH);
        let length = square.sqrt();
        let readings = Readings { tilt: ideal.tilt.map(|t| t * length), ..ideal };
        let solution = measured(&readings, down * length);
        prop_assert_eq!(solution.flags, 0);
        let error = rotation_angle(&solution.attitude, &truth).degrees();
        prop_assert!(error < 1e-8, "{error:e}");
    }

    #[test]
    fn every_operation_is_total_with_a_measured_axis(
        tilt in prop::array::uniform3(-1.5..1.5f64), field in prop::array::uniform2(-2.0..2.0f64),
        edge in prop::sample::select(vec![0.0, 1.0, -1.0]), pick in 0usize..6,
    ) {
        let mut tilt = tilt;
        if pick < 3 {
            tilt[pick] = edge;
        }
        let readings = Readings { tilt: [tilt[0], tilt[1]], field };
        let solution = measured(&readings, tilt[2]);
        prop_assert!(solution.attitude.iter().all(|value| value.is_finite()));
    }
}
