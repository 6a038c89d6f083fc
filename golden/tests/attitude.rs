//! Round trips of the golden model against rotation matrices that nalgebra makes, and the errata of
//! the printed equations (docs/sensors.md, 7.1).

mod common;

use cardan_golden::solve::{Memory, Third, calibrate, solve_readings};
use cardan_golden::{
    Attitude, Readings, angles_of, codes_of, ideal_readings, node, rotation_angle, set_1_matrix,
    set_2_matrix,
};
use cardan_spec::calibration::Calibration;
use cardan_spec::{HALF_SPACE_LEAST_DOWN_SQUARE, HALF_SPACE_LEAST_SUM, flags};
use cardan_units::HalfTurns;
use common::{EARTH, angles};
use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;

/// The oracle: turning the frame by an angle turns the components by its negative.
fn frame_turn(axis: Vector3<f64>, degrees: f64) -> Matrix3<f64> {
    Rotation3::from_scaled_axis(axis * -degrees.to_radians()).into_inner()
}

fn oracle(yaw: f64, pitch: f64, roll: f64) -> Attitude {
    frame_turn(Vector3::x(), roll) * frame_turn(Vector3::y(), pitch) * frame_turn(Vector3::z(), yaw)
}

/// An attitude `tilt` degrees from upright, leaning to `azimuth`, then turned about body z.
fn leaning(tilt: f64, azimuth: f64, spin: f64) -> Attitude {
    frame_turn(Vector3::z(), spin)
        * frame_turn(Vector3::x(), tilt)
        * frame_turn(Vector3::z(), azimuth)
}

fn solved(readings: &Readings) -> (cardan_golden::Solution, Vec<f64>) {
    let mut nodes = vec![f64::NAN; cardan_spec::nodes::SHARED.len()];
    let solution = solve_readings(
        readings,
        EARTH,
        &mut Memory::default(),
        &mut |index, value| {
            nodes[index] = value;
        },
    );
    (solution, nodes)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn the_attitude_of_ideal_readings_comes_back_to_a_billionth_of_a_degree(
        tilt in 0.0..75.0f64, azimuth in -180.0..180.0f64, spin in -180.0..180.0f64,
    ) {
        let truth = leaning(tilt, azimuth, spin);
        let (solution, nodes) = solved(&ideal_readings(&truth, EARTH));
        let error = rotation_angle(&solution.attitude, &truth).degrees();
        prop_assert!(error < 1e-9, "{error:e}");
        // Body z near east or west: right, but which way is up could not be told later.
        let down = truth[(2, 2)];
        let field = EARTH.horizontal * truth[(2, 0)] + EARTH.vertical * down;
        let lost = down * down + field * field < HALF_SPACE_LEAST_SUM;
        prop_assert_eq!(solution.flags, if lost { flags::HALF_SPACE } else { 0 });
        prop_assert!((nodes[node::DOWN] - truth[(2, 2)]).abs() < 1e-12);
        // acos and asin lose half the digits at their dead spots; each set alone is good to 2e-6.
        let expected = angles_of(&truth).yaw;
        for yaw in [nodes[node::YAW_1], nodes[node::YAW_2]] {
            let error = HalfTurns(yaw - expected.0).wrapped().degrees().abs();
            prop_assert!(error < 1e-5, "{error:e}");
        }
    }

    #[test]
    fn with_a_third_axis_every_attitude_off_the_horizon_comes_back_from_a_cold_start(
        tilt in 0.0..180.0f64, azimuth in -180.0..180.0f64, spin in -180.0..180.0f64,
    ) {
        let truth = leaning(tilt, azimuth, spin);
        let down = truth[(2, 2)];
        prop_assume!(down * down > HALF_SPACE_LEAST_DOWN_SQUARE);
        let mut memory = Memory::default();
        memory.third = Some(Third::Sign { upside_down: down < 0.0 });
        let readings = ideal_readings(&truth, EARTH);
        let mut told = f64::NAN;
        let solution = solve_readings(&readings, EARTH, &mut memory, &mut |index, value| {
            told = if index == node::TILT_Z { value } else { told };
        });
        let error = rotation_angle(&solution.attitude, &truth).degrees();
        prop_assert!(error < 1e-9, "{error:e}");
        prop_assert_eq!(solution.flags, 0);
        prop_assert_eq!(told, down.signum());
    }

    #[test]
    fn the_same_holds_at_the_dead_spots_of_either_set(
        heading in prop::sample::select(vec![-180.0, -90.0, 0.0, 90.0]),
        offset in prop::sample::select(vec![0.0, 1e-12, 1e-8, 1e-4]),
        pitch in -60.0..60.0f64, roll in -60.0..60.0f64,
    ) {
        let truth = oracle(heading + offset, pitch, roll);
        let (solution, _) = solved(&ideal_readings(&truth, EARTH));
        let error = rotation_angle(&solution.attitude, &truth).degrees();
        prop_assert!(error < 1e-9, "{error:e}");
    }

    #[test]
    fn both_orders_make_the_matrices_that_nalgebra_makes(
        yaw in -180.0..180.0f64, pitch in -90.0..90.0f64, roll in -180.0..180.0f64,
    ) {
        let (x, y, z) = (
            frame_turn(Vector3::x(), roll),
            frame_turn(Vector3::y(), pitch),
            frame_turn(Vector3::z(), yaw),
        );
        let of = angles(yaw, pitch, roll);
        prop_assert!((set_1_matrix(of) - x * y * z).norm() < 1e-14);
        prop_assert!((set_2_matrix(of) - y * x * z).norm() < 1e-14);
        let back = angles_of(&set_1_matrix(of));
        prop_assert!(rotation_angle(&set_1_matrix(back), &set_1_matrix(of)).degrees() < 1e-12);
    }

    #[test]
    fn the_rotation_angle_is_accurate_however_small(
        axis in prop::array::uniform3(-1.0..1.0f64), exponent in -11.0..2.25f64,
        tilt in 0.0..180.0f64, azimuth in -180.0..180.0f64,
    ) {
        let axis = Vector3::from(axis);
        prop_assume!(axis.norm() > 0.1);
        let degrees = 10f64.powf(exponent);
        let base = leaning(tilt, azimuth, 17.0);
        let turned = frame_turn(axis.normalize(), degrees) * base;
        let angle = rotation_angle(&turned, &base).degrees();
        prop_assert!((angle - degrees).abs() < 1e-13 + 1e-13 * degrees, "{angle:e} {degrees:e}");
        prop_assert_eq!(rotation_angle(&base, &turned).degrees(), angle);
    }

    #[test]
    fn the_codes_of_readings_calibrate_back_to_them(
        tilt in prop::array::uniform2(-1.0..1.0f64), field in prop::array::uniform2(-1.0..1.0f64),
        skew in prop::array::uniform8(-0.05..0.05f64),
    ) {
        let mut calibration = Calibration::nominal(46.2, EARTH.horizontal, EARTH.vertical);
        for index in 0..4 {
            calibration.tilt_matrix[index / 2][index % 2] += skew[index];
            calibration.field_matrix[index / 2][index % 2] += skew[4 + index];
            calibration.tilt_offset[index / 2] = skew[index];
        }
        let readings = Readings { tilt, field };
        let averages = codes_of(&readings, &calibration).unwrap().map(|code| code / 512.0);
        let back = calibrate(&averages, &calibration);
        for axis in 0..2 {
            prop_assert!((back.tilt[axis] - tilt[axis]).abs() < 1e-14);
            prop_assert!((back.field[axis] - field[axis]).abs() < 1e-14);
        }
    }
}

#[test]
fn the_printed_equations_for_tilt_and_the_x_field_are_right_and_for_the_y_field_and_yaw_wrong() {
    let (h, v) = (EARTH.horizontal, EARTH.vertical);
    let (mut worst_printed_b2, mut worst_printed_yaw) = (0f64, 0f64);
    for step in 0..1000 {
        let (yaw, pitch, roll) = (
            f64::from(step) * 137.5 % 360.0 - 180.0,
            f64::from(step) * 0.618 % 1.0 * 100.0 - 50.0,
            f64::from(step) * 0.414 % 1.0 * 100.0 - 50.0,
        );
        let m = oracle(yaw, pitch, roll);
        let (sf, cf) = yaw.to_radians().sin_cos();
        let (st, ct) = pitch.to_radians().sin_cos();
        let (sp, cp) = roll.to_radians().sin_cos();
        let field = m * Vector3::new(h, 0.0, v);
        let readings = ideal_readings(&m, EARTH);
        let corrected_b2 = h * (sp * st * cf - cp * sf) + v * sp * ct;
        for (equation, value) in [
            (-st, readings.tilt[0]),
            (sp * ct, readings.tilt[1]),
            (h * ct * cf - v * st, readings.field[0]),
            (corrected_b2, readings.field[1]),
            (field.x, readings.field[0]),
            (field.y, readings.field[1]),
        ] {
            let error = (equation - value).abs();
            assert!(error < 1e-14, "{error:e} at {yaw} {pitch} {roll}");
        }
        let printed_b2 = h * (cp * st * cf - ct * sf) - v * sp * ct;
        worst_printed_b2 = worst_printed_b2.max((printed_b2 - readings.field[1]).abs());
        let argument = (readings.field[0] + v * st) / (h * ct);
        let printed_yaw = -argument.clamp(-1.0, 1.0).asin().to_degrees();
        let error = HalfTurns::from_degrees(printed_yaw - yaw)
            .wrapped()
            .degrees();
        worst_printed_yaw = worst_printed_yaw.max(error.abs());
    }
    assert!(worst_printed_b2 > 1.0, "{worst_printed_b2}");
    assert!(worst_printed_yaw > 170.0, "{worst_printed_yaw}");
}

#[test]
fn set_2_is_expressed_in_set_1_before_it_is_averaged() {
    let truth = oracle(40.0, 35.0, 50.0);
    let (_, nodes) = solved(&ideal_readings(&truth, EARTH));
    let [_, own] = cardan_golden::orders::headings(&ideal_readings(&truth, EARTH), EARTH);
    assert!((HalfTurns(nodes[node::YAW_2]).degrees() - 40.0).abs() < 1e-9);
    assert!((own.yaw.degrees() - 40.0).abs() > 10.0);
}

/// Pitch of 90 degrees: yaw and roll turn about one axis, and all of the turn is yaw.
#[test]
fn at_a_pitch_of_ninety_degrees_all_of_the_turn_is_yaw() {
    for (yaw, pitch) in [(30.0, 90.0), (-135.0, 90.0), (30.0, -90.0), (-135.0, -90.0)] {
        let turned = set_1_matrix(angles(yaw, pitch, 0.0));
        // The cosine of a rounded right angle is no zero.
        let exact = turned.map(|element| if element.abs() < 1e-12 { 0.0 } else { element });
        let found = angles_of(&exact);
        assert_eq!(found.roll.degrees(), 0.0);
        assert!((found.pitch.degrees() - pitch).abs() < 1e-9);
        assert!((found.yaw.degrees() - yaw).abs() < 1e-9, "{yaw}, {pitch}");
    }
}
