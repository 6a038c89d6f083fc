//! The heading from the four readings, once per rotation order (docs/sensors.md, 7.2 and 7.3).
//!
//! Both are written for the upright half-space. Sines and cosines of the tilt come from the readings
//! and sqrt(1 - t^2), never from re-evaluated angles (7.7).

use cardan_units::HalfTurns;
use nalgebra::Matrix3;

use crate::domain::{Domain, root};
use crate::rotation::{EarthField, Readings};

/// Tilt of one rotation order: sines and cosines of its angles about y (pitch) and x (roll).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilt {
    /// Sine of the angle about y.
    pub sin_pitch: f64,
    /// Cosine of the angle about y.
    pub cos_pitch: f64,
    /// Sine of the angle about x.
    pub sin_roll: f64,
    /// Cosine of the angle about x.
    pub cos_roll: f64,
}

/// Heading of one rotation order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heading {
    /// C before clamping.
    pub cosine: f64,
    /// S before clamping.
    pub sine: f64,
    /// Phi of this order, by acos (set 1) or asin (set 2) of one and the sign of the other.
    pub yaw: HalfTurns,
}

/// d3^2 of two tilt axes, 1 - t1^2 - t2^2; noise may make it negative.
pub(crate) fn down_square(readings: &Readings) -> f64 {
    let [t1, t2] = readings.tilt;
    1.0 - t1 * t1 - t2 * t2
}

/// Set 1: theta = -asin(t1) about y, psi = asin(t2 / cos theta) about x; `down` is |d3|. Readings of gravity that are too
/// long leave d3 at zero, and that is remembered where it is a divisor; the quotient stands as it is then,
/// beyond 1, and only an angle made of it is limited.
pub(crate) fn tilt_1(readings: &Readings, down: f64, domain: &mut Domain) -> Tilt {
    let [t1, t2] = readings.tilt;
    let cos_pitch = root(1.0 - t1 * t1);
    let sin_roll = domain.quotient(t2, cos_pitch);
    Tilt {
        sin_pitch: -t1.clamp(-1.0, 1.0),
        cos_pitch,
        sin_roll,
        cos_roll: domain.quotient(down, cos_pitch),
    }
}

/// Set 2: theta = asin(t2) about x, psi = -asin(t1 / cos theta) about y.
pub(crate) fn tilt_2(readings: &Readings, down: f64, domain: &mut Domain) -> Tilt {
    let [t1, t2] = readings.tilt;
    let cos_roll = root(1.0 - t2 * t2);
    let sin_pitch = domain.quotient(-t1, cos_roll);
    Tilt {
        sin_pitch,
        cos_pitch: domain.quotient(down, cos_roll),
        sin_roll: t2.clamp(-1.0, 1.0),
        cos_roll,
    }
}

/// Set 1: C = (b1 - v t1) / (h cos theta), S from (4') with the sign that 7.2 corrects,
/// Phi = sgn(S) acos(C).
pub(crate) fn heading_1(
    readings: &Readings,
    tilt: &Tilt,
    earth: EarthField,
    domain: &mut Domain,
) -> Heading {
    let (h, v) = (earth.horizontal, earth.vertical);
    let ([t1, t2], [b1, b2]) = (readings.tilt, readings.field);
    let cosine = domain.quotient(b1 - v * t1, h * tilt.cos_pitch);
    let sine = domain.quotient(
        h * tilt.sin_roll * tilt.sin_pitch * cosine + v * t2 - b2,
        h * tilt.cos_roll,
    );
    let magnitude = libm::acos(domain.unit(cosine));
    let yaw = if sine < 0.0 { -magnitude } else { magnitude };
    Heading {
        cosine,
        sine,
        yaw: HalfTurns::from_radians(yaw),
    }
}

/// Set 2: S = (v t2 - b2) / (h cos theta), Phi = asin(S), or pi - asin(S) where C < 0.
pub(crate) fn heading_2(
    readings: &Readings,
    tilt: &Tilt,
    earth: EarthField,
    domain: &mut Domain,
) -> Heading {
    let (h, v) = (earth.horizontal, earth.vertical);
    let ([t1, t2], [b1, b2]) = (readings.tilt, readings.field);
    let sine = domain.quotient(v * t2 - b2, h * tilt.cos_roll);
    let cosine = domain.quotient(
        b1 - v * t1 + h * tilt.sin_pitch * tilt.sin_roll * sine,
        h * tilt.cos_pitch,
    );
    let magnitude = HalfTurns::from_radians(libm::asin(domain.unit(sine)));
    let yaw = if cosine < 0.0 {
        HalfTurns(1.0 - magnitude.0).wrapped()
    } else {
        magnitude
    };
    Heading { cosine, sine, yaw }
}

/// Set 2's attitude in terms of its tilt and heading: M2 = Ry(psi) Rx(theta) Rz(Phi).
pub(crate) fn matrix_2(tilt: &Tilt, yaw: HalfTurns) -> Matrix3<f64> {
    let (sy, cy) = libm::sincos(yaw.radians());
    let (sp, cp, sr, cr) = (tilt.sin_pitch, tilt.cos_pitch, tilt.sin_roll, tilt.cos_roll);
    let about_y = Matrix3::new(cp, 0.0, -sp, 0.0, 1.0, 0.0, sp, 0.0, cp);
    let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, cr, sr, 0.0, -sr, cr);
    let about_z = Matrix3::new(cy, sy, 0.0, -sy, cy, 0.0, 0.0, 0.0, 1.0);
    about_y * about_x * about_z
}

/// e1 and e2: the body's x and y components of east, from set 1's atan2(S, C) solution, which is
/// never singular under 90 degrees tilt (7.5, 7.6).
pub(crate) fn east_1(tilt: &Tilt, heading: &Heading) -> (f64, f64) {
    let (sy, cy) = libm::sincos(libm::atan2(heading.sine, heading.cosine));
    let e1 = tilt.cos_pitch * sy;
    let e2 = tilt.sin_roll * tilt.sin_pitch * sy + tilt.cos_roll * cy;
    (e1, e2)
}

/// Both headings of `readings`, in set 1's and in set 2's own angles: for studies of the estimators.
#[must_use]
pub fn headings(readings: &Readings, earth: EarthField) -> [Heading; 2] {
    let mut domain = Domain::default();
    let down = root(down_square(readings));
    let tilt_1 = tilt_1(readings, down, &mut domain);
    let tilt_2 = tilt_2(readings, down, &mut domain);
    [
        heading_1(readings, &tilt_1, earth, &mut domain),
        heading_2(readings, &tilt_2, earth, &mut domain),
    ]
}
