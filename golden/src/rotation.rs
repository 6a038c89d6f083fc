//! Attitudes as matrices, as angles of both rotation orders, and as the readings they cause.
//!
//! Source: docs/sensors.md, section 7 (set 1 = Z-Y-X, set 2 = Z-X-Y; both name the same attitude
//! with different angles).

use cardan_spec::calibration::Calibration;
use cardan_units::HalfTurns;
use nalgebra::{Matrix2, Matrix3, Vector2};

/// An attitude M, with v_body = M v_reference; rows are body x, y, z, columns north, east, down.
pub type Attitude = Matrix3<f64>;

/// Three angles of one rotation order. In set 1 (yaw, pitch, roll) are (Phi, theta about y, psi
/// about x); in set 2 pitch is psi, still about y, and roll is theta, still about x.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Angles {
    /// About the vertical, first.
    pub yaw: HalfTurns,
    /// About the body's y axis: second in set 1, last in set 2.
    pub pitch: HalfTurns,
    /// About the body's x axis: last in set 1, second in set 2.
    pub roll: HalfTurns,
}

/// Direction of the Earth's field: its horizontal and downward components over |B|.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthField {
    /// h, towards magnetic north: the cosine of the inclination.
    pub horizontal: f64,
    /// v, downward: the sine of the inclination.
    pub vertical: f64,
}

impl From<&Calibration> for EarthField {
    fn from(calibration: &Calibration) -> Self {
        Self {
            horizontal: calibration.horizontal,
            vertical: calibration.vertical,
        }
    }
}

/// What the four channels stand for after calibration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readings {
    /// t1, t2: gravity along body x and y in g.
    pub tilt: [f64; 2],
    /// b1, b2: field along body x and y over |B|.
    pub field: [f64; 2],
}

fn about_x(angle: HalfTurns) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle.radians());
    Matrix3::new(1.0, 0.0, 0.0, 0.0, c, s, 0.0, -s, c)
}

fn about_y(angle: HalfTurns) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle.radians());
    Matrix3::new(c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c)
}

fn about_z(angle: HalfTurns) -> Matrix3<f64> {
    let (s, c) = libm::sincos(angle.radians());
    Matrix3::new(c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0)
}

/// M1 = Rx(roll) Ry(pitch) Rz(yaw), set 1.
#[must_use]
pub fn set_1_matrix(angles: Angles) -> Attitude {
    about_x(angles.roll) * about_y(angles.pitch) * about_z(angles.yaw)
}

/// M2 = Ry(pitch) Rx(roll) Rz(yaw), set 2.
#[must_use]
pub fn set_2_matrix(angles: Angles) -> Attitude {
    about_y(angles.pitch) * about_x(angles.roll) * about_z(angles.yaw)
}

/// Set 1's angles of any attitude, upside down included; pitch is in -90..=90 degrees. At a pitch of
/// +-90 degrees, where yaw and roll are not unique, the roll is 0.
#[must_use]
pub fn angles_of(m: &Attitude) -> Angles {
    let cos_pitch = libm::hypot(m[(0, 0)], m[(0, 1)]);
    let pitch = libm::atan2(-m[(0, 2)], cos_pitch);
    let (yaw, roll) = if cos_pitch == 0.0 {
        (libm::atan2(-m[(1, 0)], m[(1, 1)]), 0.0)
    } else {
        (
            libm::atan2(m[(0, 1)], m[(0, 0)]),
            libm::atan2(m[(1, 2)], m[(2, 2)]),
        )
    };
    Angles {
        yaw: HalfTurns::from_radians(yaw),
        pitch: HalfTurns::from_radians(pitch),
        roll: HalfTurns::from_radians(roll),
    }
}

/// Angle of the rotation that takes one attitude to the other, 0..=1 half turns. Its sine and cosine
/// come from different elements of the product, so that it keeps its accuracy at both ends.
#[must_use]
pub fn rotation_angle(left: &Attitude, right: &Attitude) -> HalfTurns {
    let r = left * right.transpose();
    let (x, y, z) = (
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    );
    let double_sine = (x * x + y * y + z * z).sqrt();
    HalfTurns::from_radians(libm::atan2(double_sine, r.trace() - 1.0))
}

/// What ideal sensors at rest read at an attitude.
#[must_use]
pub fn ideal_readings(attitude: &Attitude, field: EarthField) -> Readings {
    let along =
        |row: usize| field.horizontal * attitude[(row, 0)] + field.vertical * attitude[(row, 2)];
    Readings {
        tilt: [attitude[(0, 2)], attitude[(1, 2)]],
        field: [along(0), along(1)],
    }
}

/// The bipolar codes, in channel order and without the converter's steps, at which a device with
/// this calibration shows `readings`: what an ideal memoryless sensor would feed the golden model.
/// `None` when a calibration matrix has no inverse.
#[must_use]
pub fn codes_of(readings: &Readings, calibration: &Calibration) -> Option<[f64; 4]> {
    let scale = f64::from(cardan_units::AdcCode::CENTRE);
    let pair = |values: [f64; 2], matrix: &[[f64; 2]; 2], offset: [f64; 2]| {
        let matrix = Matrix2::new(matrix[0][0], matrix[0][1], matrix[1][0], matrix[1][1]);
        let average = matrix.try_inverse()? * Vector2::from(values) + Vector2::from(offset);
        Some(average * scale)
    };
    let tilt = pair(
        readings.tilt,
        &calibration.tilt_matrix,
        calibration.tilt_offset,
    )?;
    let field = pair(
        readings.field,
        &calibration.field_matrix,
        calibration.field_offset,
    )?;
    Some([tilt[0], tilt[1], field[0], field[1]])
}

/// The same of a third tilt axis that reads `gravity_g` along body z, in g. `None` when its gain is 0.
#[must_use]
pub fn code_of_tilt_z(gravity_g: f64, calibration: &Calibration) -> Option<f64> {
    let gain = calibration.tilt_z_gain;
    let average = gravity_g / gain + calibration.tilt_z_offset;
    (gain != 0.0).then(|| average * f64::from(cardan_units::AdcCode::CENTRE))
}
