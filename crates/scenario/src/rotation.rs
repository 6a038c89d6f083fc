//! Rotation matrices and quaternions with `libm` inside, so that every host gives the same bits.
//!
//! Matrices map vectors of the reference frame (magnetic north, east, down) to body axes
//! (docs/sensors.md, section 7): v_body = M v_ref.

use nalgebra::{Matrix3, Vector3};

/// A unit quaternion (w, x, y, z).
pub type Quaternion = [f64; 4];

/// M = Rx(roll) Ry(pitch) Rz(yaw), set 1 of docs/sensors.md; angles in radians.
#[must_use]
pub fn from_set_1(yaw: f64, pitch: f64, roll: f64) -> Matrix3<f64> {
    about_x(roll) * about_y(pitch) * about_z(yaw)
}

/// Axes turned about x by `angle` radians.
#[must_use]
pub fn about_x(angle: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle);
    Matrix3::new(1.0, 0.0, 0.0, 0.0, c, s, 0.0, -s, c)
}

/// Axes turned about y by `angle` radians.
#[must_use]
pub fn about_y(angle: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle);
    Matrix3::new(c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c)
}

/// Axes turned about z by `angle` radians.
#[must_use]
pub fn about_z(angle: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle);
    Matrix3::new(c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0)
}

/// Body axes tilted by `tilt` radians about the horizontal axis at `azimuth` radians from x.
#[must_use]
pub fn tilted(tilt: f64, azimuth: f64) -> Matrix3<f64> {
    let ((sa, ca), (st, ct)) = (libm::sincos(azimuth), libm::sincos(tilt));
    let v = 1.0 - ct;
    // Rodrigues' formula for axes (not vectors) turned about (ca, sa, 0).
    Matrix3::new(
        ca * ca * v + ct,
        ca * sa * v,
        -sa * st,
        ca * sa * v,
        sa * sa * v + ct,
        ca * st,
        sa * st,
        -ca * st,
        ct,
    )
}

/// The matrix R of a unit quaternion, v' = q v q*.
#[must_use]
pub fn from_quaternion([w, x, y, z]: Quaternion) -> Matrix3<f64> {
    Matrix3::new(
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )
}

/// The point at `fraction` of the shortest way from `a` to `b` (slerp).
#[must_use]
pub fn between(a: Quaternion, b: Quaternion, fraction: f64) -> Quaternion {
    let mut cosine: f64 = a.iter().zip(&b).map(|(p, q)| p * q).sum();
    let sign = if cosine < 0.0 { -1.0 } else { 1.0 };
    cosine *= sign;
    // Under 1e-3 rad the chord is the arc to 1e-7 of its length.
    let (wa, wb) = if cosine > 0.999_999_5 {
        (1.0 - fraction, fraction)
    } else {
        let angle = libm::acos(cosine);
        let sine = libm::sin(angle);
        (
            libm::sin((1.0 - fraction) * angle) / sine,
            libm::sin(fraction * angle) / sine,
        )
    };
    normalised(std::array::from_fn(|i| wa * a[i] + wb * sign * b[i]))
}

/// `q` scaled to length one.
#[must_use]
pub fn normalised(q: Quaternion) -> Quaternion {
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / length)
}

/// Angle in radians of the rotation between two attitudes.
#[must_use]
pub fn angle_between(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    let r = a * b.transpose();
    let axis = Vector3::new(
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    );
    libm::atan2(axis.norm(), r.trace() - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilt_about_x_or_y_is_the_elementary_rotation() {
        for angle in [-1.2, -0.3, 0.0, 0.7, 1.5] {
            assert!((tilted(angle, 0.0) - about_x(angle)).norm() < 1e-15);
            let quarter = std::f64::consts::FRAC_PI_2;
            assert!((tilted(angle, quarter) - about_y(angle)).norm() < 1e-15);
        }
    }

    #[test]
    fn slerp_moves_at_constant_rate_and_takes_the_short_way() {
        let (half, full) = (libm::sincos(0.4), libm::sincos(0.8));
        let a = [1.0, 0.0, 0.0, 0.0];
        let b = [-full.1, 0.0, 0.0, -full.0];
        let middle = between(a, b, 0.5);
        assert!((middle[0] - half.1).abs() < 1e-15 && (middle[3] - half.0).abs() < 1e-15);
    }

    #[test]
    fn the_quaternion_of_a_turn_about_z_turns_vectors_and_not_axes() {
        let (s, c) = libm::sincos(0.3);
        let r = from_quaternion([c, 0.0, 0.0, s]);
        assert!((r - about_z(0.6).transpose()).norm() < 1e-15);
        assert!((angle_between(&r, &Matrix3::identity()) - 0.6).abs() < 1e-14);
    }
}
