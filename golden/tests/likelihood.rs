//! The maximum-likelihood attitude: exact on exact readings, and a minimum on noisy ones.

mod common;

use cardan_golden::{
    Angles, Noise, Readings, ideal_readings, maximum_likelihood, rotation_angle, set_1_matrix,
};
use cardan_units::HalfTurns;
use common::{EARTH, angles};
use proptest::prelude::*;

const NOISE: Noise = Noise {
    tilt: 0.002,
    field: 0.003,
};

fn cost(readings: &Readings, of: Angles) -> f64 {
    let expected = ideal_readings(&set_1_matrix(of), EARTH);
    (0..2)
        .map(|axis| {
            ((readings.tilt[axis] - expected.tilt[axis]) / NOISE.tilt).powi(2)
                + ((readings.field[axis] - expected.field[axis]) / NOISE.field).powi(2)
        })
        .sum::<f64>()
        / 2.0
}

proptest! {
    #[test]
    fn exact_readings_give_the_attitude_from_a_start_ten_degrees_away(
        yaw in -180.0..180.0f64, pitch in -45.0..45.0f64, roll in -45.0..45.0f64,
        off in prop::array::uniform3(-6.0..6.0f64),
    ) {
        let truth = set_1_matrix(angles(yaw, pitch, roll));
        let start = set_1_matrix(angles(yaw + off[0], pitch + off[1], roll + off[2]));
        let found = maximum_likelihood(&ideal_readings(&truth, EARTH), EARTH, NOISE, &start);
        prop_assert!(found.converged);
        prop_assert!(rotation_angle(&found.attitude, &truth).degrees() < 1e-9);
    }

    #[test]
    fn no_attitude_nearby_is_more_likely(
        yaw in -180.0..180.0f64, pitch in -45.0..45.0f64, roll in -45.0..45.0f64,
        noise in prop::array::uniform4(-0.01..0.01f64),
        off in prop::array::uniform3(-1.0..1.0f64),
    ) {
        let start = set_1_matrix(angles(yaw, pitch, roll));
        let mut readings = ideal_readings(&start, EARTH);
        for axis in 0..2 {
            readings.tilt[axis] += noise[axis];
            readings.field[axis] += noise[2 + axis];
        }
        let found = maximum_likelihood(&readings, EARTH, NOISE, &start);
        prop_assert!(found.converged);
        let at = cardan_golden::angles_of(&found.attitude);
        prop_assert!((found.cost - cost(&readings, at)).abs() < 1e-9);
        let beside = Angles {
            yaw: HalfTurns(at.yaw.0 + off[0] / 180.0),
            pitch: HalfTurns(at.pitch.0 + off[1] / 180.0),
            roll: HalfTurns(at.roll.0 + off[2] / 180.0),
        };
        prop_assert!(cost(&readings, beside) >= found.cost - 1e-9);
    }
}
