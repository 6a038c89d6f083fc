//! Which sensor axis of a recording lies along which body axis.

use nalgebra::Matrix3;
use serde::Deserialize;

/// A signed axis of the recording's sensor frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum Axis {
    /// Along sensor x.
    #[serde(rename = "x")]
    X,
    /// Along sensor y.
    #[serde(rename = "y")]
    Y,
    /// Along sensor z.
    #[serde(rename = "z")]
    Z,
    /// Against sensor x.
    #[serde(rename = "-x")]
    MinusX,
    /// Against sensor y.
    #[serde(rename = "-y")]
    MinusY,
    /// Against sensor z.
    #[serde(rename = "-z")]
    MinusZ,
}

impl Axis {
    /// As in the scenario file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Axis::X => "x",
            Axis::Y => "y",
            Axis::Z => "z",
            Axis::MinusX => "-x",
            Axis::MinusY => "-y",
            Axis::MinusZ => "-z",
        }
    }

    fn row(self) -> [f64; 3] {
        match self {
            Axis::X => [1.0, 0.0, 0.0],
            Axis::Y => [0.0, 1.0, 0.0],
            Axis::Z => [0.0, 0.0, 1.0],
            Axis::MinusX => [-1.0, 0.0, 0.0],
            Axis::MinusY => [0.0, -1.0, 0.0],
            Axis::MinusZ => [0.0, 0.0, -1.0],
        }
    }
}

/// The sensor axis that lies along each body axis (x forward, z down when level).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mounting {
    /// Sensor axis along body x.
    pub x_body: Axis,
    /// Sensor axis along body y.
    pub y_body: Axis,
    /// Sensor axis along body z.
    pub z_body: Axis,
}

impl Default for Mounting {
    /// For sensors whose z points up.
    fn default() -> Self {
        Self {
            x_body: Axis::Y,
            y_body: Axis::X,
            z_body: Axis::MinusZ,
        }
    }
}

impl Mounting {
    /// The matrix that maps sensor to body components.
    #[must_use]
    pub fn matrix(&self) -> Matrix3<f64> {
        let rows = [self.x_body.row(), self.y_body.row(), self.z_body.row()];
        Matrix3::from_fn(|row, column| rows[row][column])
    }

    /// True if the three axes are a right-handed set.
    #[must_use]
    pub fn is_rotation(&self) -> bool {
        self.matrix().determinant() > 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_a_rotation_that_turns_up_into_down() {
        let mounting = Mounting::default();
        assert!(mounting.is_rotation());
        let body = mounting.matrix() * nalgebra::Vector3::new(1.0, 2.0, 3.0);
        assert_eq!(body, nalgebra::Vector3::new(2.0, 1.0, -3.0));
    }

    #[test]
    fn mirrored_and_degenerate_mountings_are_not_rotations() {
        let mirrored = Mounting {
            z_body: Axis::Z,
            ..Mounting::default()
        };
        let degenerate = Mounting {
            y_body: Axis::Y,
            ..Mounting::default()
        };
        assert!(!mirrored.is_rotation() && !degenerate.is_rotation());
    }
}
