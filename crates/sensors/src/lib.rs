//! MEMS physics: acceleration and magnetic field to bridge signals.
//!
//! A sensor is a static input (what its proof mass, gas or beam feels, in its own unit) followed by
//! a linear part with two states ([`LinearSensor`]) that the front end joins with the analog chain
//! and advances exactly. The controller's carrier enters in one of two ways: it reverses the bias
//! of a bridge (accelerometer) or the drive current (magnetometer).

pub mod accelerometer;
pub mod flicker;
pub mod magnetometer;

pub use accelerometer::Accelerometer;
pub use flicker::Flicker;
pub use magnetometer::Magnetometer;

/// Boltzmann's constant in J/K (exact, SI 2019).
pub const BOLTZMANN: f64 = 1.380_649e-23;

/// The body axis along which a sensor lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Body x.
    X,
    /// Body y.
    Y,
    /// Body z (the optional third tilt axis only).
    Z,
}

impl Axis {
    /// Index of the axis and of the two others.
    fn indices(self) -> (usize, [usize; 2]) {
        match self {
            Axis::X => (0, [1, 2]),
            Axis::Y => (1, [0, 2]),
            Axis::Z => (2, [0, 1]),
        }
    }
}

/// Where the carrier, +1 while its pin is high and -1 while low, multiplies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Modulation {
    /// The output: the bias of a bridge is reversed.
    Bias,
    /// The input: the drive current is reversed.
    Drive,
}

/// The linear part of a sensor: x' = a x + b u, output c x volts, u in the sensor's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearSensor {
    /// State matrix, rows, 1/s.
    pub a: [[f64; 2]; 2],
    /// Input vector, volts per second and unit of input.
    pub b: [f64; 2],
    /// Output row.
    pub c: [f64; 2],
    /// Part of the carrier that appears at the output, volts.
    pub feedthrough_v: f64,
    /// Where the carrier multiplies.
    pub modulation: Modulation,
    /// White noise at the input, one-sided density, units of input per rtHz.
    pub input_noise: f64,
    /// White noise at the output, one-sided density, V/rtHz.
    pub output_noise_v: f64,
}

/// One-sided density of a resistor's thermal noise in V/rtHz.
#[must_use]
pub fn thermal_noise_v(ohm: f64, temperature_k: f64) -> f64 {
    (4.0 * BOLTZMANN * temperature_k * ohm).sqrt()
}
