//! The maximum-likelihood attitude from all four readings: the statistical optimum.
//!
//! For Gaussian noise it minimises the sum of squared residuals over their variances, by
//! Gauss-Newton steps on a small rotation of the body, damped (Levenberg-Marquardt) where a full
//! step would not descend. It is what the closed-form solutions are measured against
//! (docs/sensors.md, 7.6); no device computes it.

use nalgebra::{Matrix3, Matrix4x3, Vector3, Vector4};

use crate::rotation::{Attitude, EarthField, Readings, ideal_readings};

/// Standard deviations of the readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Of t1 and t2, in g.
    pub tilt: f64,
    /// Of b1 and b2, over |B|.
    pub field: f64,
}

/// The most likely attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The attitude.
    pub attitude: Attitude,
    /// Half the sum of squared residuals over their variances: minus the log-likelihood, up to a
    /// constant.
    pub cost: f64,
    /// Steps tried.
    pub steps: u32,
    /// False when the steps ran out before they became negligible.
    pub converged: bool,
}

/// With residuals of several standard deviations near 90 degrees tilt the steps shrink by as little
/// as a sixth each; 100 are then not enough.
const MOST_STEPS: u32 = 1000;
/// A step in radians (6e-7 degrees) below which rounding hides any change of the cost.
const NEGLIGIBLE_STEP: f64 = 1e-8;

/// The attitude that makes `readings` most likely, next to `start` (in practice a closed-form
/// solution: the four readings fit two attitudes, 7.4).
#[must_use]
pub fn maximum_likelihood(
    readings: &Readings,
    earth: EarthField,
    noise: Noise,
    start: &Attitude,
) -> Estimate {
    let mut estimate = Estimate {
        attitude: *start,
        cost: cost(readings, earth, noise, start),
        steps: 0,
        converged: false,
    };
    let mut damping = 0.0;
    while estimate.steps < MOST_STEPS && !estimate.converged {
        estimate.steps += 1;
        let Some(step) = damped_step(readings, earth, noise, &estimate.attitude, damping) else {
            damping = raised(damping);
            continue;
        };
        let attitude = turned(&estimate.attitude, &step);
        let cost = cost(readings, earth, noise, &attitude);
        estimate.converged = step.norm() < NEGLIGIBLE_STEP;
        if cost <= estimate.cost {
            estimate.attitude = attitude;
            estimate.cost = cost;
            damping *= 0.1;
        } else {
            damping = raised(damping);
        }
    }
    estimate
}

fn raised(damping: f64) -> f64 {
    (damping * 10.0).max(1e-6)
}

/// Residuals (reading - expectation) over their standard deviations.
fn residuals(
    readings: &Readings,
    earth: EarthField,
    noise: Noise,
    attitude: &Attitude,
) -> Vector4<f64> {
    let expected = ideal_readings(attitude, earth);
    Vector4::new(
        (readings.tilt[0] - expected.tilt[0]) / noise.tilt,
        (readings.tilt[1] - expected.tilt[1]) / noise.tilt,
        (readings.field[0] - expected.field[0]) / noise.field,
        (readings.field[1] - expected.field[1]) / noise.field,
    )
}

fn cost(readings: &Readings, earth: EarthField, noise: Noise, attitude: &Attitude) -> f64 {
    0.5 * residuals(readings, earth, noise, attitude).norm_squared()
}

/// Turns the body by the rotation vector `w` (radians, body axes): any vector fixed to the Earth
/// then moves by -w x v as the body sees it. Rodrigues' formula, exact for any length.
fn turned(attitude: &Attitude, w: &Vector3<f64>) -> Attitude {
    let angle = w.norm();
    let cross = w.cross_matrix();
    let (sinc, versinc) = if angle < 1e-6 {
        (1.0, 0.5)
    } else {
        let (sine, cosine) = libm::sincos(angle);
        (sine / angle, (1.0 - cosine) / (angle * angle))
    };
    (Matrix3::identity() - cross * sinc + cross * cross * versinc) * attitude
}

/// Derivatives of the readings over their standard deviations, by a small rotation of the body.
fn jacobian(earth: EarthField, noise: Noise, attitude: &Attitude) -> Matrix4x3<f64> {
    let down = attitude.column(2).into_owned();
    let field = attitude.column(0) * earth.horizontal + down * earth.vertical;
    // d(v)/dw of -w x v = v x w is the cross matrix of v; two of its rows are measured.
    let tilt_rows = down.cross_matrix() / noise.tilt;
    let field_rows = field.cross_matrix() / noise.field;
    Matrix4x3::from_rows(&[
        tilt_rows.row(0).into_owned(),
        tilt_rows.row(1).into_owned(),
        field_rows.row(0).into_owned(),
        field_rows.row(1).into_owned(),
    ])
}

/// The Cramer-Rao bound: the least mean square of the rotation angle, in radians squared, that any
/// unbiased estimate from readings with this noise can have; `None` where they leave a rotation open.
#[must_use]
pub fn cramer_rao(earth: EarthField, noise: Noise, attitude: &Attitude) -> Option<f64> {
    let jacobian = jacobian(earth, noise, attitude);
    let information = jacobian.transpose() * jacobian;
    Some(information.try_inverse()?.trace())
}

/// The step that solves (J'J + damping (diag(J'J) + 1)) w = J' r; `None` where that is singular,
/// which it cannot be once damped.
fn damped_step(
    readings: &Readings,
    earth: EarthField,
    noise: Noise,
    attitude: &Attitude,
    damping: f64,
) -> Option<Vector3<f64>> {
    let jacobian = jacobian(earth, noise, attitude);
    let mut normal = jacobian.transpose() * jacobian;
    for axis in 0..3 {
        normal[(axis, axis)] += damping * (normal[(axis, axis)] + 1.0);
    }
    let gradient = jacobian.transpose() * residuals(readings, earth, noise, attitude);
    Some(normal.cholesky()?.solve(&gradient))
}
