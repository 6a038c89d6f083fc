//! The synthetic tumble: smooth, endless, through all headings, up to a given tilt.

use nalgebra::Matrix3;

use crate::parameter::Origin::Setting;
use crate::parameter::parameters;
use crate::random::{Random, Source};
use crate::rotation;

parameters! {
    /// A rocking that turns: tilt swings like a sine about a horizontal axis that itself turns,
    /// while the heading goes round with a swing of its own. The seed sets the four phases.
    pub struct Tumble at "motion.tumble" {
        /// Largest tilt, the angle between body z and down.
        tilt_deg = 62.5, "deg", 0.0 => 180.0, Setting;
        /// Frequency of the rocking; the largest tilt is reached twice per period.
        tilt_hz = 0.16, "Hz", 0.0 => 20.0, Setting;
        /// Frequency at which the rocking's axis turns.
        axis_hz = 0.031, "Hz", -20.0 => 20.0, Setting;
        /// Mean turns of the heading per second.
        heading_hz = 0.11, "Hz", -20.0 => 20.0, Setting;
        /// Amplitude of the heading's swing.
        swing_deg = 40.0, "deg", 0.0 => 180.0, Setting;
        /// Frequency of the heading's swing.
        swing_hz = 0.11, "Hz", 0.0 => 20.0, Setting;
    }
}

/// A tumble with its phases drawn.
#[derive(Clone, Debug)]
pub struct TumbleMotion {
    tumble: Tumble,
    phases: [f64; 4],
}

const TURN: f64 = 2.0 * std::f64::consts::PI;

impl TumbleMotion {
    /// Draws the phases under `seed`.
    #[must_use]
    pub fn new(tumble: &Tumble, seed: u64) -> Self {
        let mut random = Random::new(seed, Source::Motion);
        let phases = std::array::from_fn(|_| random.uniform());
        Self {
            tumble: tumble.clone(),
            phases,
        }
    }

    /// The attitude `t_s` seconds after reset: reference (magnetic NED) to body.
    #[must_use]
    pub fn attitude(&self, t_s: f64) -> Matrix3<f64> {
        let Tumble {
            tilt_deg,
            tilt_hz,
            axis_hz,
            heading_hz,
            swing_deg,
            swing_hz,
        } = self.tumble;
        let turns = |hz: f64, phase: f64| {
            let turns = hz * t_s + phase;
            TURN * (turns - turns.floor())
        };
        let tilt = tilt_deg.to_radians() * libm::sin(turns(tilt_hz, self.phases[0]));
        let axis = turns(axis_hz, self.phases[1]);
        let swing = swing_deg.to_radians() * libm::sin(turns(swing_hz, self.phases[3]));
        rotation::tilted(tilt, axis) * rotation::about_z(turns(heading_hz, self.phases[2]) + swing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 1e-3;

    /// Largest tilt and rate over `seconds`, in degrees (per second), and headings met of 36.
    fn survey(seed: u64, seconds: f64) -> (f64, f64, usize) {
        let motion = TumbleMotion::new(&Tumble::default(), seed);
        let (mut tilt, mut rate, mut headings) = (0.0_f64, 0.0_f64, [false; 36]);
        let mut before = motion.attitude(0.0);
        for step in 1..=(seconds / STEP_S) as u32 {
            let now = motion.attitude(f64::from(step) * STEP_S);
            rate = rate.max(rotation::angle_between(&before, &now).to_degrees() / STEP_S);
            tilt = tilt.max(libm::acos(now[(2, 2)]).to_degrees());
            let yaw = libm::atan2(now[(0, 1)], now[(0, 0)]).to_degrees();
            headings[((yaw + 180.0) / 10.0) as usize % 36] = true;
            before = now;
        }
        (tilt, rate, headings.iter().filter(|met| **met).count())
    }

    #[test]
    fn every_seed_reaches_60_degrees_and_60_degrees_per_second_and_all_headings_in_10_s() {
        for seed in 0..40 {
            let (tilt, rate, headings) = survey(seed, 10.0);
            assert!((60.0..65.0).contains(&tilt), "seed {seed}: tilt {tilt}");
            assert!((60.0..150.0).contains(&rate), "seed {seed}: rate {rate}");
            assert!(headings >= 34, "seed {seed}: {headings} of 36 headings");
        }
    }

    #[test]
    fn the_motion_is_smooth_also_where_phases_wrap() {
        let motion = TumbleMotion::new(&Tumble::default(), 5);
        let step = 1e-4;
        for index in 0..400_000_u32 {
            let t = f64::from(index) * step;
            let moved = rotation::angle_between(&motion.attitude(t), &motion.attitude(t + step));
            assert!(moved.to_degrees() < 150.0 * step, "at {t} s: {moved} rad");
        }
    }

    #[test]
    fn attitudes_are_rotations_for_ever() {
        let motion = TumbleMotion::new(&Tumble::default(), 9);
        for t in [0.0, 1.0, 1e3, 1e6] {
            let m = motion.attitude(t);
            assert!((m * m.transpose() - Matrix3::identity()).norm() < 1e-14);
            assert!((m.determinant() - 1.0).abs() < 1e-14);
        }
    }
}
