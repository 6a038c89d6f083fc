//! The reference design's constants with their reasons, node names, frame and calibration layouts.
//!
//! A leaf without `std`. The firmware and the golden model meet here and nowhere else: what stands
//! here is agreed (names, rates, scales, layouts), what is computed from it is not shared.
#![no_std]

pub mod calibration;
pub mod flags;
pub mod frame;
pub mod nodes;
pub mod taps;
mod third_tilt;
pub mod timing;

pub use third_tilt::ThirdTilt;

/// Sensor channels in the order in which the controller converts them; the index is the ADC channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Channel {
    /// Thermal accelerometer along body x, on ADC0.
    TiltX = 0,
    /// Thermal accelerometer along body y, on ADC1.
    TiltY = 1,
    /// Lorentz magnetometer along body x, on ADC2.
    FieldX = 2,
    /// Lorentz magnetometer along body y, on ADC3.
    FieldY = 3,
    /// Thermal accelerometer along body z, on ADC4 where it is measured ([`ThirdTilt::Measured`]).
    TiltZ = 4,
}

impl Channel {
    /// The channels of every device, in conversion order.
    pub const ALL: [Channel; 4] = [
        Channel::TiltX,
        Channel::TiltY,
        Channel::FieldX,
        Channel::FieldY,
    ];

    /// The channels of a device that measures its third tilt axis, in conversion order.
    pub const MOST: [Channel; 5] = [
        Channel::TiltX,
        Channel::TiltY,
        Channel::FieldX,
        Channel::FieldY,
        Channel::TiltZ,
    ];

    /// The channel with that ADC input.
    #[must_use]
    pub fn of(index: u8) -> Option<Self> {
        Self::MOST.get(usize::from(index)).copied()
    }
}

/// Sensor channels of every device.
pub const CHANNELS: usize = Channel::ALL.len();

/// Sensor channels of a device that measures its third tilt axis.
pub const MOST_CHANNELS: usize = Channel::MOST.len();

/// Supply and ADC reference of the board in volts: AVCC of the reference board.
pub const REFERENCE_V: f64 = 5.0;

/// Specific force that drives a tilt channel to either rail, in g: 1 g, 50 mg of offset and a
/// margin for motion (docs/sensors.md, section 3).
pub const TILT_FULL_SCALE_G: f64 = 1.2;

/// Field that drives a magnetometer channel to either rail, in microtesla: the Earth's field is at
/// most 65 uT, at the reference site 46 uT (docs/sensors.md, sections 3 and 5).
pub const FIELD_FULL_SCALE_UT: f64 = 60.0;

/// Arguments of the inverse functions are clamped to 1; beyond 1 plus this margin the solution is
/// flagged. Three standard deviations of the heading cosine: the magnetometer's 0.16 uT/rtHz over
/// the 34 Hz of its channel is 0.93 uT, 0.04 of a horizontal field of 24 uT (docs/sensors.md,
/// section 2).
pub const DOMAIN_MARGIN: f64 = 1.0 / 8.0;

/// Yaw is undefined, held and flagged when e1^2 + e2^2 is under this (docs/sensors.md, 7.7).
pub const YAW_LEAST_EAST_SQUARE: f64 = 0.01;

/// The solution is flagged as outside the valid half-space when the squared cosine of the tilt is
/// under this: 0.03 is a tilt of 80 degrees, where the sign of the vertical is no longer certain. A
/// third tilt axis feels 0.17 g there: more than its offset of 50 mg, noise and 0.1 g of motion.
pub const HALF_SPACE_LEAST_DOWN_SQUARE: f64 = 0.03;

/// The signs of the z components are lost when the sum of their squares (g^2 and |B|^2) is under
/// this: 0.1 is body z within about 18 degrees of east or west. Recorded motions by hand shake both
/// squares by up to 0.1 (0.1 g of acceleration, 5 % of field inhomogeneity). More would leave nothing: over
/// a somersault towards north the sum falls to 1 - sin I, 0.14 at the reference site.
pub const HALF_SPACE_LEAST_SUM: f64 = 0.1;

/// [`flags::INCONSISTENT`] is set while the remembered excess of C^2 + S^2 over 1 is over this: a
/// horizontal field that is longer or shorter by a quarter. If that is two standard deviations of what
/// motion does, the heading, which motion turns by as much, is 7 degrees off (one standard deviation),
/// and 30 degrees are four of them.
pub const INCONSISTENCY_LIMIT: f64 = 0.5;

/// [`flags::ACCELERATED`] is set while the remembered excess of the squared specific force over 1 g^2 is
/// over this: an eighth of a g along gravity, or 0.5 g across it, which turns the vertical by 27 degrees.
/// Hands push in all directions alike, so that an eighth along gravity is an eighth (7 degrees) across.
pub const ACCELERATION_LIMIT: f64 = 0.25;

/// The field is flagged as disturbed when the two expressions for the squared product of the
/// vertical components of gravity and field, (sin I - b1 t1 - b2 t2)^2 and
/// (1 - t1^2 - t2^2)(1 - b1^2 - b2^2), differ by more than this, in units of g^2 |B|^2
/// (docs/sensors.md, 7.4: four readings, three unknowns).
pub const FIELD_RESIDUAL_LIMIT: f64 = 0.15;
