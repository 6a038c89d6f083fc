//! The reference site's field, and attitudes by their angles.
#![allow(dead_code, reason = "each test program uses a part")]

use cardan_golden::{Angles, Attitude, EarthField, set_1_matrix};
use cardan_units::HalfTurns;

/// Over the field's length.
pub(crate) const EARTH: EarthField = EarthField {
    horizontal: 0.510_087_9,
    vertical: 0.860_122_3,
};

/// Set 1's angles in degrees.
pub(crate) fn angles(yaw: f64, pitch: f64, roll: f64) -> Angles {
    Angles {
        yaw: HalfTurns::from_degrees(yaw),
        pitch: HalfTurns::from_degrees(pitch),
        roll: HalfTurns::from_degrees(roll),
    }
}

/// The attitude of these angles.
pub(crate) fn attitude(yaw: f64, pitch: f64, roll: f64) -> Attitude {
    set_1_matrix(angles(yaw, pitch, roll))
}
