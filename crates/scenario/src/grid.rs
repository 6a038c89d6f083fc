//! The static grid: rests at a grid of attitudes, moving smoothly from one to the next.

use nalgebra::Matrix3;

use crate::parameter::Origin::Setting;
use crate::parameter::parameters;
use crate::poses::short_way;
use crate::rotation;
use crate::sweep::smoother_step;

parameters! {
    /// Rests at every combination of tilt, tilt direction and heading, endlessly.
    pub struct Grid at "motion.static" {
        /// Largest tilt.
        tilt_deg = 60.0, "deg", 0.0 => 180.0, Setting;
        /// Tilts besides level, evenly spaced up to the largest (rounded to a whole number).
        tilts = 2.0, "1", 0.0 => 1000.0, Setting;
        /// Directions of tilt, evenly spaced (rounded to a whole number).
        directions = 4.0, "1", 1.0 => 1000.0, Setting;
        /// Headings, evenly spaced (rounded to a whole number).
        headings = 4.0, "1", 1.0 => 1000.0, Setting;
        /// Time at rest in each attitude.
        dwell_s = 0.3, "s", 0.001 => 1e6, Setting;
        /// Time from one attitude to the next.
        move_s = 0.4, "s", 0.001 => 1e6, Setting;
    }
}

/// Tilt, direction of tilt and heading in radians.
type Position = [f64; 3];

impl Grid {
    /// The attitude `t_s` seconds after reset: reference (magnetic NED) to body.
    #[must_use]
    pub fn attitude(&self, t_s: f64) -> Matrix3<f64> {
        let period = self.dwell_s + self.move_s;
        let index = (t_s / period).floor();
        let moved = ((t_s - index * period - self.dwell_s) / self.move_s).clamp(0.0, 1.0);
        let (from, to) = (self.position(index as u64), self.position(index as u64 + 1));
        let share = smoother_step(moved);
        let [tilt, direction, heading]: Position =
            std::array::from_fn(|i| from[i] + share * short_way(to[i] - from[i]));
        rotation::tilted(tilt, direction) * rotation::about_z(heading)
    }

    /// Number of attitudes before the grid repeats.
    #[must_use]
    pub fn positions(&self) -> u64 {
        let [tilts, directions, headings] = self.counts();
        tilts * directions * headings
    }

    fn counts(&self) -> [u64; 3] {
        [
            self.tilts.round() as u64 + 1,
            self.directions.round() as u64,
            self.headings.round() as u64,
        ]
    }

    fn position(&self, index: u64) -> Position {
        let [tilts, directions, headings] = self.counts();
        let turn = 2.0 * std::f64::consts::PI;
        let tilt = (index / (headings * directions)) % tilts;
        let direction = (index / headings) % directions;
        [
            self.tilt_deg.to_radians() * tilt as f64 / (tilts - 1).max(1) as f64,
            turn * direction as f64 / directions as f64,
            turn * (index % headings) as f64 / headings as f64,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_device_rests_during_each_dwell_and_never_jumps() {
        let grid = Grid::default();
        let period = grid.dwell_s + grid.move_s;
        for index in 0..grid.positions() * 2 {
            let start = index as f64 * period;
            let rest = grid.attitude(start + 1e-9);
            let end = grid.attitude(start + grid.dwell_s - 1e-9);
            assert!(rotation::angle_between(&rest, &end) < 1e-9);
        }
        let step = 1e-4;
        for index in 0..300_000_u32 {
            let t = f64::from(index) * step;
            let moved = rotation::angle_between(&grid.attitude(t), &grid.attitude(t + step));
            assert!(moved.to_degrees() / step < 1000.0, "at {t} s");
        }
    }

    #[test]
    fn every_tilt_of_the_grid_is_met() {
        let grid = Grid::default();
        let period = grid.dwell_s + grid.move_s;
        let mut met = [0_u32; 3];
        for index in 0..grid.positions() {
            let tilt = libm::acos(grid.attitude(index as f64 * period)[(2, 2)].min(1.0));
            met[(tilt.to_degrees() / 30.0).round() as usize] += 1;
        }
        assert_eq!(met, [16, 16, 16]);
    }
}
