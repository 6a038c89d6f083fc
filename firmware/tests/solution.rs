//! The deployed solution against attitudes in closed form: angles in every half-space, status bits at their
//! limits from both sides, and no saturated word where nothing is flagged.

mod support;

use cardan_spec::timing::Averaging;
use cardan_spec::{
    ACCELERATION_LIMIT, DOMAIN_MARGIN, FIELD_RESIDUAL_LIMIT, HALF_SPACE_LEAST_DOWN_SQUARE,
    HALF_SPACE_LEAST_SUM, INCONSISTENCY_LIMIT, ThirdTilt, YAW_LEAST_EAST_SQUARE, flags,
};
use support::{Device, Field, Readings, SITE, attitude, error_degrees, ideal, with_z};

/// By how much a quantity is moved off its limit: some places of the words that it comes from.
const STEP: f64 = 2e-3;

fn cold(field: Field, third: ThirdTilt, readings: &Readings) -> u16 {
    Device::new(field, third, Averaging::DEFAULT)
        .solve(readings)
        .flags
}

fn has(status: u16, flag: u16) -> bool {
    status & flag != 0
}

/// The ideal readings in a field whose horizontal part is `length` times that of the calibration.
fn stretched(truth: &[[f64; 3]; 3], length: f64) -> Readings {
    let field = Field {
        horizontal: SITE.horizontal * length,
        ..SITE
    };
    ideal(truth, field)
}

fn grid() -> impl Iterator<Item = [f64; 3]> {
    (-180..180).step_by(12).flat_map(|yaw| {
        (-75..=75).step_by(15).flat_map(move |pitch| {
            (-180..180).step_by(15).map(move |roll| {
                [
                    f64::from(yaw) + 0.3,
                    f64::from(pitch),
                    f64::from(roll) + 0.7,
                ]
            })
        })
    })
}

/// Largest error in degrees over all attitudes off the horizon, each from a cold start and none flagged.
fn worst_over_all(field: Field, third: ThirdTilt, least_down: f64, length: f64) -> f64 {
    let (mut worst, mut judged) = (0_f64, 0);
    for [yaw, pitch, roll] in grid() {
        let truth = attitude(yaw, pitch, roll);
        let down = truth[2][2];
        if down.abs() < least_down || third == ThirdTilt::Absent && down < 0.0 {
            continue;
        }
        let mut readings = ideal(&truth, field);
        readings.force(length);
        let mut device = Device::new(field, third, Averaging::DEFAULT);
        let solution = device.solve(&readings);
        let z_field = readings.z_field(&truth, field);
        let lost = down * down + z_field * z_field < HALF_SPACE_LEAST_SUM + STEP;
        let east_square = 1.0 - truth[2][1] * truth[2][1];
        if lost || east_square < YAW_LEAST_EAST_SQUARE + STEP {
            continue;
        }
        assert_eq!(solution.flags, 0, "{yaw} {pitch} {roll} {field:?}");
        assert_eq!(device.saturated(), "", "{yaw} {pitch} {roll} {field:?}");
        worst = worst.max(error_degrees(&solution, &truth));
        judged += 1;
    }
    assert!(judged >= 1000, "{judged} of {}", grid().count());
    worst
}

#[test]
fn every_attitude_is_right_to_its_words_with_every_kind_of_axis() {
    for third in ThirdTilt::ALL {
        // Up to 60 degrees of tilt, and up to 80.
        let worst = worst_over_all(SITE, third, 0.5, 1.0);
        assert!(worst < 0.03, "{third:?} {worst}");
        let worst = worst_over_all(SITE, third, 0.2, 1.0);
        assert!(worst < 0.06, "{third:?} {worst}");
    }
}

#[test]
fn a_measured_axis_is_right_whatever_the_length_of_gravity() {
    for length in [0.9, 1.1] {
        let worst = worst_over_all(SITE, ThirdTilt::Measured, 0.5, length);
        assert!(worst < 0.035, "{length} {worst}");
    }
}

#[test]
fn every_attitude_is_right_near_the_magnetic_equator_and_at_high_latitude() {
    for (inclination, most) in [(0.7, 0.025), (-30.0, 0.025), (76.0, 0.06), (81.0, 0.1)] {
        let field = Field::inclined(inclination);
        for third in ThirdTilt::ALL {
            let worst = worst_over_all(field, third, 0.5, 1.0);
            assert!(worst < most, "{inclination} {third:?} {worst}");
        }
    }
}

#[test]
fn a_horizontal_field_too_long_or_too_short_by_the_limit_is_inconsistent() {
    for (yaw, pitch, roll) in [
        (-170.0, 0.0, 0.0),
        (45.0, 40.0, -30.0),
        (133.0, -25.0, 50.0),
    ] {
        let truth = attitude(yaw, pitch, roll);
        for (square, expected) in [
            (1.0 + INCONSISTENCY_LIMIT - STEP, false),
            (1.0 + INCONSISTENCY_LIMIT + STEP, true),
            (1.0 - INCONSISTENCY_LIMIT + STEP, false),
            (1.0 - INCONSISTENCY_LIMIT - STEP, true),
        ] {
            let readings = stretched(&truth, square.sqrt());
            for third in ThirdTilt::ALL {
                let status = cold(SITE, third, &readings);
                assert_eq!(has(status, flags::INCONSISTENT), expected, "{square} {yaw}");
            }
        }
    }
}

#[test]
fn an_excess_is_remembered_for_as_long_as_it_takes_to_fade_to_its_limit() {
    let level = attitude(30.0, 0.0, 0.0);
    let calm = ideal(&level, SITE);
    for (period_log2, left) in [(4, 31.0 / 32.0), (6, 0.875), (8, 0.5), (9, 0.0), (12, 0.0)] {
        let averaging = Averaging::new(4, period_log2).expect("admissible");
        let remembered = |first: &Readings, third: ThirdTilt, flag: u16| {
            let mut device = Device::new(SITE, third, averaging.with(third));
            assert!(has(device.solve(first).flags, flag));
            (0..)
                .take_while(|_| has(device.solve(&calm).flags, flag))
                .count()
        };
        let expected = |excess: f64, limit: f64| {
            if left == 0.0 {
                return 0.0;
            }
            ((limit / excess).ln() / f64::ln(left)).ceil() - 1.0
        };
        for (length, excess) in [(1.45, 1.1025), (1.38, 0.9044)] {
            let first = stretched(&level, length);
            let found = remembered(&first, ThirdTilt::Absent, flags::INCONSISTENT) as f64;
            let expected = expected(excess, INCONSISTENCY_LIMIT);
            assert!(
                (found - expected).abs() <= 1.0,
                "{period_log2} {found} {expected}"
            );
        }
        // Beyond the most that is remembered.
        let found = remembered(
            &stretched(&level, 2.5),
            ThirdTilt::Absent,
            flags::INCONSISTENT,
        );
        assert!(
            (found as f64 - expected(3.0, INCONSISTENCY_LIMIT)).abs() <= 1.0,
            "{found}"
        );
        let mut first = calm;
        first.force(0.6);
        let found = remembered(&first, ThirdTilt::Measured, flags::ACCELERATED) as f64;
        let expected = expected(0.64, ACCELERATION_LIMIT);
        assert!(
            (found - expected).abs() <= 1.0,
            "{period_log2} {found} {expected}"
        );
    }
}

#[test]
fn a_specific_force_too_long_or_with_a_third_axis_too_short_is_an_acceleration() {
    for (pitch, roll) in [(0.0, 0.0), (40.0, -30.0), (-25.0, 150.0)] {
        let truth = attitude(70.0, pitch, roll);
        for (square, expected) in [
            (1.0 + ACCELERATION_LIMIT - STEP, false),
            (1.0 + ACCELERATION_LIMIT + STEP, true),
            (1.0 - ACCELERATION_LIMIT + STEP, false),
            (1.0 - ACCELERATION_LIMIT - STEP, true),
        ] {
            let mut readings = ideal(&truth, SITE);
            readings.force(f64::sqrt(square));
            let status = cold(SITE, ThirdTilt::Measured, &readings);
            assert_eq!(has(status, flags::ACCELERATED), expected, "{square}");
        }
    }
    for third in [ThirdTilt::Absent, ThirdTilt::Comparator] {
        for (square, expected) in [
            (0.0, false),
            (0.5, false),
            (1.0 + ACCELERATION_LIMIT - STEP, false),
            (1.0 + ACCELERATION_LIMIT + STEP, true),
        ] {
            let length = f64::sqrt(square);
            for tilt in [[length, 0.0, 0.1], [-0.6 * length, 0.8 * length, 0.1]] {
                let readings = Readings {
                    tilt,
                    field: [0.2, 0.3],
                };
                let status = cold(SITE, third, &readings);
                assert_eq!(has(status, flags::ACCELERATED), expected, "{square}");
            }
        }
    }
}

#[test]
fn both_headings_leave_their_domain_at_the_margin_on_either_side() {
    let margin = 1.0 + DOMAIN_MARGIN;
    for (pitch, roll) in [(0.0, 0.0), (30.0, 0.0), (0.0, -35.0)] {
        let tilt = ideal(&attitude(0.0, pitch, roll), SITE).tilt;
        let [t1, t2, _] = tilt;
        let (cos_1, cos_2) = ((1.0 - t1 * t1).sqrt(), (1.0 - t2 * t2).sqrt());
        for side in [1.0, -1.0] {
            for (size, expected) in [(margin - STEP, false), (margin + STEP, true)] {
                let cosine = SITE.horizontal * cos_1 * side * size;
                let sine = SITE.horizontal * cos_2 * side * size;
                for field in [
                    [SITE.vertical * t1 + cosine, SITE.vertical * t2],
                    [SITE.vertical * t1, SITE.vertical * t2 - sine],
                ] {
                    let status = cold(SITE, ThirdTilt::Absent, &Readings { tilt, field });
                    assert_eq!(has(status, flags::DOMAIN), expected, "{field:?} {size}");
                }
            }
        }
    }
}

#[test]
fn gravity_in_the_plane_of_two_axes_is_a_zero_divisor() {
    for (length, expected) in [(0.99_f64, false), (1.01, true)] {
        for direction in [0.0_f64, 0.7, 2.0, 3.9, 5.5] {
            let (sine, cosine) = direction.sin_cos();
            let down = (1.0 - length * length).max(0.0).sqrt();
            let tilt = [length * cosine, length * sine, down];
            let along = SITE.vertical - SITE.horizontal * down;
            let field = [tilt[0] * along, tilt[1] * along];
            let status = cold(SITE, ThirdTilt::Absent, &Readings { tilt, field });
            assert_eq!(has(status, flags::DOMAIN), expected, "{direction} {length}");
        }
    }
}

#[test]
fn a_residual_beyond_the_limit_on_either_side_is_disturbed() {
    let h = SITE.horizontal;
    for yaw in [0.0_f64, 1.0, 2.5, -2.0] {
        for (residual, expected) in [
            (FIELD_RESIDUAL_LIMIT - STEP, false),
            (FIELD_RESIDUAL_LIMIT + STEP, true),
            (-FIELD_RESIDUAL_LIMIT + STEP, false),
            (-FIELD_RESIDUAL_LIMIT - STEP, true),
        ] {
            let plane = (h * h + residual).sqrt();
            let readings = Readings {
                tilt: [0.0, 0.0, 1.0],
                field: [plane * yaw.cos(), -plane * yaw.sin()],
            };
            let status = cold(SITE, ThirdTilt::Absent, &readings);
            assert_eq!(has(status, flags::DISTURBED), expected, "{residual}");
        }
    }
}

#[test]
fn a_slope_is_too_steep_from_its_limit_on() {
    for north in [1.0, -1.0] {
        for (square, expected) in [
            (HALF_SPACE_LEAST_DOWN_SQUARE + STEP, false),
            (HALF_SPACE_LEAST_DOWN_SQUARE - STEP, true),
        ] {
            let down = f64::sqrt(square);
            let truth = with_z(north * (1.0 - square).sqrt(), down);
            for third in ThirdTilt::ALL {
                let status = cold(SITE, third, &ideal(&truth, SITE));
                assert_eq!(
                    has(status, flags::HALF_SPACE),
                    expected,
                    "{third:?} {square}"
                );
            }
        }
    }
}

#[test]
fn the_signs_are_lost_where_both_z_components_vanish_and_stay_lost_until_told() {
    let down: f64 = 0.28;
    let calm = ideal(&attitude(10.0, 5.0, 5.0), SITE);
    for side in [1.0, -1.0] {
        for (sum, expected) in [
            (HALF_SPACE_LEAST_SUM + STEP, false),
            (HALF_SPACE_LEAST_SUM - STEP, true),
        ] {
            let field = side * (sum - down * down).sqrt();
            let north = (field - SITE.vertical * down) / SITE.horizontal;
            let steep = ideal(&with_z(north, down), SITE);
            for (third, expected) in [
                (ThirdTilt::Absent, expected),
                (ThirdTilt::Comparator, false),
                (ThirdTilt::Measured, false),
            ] {
                let mut device = Device::new(SITE, third, Averaging::DEFAULT);
                assert!(!has(device.solve(&calm).flags, flags::HALF_SPACE));
                assert_eq!(has(device.solve(&steep).flags, flags::HALF_SPACE), expected);
                assert_eq!(has(device.solve(&calm).flags, flags::HALF_SPACE), expected);
                device.set_upright();
                assert!(!has(device.solve(&calm).flags, flags::HALF_SPACE));
            }
        }
    }
}

/// A path in closed form; each solution is the truth or flagged as `HALF_SPACE`.
fn follow(third: ThirdTilt, path: impl Iterator<Item = [f64; 3]>) -> (u32, u32) {
    let mut device = Device::new(SITE, third, Averaging::DEFAULT);
    let (mut lost, mut upside_down, mut known) = (false, 0, 0);
    for [yaw, pitch, roll] in path {
        let truth = attitude(yaw, pitch, roll);
        let readings = ideal(&truth, SITE);
        let solution = device.solve(&readings);
        let (down, z_field) = (truth[2][2], readings.z_field(&truth, SITE));
        let sum = down * down + z_field * z_field;
        // Where rounding decides, either is right.
        if (sum - HALF_SPACE_LEAST_SUM).abs() < STEP && !lost {
            lost = has(solution.flags, flags::HALF_SPACE);
        }
        lost |= sum < HALF_SPACE_LEAST_SUM - STEP;
        let is_steep = down * down < HALF_SPACE_LEAST_DOWN_SQUARE;
        let is_flagged = has(solution.flags, flags::HALF_SPACE);
        if (down * down - HALF_SPACE_LEAST_DOWN_SQUARE).abs() > STEP {
            let expected = is_steep || lost && third == ThirdTilt::Absent;
            assert_eq!(is_flagged, expected, "{third:?} {yaw} {pitch} {roll}");
        }
        if !is_flagged && !has(solution.flags, flags::YAW_HELD) {
            let error = error_degrees(&solution, &truth);
            assert!(error < 1.5, "{third:?} {yaw} {pitch} {roll}: {error}");
            known += 1;
            upside_down += u32::from(down < 0.0);
        }
    }
    (known, upside_down)
}

#[test]
fn turns_through_upside_down_are_followed_or_flagged() {
    let mut upside_down_without = 0;
    for third in ThirdTilt::ALL {
        for yaw in [-150.0, -60.0, 20.0, 90.0] {
            for pitch in [-30.0, 0.0, 25.0] {
                let turn = (0..2 * 360).map(|degree| [yaw, pitch, f64::from(degree) + 0.25]);
                let (_, upside_down) = follow(third, turn);
                if third == ThirdTilt::Absent {
                    upside_down_without += upside_down;
                } else {
                    assert!(upside_down > 200, "{third:?}");
                }
            }
            let somersault = (0..2 * 360).map(|degree| [yaw, f64::from(degree) + 0.25, 0.0]);
            follow(third, somersault);
        }
    }
    assert!(upside_down_without > 500, "{upside_down_without}");
}

#[test]
fn near_the_horizon_a_comparator_is_not_believed() {
    let mut device = Device::new(SITE, ThirdTilt::Comparator, Averaging::DEFAULT);
    device.solve(&ideal(&attitude(40.0, 0.0, 60.0), SITE));
    let truth = attitude(40.0, 0.0, 84.0);
    let mut readings = ideal(&truth, SITE);
    readings.tilt[2] = -readings.tilt[2];
    let solution = device.solve(&readings);
    assert!(has(solution.flags, flags::HALF_SPACE));
    assert!(error_degrees(&solution, &truth) < 1.5);
    // A measured one is: it has no other sign.
    let mut device = Device::new(SITE, ThirdTilt::Measured, Averaging::DEFAULT);
    device.solve(&ideal(&attitude(40.0, 0.0, 60.0), SITE));
    let solution = device.solve(&readings);
    assert!(error_degrees(&solution, &truth) > 5.0);
}

#[test]
fn yaw_is_held_from_the_limit_on() {
    for (east_square, expected) in [
        (YAW_LEAST_EAST_SQUARE + STEP, false),
        (YAW_LEAST_EAST_SQUARE - STEP, true),
    ] {
        for (north, down) in [(0.0, 1.0), (-0.28, 0.96)] {
            let length = f64::sqrt(east_square);
            let truth = with_z(length * north, length * down);
            let mut device = Device::new(SITE, ThirdTilt::Measured, Averaging::DEFAULT);
            let before = device.solve(&ideal(&attitude(77.0, 0.0, 0.0), SITE));
            let solution = device.solve(&ideal(&truth, SITE));
            assert_eq!(
                has(solution.flags, flags::YAW_HELD),
                expected,
                "{east_square}"
            );
            assert_eq!(solution.yaw == before.yaw, expected);
        }
    }
}

#[test]
fn a_clipped_average_is_flagged() {
    let mut device = Device::new(SITE, ThirdTilt::Absent, Averaging::DEFAULT);
    let readings = ideal(&attitude(10.0, 20.0, 30.0), SITE);
    assert_eq!(device.solve(&readings).flags, 0);
    assert_eq!(device.solve_clipped(&readings).flags, flags::SATURATION);
    assert_eq!(device.solve(&readings).flags, 0);
}
