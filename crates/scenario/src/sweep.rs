//! Motions for looking at one thing at a time: a sine sweep of the angles, and a step.

use nalgebra::Matrix3;

use crate::parameter::Origin::Setting;
use crate::parameter::parameters;
use crate::rotation;

parameters! {
    /// Angles of set 1 (yaw, pitch, roll) swing like sines, all in phase; one axis if two of the
    /// amplitudes are zero.
    pub struct Sweep at "motion.sweep" {
        /// Amplitude of the roll.
        roll_deg = 60.0, "deg", -180.0 => 180.0, Setting;
        /// Amplitude of the pitch.
        pitch_deg = 0.0, "deg", -90.0 => 90.0, Setting;
        /// Amplitude of the yaw.
        yaw_deg = 0.0, "deg", -1e6 => 1e6, Setting;
        /// Heading about which the sweep swings.
        heading_deg = 30.0, "deg", -360.0 => 360.0, Setting;
        /// Period of the sweep.
        period_s = 8.0, "s", 0.01 => 1e6, Setting;
    }
}

parameters! {
    /// A step from one attitude (yaw, pitch, roll of set 1) to another, smooth over a short time.
    pub struct Step at "motion.step" {
        /// Yaw before.
        from_yaw_deg = 0.0, "deg", -360.0 => 360.0, Setting;
        /// Pitch before.
        from_pitch_deg = 0.0, "deg", -90.0 => 90.0, Setting;
        /// Roll before.
        from_roll_deg = 0.0, "deg", -180.0 => 180.0, Setting;
        /// Yaw after.
        to_yaw_deg = 60.0, "deg", -360.0 => 360.0, Setting;
        /// Pitch after.
        to_pitch_deg = 20.0, "deg", -90.0 => 90.0, Setting;
        /// Roll after.
        to_roll_deg = 30.0, "deg", -180.0 => 180.0, Setting;
        /// When it begins.
        at_s = 1.0, "s", 0.0 => 1e6, Setting;
        /// How long it takes.
        rise_s = 0.005, "s", 1e-4 => 1e6, Setting;
    }
}

impl Sweep {
    /// The attitude `t_s` seconds after reset: reference (magnetic NED) to body.
    #[must_use]
    pub fn attitude(&self, t_s: f64) -> Matrix3<f64> {
        let periods = t_s / self.period_s;
        let share = libm::sin(2.0 * std::f64::consts::PI * (periods - periods.floor()));
        rotation::from_set_1(
            (self.heading_deg + share * self.yaw_deg).to_radians(),
            (share * self.pitch_deg).to_radians(),
            (share * self.roll_deg).to_radians(),
        )
    }
}

impl Step {
    /// The attitude `t_s` seconds after reset: reference (magnetic NED) to body.
    #[must_use]
    pub fn attitude(&self, t_s: f64) -> Matrix3<f64> {
        let share = smoother_step((t_s - self.at_s) / self.rise_s);
        let angle = |from: f64, to: f64| (from + share * (to - from)).to_radians();
        rotation::from_set_1(
            angle(self.from_yaw_deg, self.to_yaw_deg),
            angle(self.from_pitch_deg, self.to_pitch_deg),
            angle(self.from_roll_deg, self.to_roll_deg),
        )
    }
}

/// From 0 (for x up to 0) to 1 (from x = 1) with zero first and second derivative at both ends.
#[must_use]
pub fn smoother_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 - x * (15.0 - 6.0 * x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sweep_reaches_its_amplitude_on_one_axis_and_returns() {
        let sweep = Sweep::default();
        let peak = sweep.attitude(0.25 * sweep.period_s);
        let expected = rotation::from_set_1(30.0_f64.to_radians(), 0.0, 60.0_f64.to_radians());
        assert!((peak - expected).norm() < 1e-14);
        let (start, later) = (sweep.attitude(0.0), sweep.attitude(1000.0 * sweep.period_s));
        assert!((start - later).norm() < 1e-12);
    }

    #[test]
    fn a_step_rests_before_and_after() {
        let step = Step::default();
        assert_eq!(step.attitude(0.0), Matrix3::identity());
        let after = rotation::from_set_1(
            60.0_f64.to_radians(),
            20.0_f64.to_radians(),
            30.0_f64.to_radians(),
        );
        assert_eq!(step.attitude(step.at_s + step.rise_s), after);
        assert_eq!(step.attitude(1e5), after);
    }
}
