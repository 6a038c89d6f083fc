//! Rests in one attitude after the other, as on a turntable that calibrates units.
//!
//! Attitudes lie on a spiral of equal areas around down (Fibonacci's lattice), with headings of a
//! low-discrepancy sequence; the seed turns both. From one to the next the device turns smoothly.

use std::ops::Range;

use nalgebra::Matrix3;

use crate::random::{Random, Source};
use crate::rotation;
use crate::sweep::smoother_step;

/// Time from one attitude to the next in seconds.
const MOVE_S: f64 = 0.04;

/// Steps of the azimuth and of the heading in turns: irrational, far from each other's multiples
/// (golden section; its generalisation to two dimensions).
const STEPS: [f64; 2] = [0.618_033_988_749_894_9, 0.754_877_666_246_692_8];

const TURN: f64 = 2.0 * std::f64::consts::PI;

/// Attitudes and how long the device rests in each.
#[derive(Clone, Debug, PartialEq)]
pub struct Poses {
    /// Tilt, azimuth of its axis and heading in radians.
    positions: Vec<[f64; 3]>,
    rest_s: f64,
}

impl Poses {
    /// `count` attitudes (at least one) with tilts up to `tilt_deg`, 180 for the whole sphere, at
    /// rest for `rest_s` in each. The first is the most upright; the order of the others mixes tilts
    /// and directions, so that slow drifts do not look like a dependence on attitude.
    #[must_use]
    pub fn spread(seed: u64, count: usize, tilt_deg: f64, rest_s: f64) -> Self {
        let mut random = Random::new(seed, Source::Attitudes);
        let phases = [random.uniform(), random.uniform()];
        let count = count.max(1);
        let cap = 1.0 - libm::cos(tilt_deg.to_radians());
        let position = |index: usize| {
            let share = (index as f64 + 0.5) / count as f64;
            let [azimuth, heading] =
                [0, 1].map(|i| TURN * (phases[i] + index as f64 * STEPS[i]).fract());
            [libm::acos(1.0 - cap * share), azimuth, heading]
        };
        let stride = stride(count);
        Self {
            positions: (0..count)
                .map(|turn| position(turn * stride % count))
                .collect(),
            rest_s,
        }
    }

    /// Number of attitudes.
    #[must_use]
    pub fn count(&self) -> usize {
        self.positions.len()
    }

    /// Seconds after reset between which the device rests in attitude `index`.
    #[must_use]
    pub fn rest(&self, index: usize) -> Range<f64> {
        let start = index as f64 * (self.rest_s + MOVE_S);
        start..start + self.rest_s
    }

    /// The attitude `t_s` seconds after reset: reference (magnetic NED) to body. The last stays.
    #[must_use]
    pub fn attitude(&self, t_s: f64) -> Matrix3<f64> {
        let last = self.count() - 1;
        let index = ((t_s / (self.rest_s + MOVE_S)).floor().max(0.0) as usize).min(last);
        let (from, to) = (self.positions[index], self.positions[(index + 1).min(last)]);
        let share = smoother_step((t_s - self.rest(index).end) / MOVE_S);
        let [tilt, azimuth, heading]: [f64; 3] =
            std::array::from_fn(|i| from[i] + share * short_way(to[i] - from[i]));
        rotation::tilted(tilt, azimuth) * rotation::about_z(heading)
    }
}

/// The step nearest to the golden section of `count` that visits all in turn, modulo `count`.
fn stride(count: usize) -> usize {
    let golden = (count as f64 * STEPS[0]).round() as usize;
    let coprime = |step: &usize| gcd(*step, count) == 1;
    (golden.max(1)..=count).find(coprime).unwrap_or(1)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// The same turn by at most half a turn.
pub(crate) fn short_way(angle: f64) -> f64 {
    angle - TURN * (angle / TURN).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twelve_attitudes_or_more_reach_both_signs_of_every_axis_under_any_seed() {
        for seed in 0..200 {
            for count in [12, 17, 24, 100] {
                let poses = Poses::spread(seed, count, 180.0, 0.2);
                let (mut least, mut most) = ([0.0_f64; 3], [0.0_f64; 3]);
                for index in 0..count {
                    let down = poses
                        .attitude(poses.rest(index).start)
                        .column(2)
                        .into_owned();
                    for axis in 0..3 {
                        least[axis] = least[axis].min(down[axis]);
                        most[axis] = most[axis].max(down[axis]);
                    }
                }
                assert!(least.iter().all(|v| *v < -0.65), "{seed} {count} {least:?}");
                assert!(most.iter().all(|v| *v > 0.65), "{seed} {count} {most:?}");
            }
        }
    }

    #[test]
    fn the_device_rests_where_it_says_and_keeps_within_the_tilt_on_its_way() {
        let poses = Poses::spread(5, 30, 60.0, 0.1);
        for index in 0..poses.count() {
            let rest = poses.rest(index);
            let (start, end) = (poses.attitude(rest.start), poses.attitude(rest.end));
            assert!(rotation::angle_between(&start, &end) < 1e-9);
        }
        let mut before = poses.attitude(0.0);
        for step in 0..50_000 {
            let now = poses.attitude(f64::from(step) * 1e-4);
            assert!(now[(2, 2)] >= 0.5 - 1e-9);
            assert!(rotation::angle_between(&before, &now).to_degrees() < 6.0);
            before = now;
        }
    }

    #[test]
    fn every_attitude_is_visited_once_and_the_order_does_not_follow_the_tilt() {
        for count in [1, 2, 6, 24, 97, 100] {
            let mut seen: Vec<usize> = (0..count)
                .map(|turn| turn * stride(count) % count)
                .collect();
            let slope: f64 = (seen.iter().enumerate())
                .map(|(turn, &index)| (turn as f64 - index as f64).powi(2))
                .sum();
            // Spearman's rank correlation is 1 - 6 sum / (n (n^2 - 1)).
            let n = count as f64;
            assert!(
                count < 10 || (1.0 - 6.0 * slope / (n * (n * n - 1.0))).abs() < 0.3,
                "{count}"
            );
            seen.sort_unstable();
            assert_eq!(seen, (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn another_seed_gives_other_attitudes() {
        let [a, b] = [1, 2].map(|seed| Poses::spread(seed, 8, 180.0, 0.1));
        assert_ne!(a, b);
        assert_eq!(a, Poses::spread(1, 8, 180.0, 0.1));
    }
}
