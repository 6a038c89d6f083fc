//! Errors between attitudes, in degrees: per angle of set 1 and as one rotation.

use cardan_golden::{Angles, rotation_angle, set_1_matrix};
use serde::Serialize;

use crate::input::Series;
use crate::metrics::difference;

/// The size of an error over many solutions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    /// Root mean square, degrees; `None` without samples, like the others.
    pub rms_deg: Option<f64>,
    /// 99th percentile of the absolute error (nearest rank).
    pub p99_deg: Option<f64>,
    /// Largest absolute error.
    pub max_deg: Option<f64>,
    /// Solutions that count.
    pub samples: u64,
}

/// Errors of an attitude.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AttitudeErrors {
    /// Of set 1's roll.
    pub roll: Spread,
    /// Of set 1's pitch.
    pub pitch: Spread,
    /// Of set 1's yaw.
    pub yaw: Spread,
    /// The angle of the rotation between the two attitudes.
    pub total: Spread,
}

impl Spread {
    /// Of errors in degrees, with either sign.
    pub(crate) fn of(errors: &[f64]) -> Self {
        if errors.is_empty() {
            return Self::default();
        }
        let mut sizes: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let square: f64 = sizes.iter().map(|size| size * size).sum();
        // Nearest rank: the smallest error that at least 99 % do not exceed.
        let rank = (sizes.len() * 99).div_ceil(100);
        Self {
            rms_deg: Some((square / sizes.len() as f64).sqrt()),
            p99_deg: Some(sizes[rank - 1]),
            max_deg: sizes.last().copied(),
            samples: sizes.len() as u64,
        }
    }
}

/// Signed differences [yaw, pitch, roll] in degrees, each the short way round.
pub(crate) fn angle_errors(value: Angles, reference: Angles) -> [f64; 3] {
    let degrees = |value: f64, reference: f64| 180.0 * difference(value, reference, true);
    [
        degrees(value.yaw.0, reference.yaw.0),
        degrees(value.pitch.0, reference.pitch.0),
        degrees(value.roll.0, reference.roll.0),
    ]
}

/// The angle of the rotation from one attitude to the other, in degrees; exactly 0 for equal ones.
pub(crate) fn rotation_error(value: Angles, reference: Angles) -> f64 {
    if value == reference {
        return 0.0;
    }
    rotation_angle(&set_1_matrix(value), &set_1_matrix(reference)).degrees()
}

/// Errors of `values` against `reference` over the solutions that `counts` admits and both know.
pub(crate) fn errors(
    values: &Series,
    reference: &Series,
    counts: impl Fn(usize) -> bool,
) -> AttitudeErrors {
    let (mut angles, mut total) = ([const { Vec::new() }; 3], Vec::new());
    for solution in 0..values.0.len().min(reference.0.len()) {
        let (Some(value), Some(truth)) = (values.at(solution), reference.at(solution)) else {
            continue;
        };
        if !counts(solution) {
            continue;
        }
        for (all, error) in angles.iter_mut().zip(angle_errors(value, truth)) {
            all.push(error);
        }
        total.push(rotation_error(value, truth));
    }
    AttitudeErrors {
        roll: Spread::of(&angles[2]),
        pitch: Spread::of(&angles[1]),
        yaw: Spread::of(&angles[0]),
        total: Spread::of(&total),
    }
}
