//! The half-space flag on simulated rotations through upside-down and back.

mod common;

use cardan_golden::solve::{Memory, Third, solve_readings};
use cardan_golden::{Attitude, ideal_readings, rotation_angle};
use cardan_spec::{HALF_SPACE_LEAST_DOWN_SQUARE, HALF_SPACE_LEAST_SUM, flags};
use common::{EARTH, attitude};

/// Whether the solution is flagged; if it is not, it must be the truth.
fn flagged(attitude: &Attitude, memory: &mut Memory) -> bool {
    let solution = solve_readings(
        &ideal_readings(attitude, EARTH),
        EARTH,
        memory,
        &mut |_, _| {},
    );
    let is_flagged = solution.flags & flags::HALF_SPACE != 0;
    if !is_flagged {
        let error = rotation_angle(&solution.attitude, attitude).degrees();
        assert!(error < 1e-8, "unflagged and {error:e} degrees wrong");
    }
    is_flagged
}

/// The flag that a motion must have, from the true attitudes alone: too steep, or the signs once lost
/// because both z components were near zero.
#[derive(Default)]
struct Expected {
    lost: bool,
}

impl Expected {
    fn flag(&mut self, m: &Attitude) -> bool {
        let down = m[(2, 2)];
        let field = EARTH.horizontal * m[(2, 0)] + EARTH.vertical * down;
        self.lost |= down * down + field * field < HALF_SPACE_LEAST_SUM;
        self.lost || down * down < HALF_SPACE_LEAST_DOWN_SQUARE
    }
}

#[test]
fn attitudes_are_right_through_upside_down_and_back_for_five_turns_or_flagged() {
    let mut kept = 0;
    for yaw in [-150.0, -100.0, -60.0, -25.0, 20.0, 45.0, 90.0, 160.0] {
        for pitch in [-30.0, 0.0, 25.0] {
            let mut memory = Memory::default();
            let mut expected = Expected::default();
            let mut upside_down = 0;
            for degree in 0..5 * 360 {
                let m = attitude(yaw, pitch, f64::from(degree) + 0.25);
                let down = m[(2, 2)];
                let outside = expected.flag(&m);
                assert_eq!(
                    flagged(&m, &mut memory),
                    outside,
                    "yaw {yaw}, pitch {pitch}, roll {degree}"
                );
                upside_down += u32::from(down < 0.0);
            }
            kept += u32::from(!expected.lost);
            assert_eq!(upside_down, 5 * 180);
        }
    }
    // Control: the turns that stay clear of east and west keep their signs throughout.
    assert_eq!(kept, 8, "of 24");
}

#[test]
fn attitudes_are_right_through_somersaults_about_the_y_axis_or_flagged() {
    for yaw in [-120.0, -70.0, 40.0, 100.0] {
        let mut memory = Memory::default();
        let mut expected = Expected::default();
        for degree in 0..3 * 360 {
            let m = attitude(yaw, f64::from(degree) + 0.25, 0.0);
            let outside = expected.flag(&m);
            assert_eq!(
                flagged(&m, &mut memory),
                outside,
                "yaw {yaw}, pitch {degree}"
            );
        }
    }
}

/// Where both vertical components pass zero together their signs cannot be told: a roll about the
/// north axis gives the same readings as a swing to 90 degrees and back. From there on the flag stays
/// set: no rule can do better on four readings.
#[test]
fn a_roll_about_the_north_axis_reads_as_a_swing_and_is_flagged_from_near_90_degrees_on() {
    let mut lost = false;
    let mut memory = Memory::default();
    for degree in 0..180 {
        let roll = f64::from(degree) + 0.25;
        let turning = ideal_readings(&attitude(0.0, 0.0, roll), EARTH);
        let swinging = ideal_readings(&attitude(0.0, 0.0, 180.0 - roll), EARTH);
        for axis in 0..2 {
            assert!((turning.tilt[axis] - swinging.tilt[axis]).abs() < 1e-15);
            assert!((turning.field[axis] - swinging.field[axis]).abs() < 1e-15);
        }
        // Both squares together: (1 + v^2) cos^2 of the roll.
        let sum = (1.0 + EARTH.vertical.powi(2)) * libm::cos(roll.to_radians()).powi(2);
        lost |= sum < HALF_SPACE_LEAST_SUM;
        assert_eq!(
            flagged(&attitude(0.0, 0.0, roll), &mut memory),
            lost,
            "{roll}"
        );
    }
}

/// The motion that four readings lose for good: with a third axis it is known again at once, and until
/// then, near the horizon, tracked.
#[test]
fn with_a_third_axis_a_roll_about_the_north_axis_is_flagged_near_the_horizon_only() {
    let mut memory = Memory::default();
    for degree in 0..3 * 360 {
        let truth = attitude(0.0, 0.0, f64::from(degree) + 0.25);
        let down = truth[(2, 2)];
        memory.third = Some(Third::Sign {
            upside_down: down < 0.0,
        });
        let is_steep = down * down < HALF_SPACE_LEAST_DOWN_SQUARE;
        assert_eq!(flagged(&truth, &mut memory), is_steep, "{degree}");
    }
}

#[test]
fn near_the_horizon_a_third_axis_is_not_believed_and_the_signs_are_tracked() {
    let steep = attitude(40.0, 0.0, 85.0);
    for upside_down in [false, true] {
        let mut memory = Memory::default();
        memory.third = Some(Third::Sign { upside_down: false });
        assert!(!flagged(&attitude(40.0, 0.0, 60.0), &mut memory));
        memory.third = Some(Third::Sign { upside_down });
        let readings = ideal_readings(&steep, EARTH);
        let solution = solve_readings(&readings, EARTH, &mut memory, &mut |_, _| {});
        assert_ne!(solution.flags & flags::HALF_SPACE, 0);
        assert!((solution.roll.degrees() - 85.0).abs() < 1e-9);
    }
}
