//! From the four averages to an attitude: calibration, both orders, weighting, validity.

use cardan_spec::calibration::Calibration;
use cardan_spec::timing::Averaging;
use cardan_spec::{ACCELERATION_LIMIT, CHANNELS, Channel, YAW_LEAST_EAST_SQUARE, flags};
use cardan_units::HalfTurns;
use nalgebra::{Matrix2, Vector2};

use crate::domain::{Domain, root};
use crate::half_space::{HalfSpace, Vertical};
use crate::node;
use crate::orders::{self, Heading, Tilt};
use crate::rotation::{Angles, Attitude, EarthField, Readings, set_1_matrix};
use crate::unrest::Unrest;

/// What a third tilt axis tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Third {
    /// The comparator: whether gravity along body z is negative.
    Sign {
        /// It is.
        upside_down: bool,
    },
    /// The converter: gravity along body z in g.
    Measured(f64),
}

impl Third {
    /// As the node `tilt_z` holds it: the reading, or the sign of gravity along body z.
    #[must_use]
    pub fn t3(self) -> f64 {
        match self {
            Self::Sign { upside_down: true } => -1.0,
            Self::Sign { upside_down: false } => 1.0,
            Self::Measured(t3) => t3,
        }
    }
}

/// What one solution leaves for the next: the last defined yaw (0 at first), the tracked signs and the
/// motion of late; and what a third tilt axis tells.
#[derive(Clone, Debug, PartialEq)]
pub struct Memory {
    /// What a third tilt axis tells; `None` where none is fitted. It holds for every solution until it is
    /// changed.
    pub third: Option<Third>,
    yaw: HalfTurns,
    half_space: HalfSpace,
    unrest: Unrest,
}

impl Memory {
    /// That of a device just after reset, which solves once per period of `averaging`.
    #[must_use]
    pub fn new(averaging: Averaging) -> Self {
        Self {
            third: None,
            yaw: HalfTurns::default(),
            half_space: HalfSpace::default(),
            unrest: Unrest::new(averaging),
        }
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new(Averaging::DEFAULT)
    }
}

/// One solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Set 1's yaw, in -1..1.
    pub yaw: HalfTurns,
    /// Set 1's pitch.
    pub pitch: HalfTurns,
    /// Set 1's roll, in -1..1.
    pub roll: HalfTurns,
    /// Status bits ([`cardan_spec::flags`]). The golden model never sets uncalibrated or late.
    pub flags: u16,
    /// The attitude that the three angles name.
    pub attitude: Attitude,
}

impl Solution {
    /// The three angles.
    #[must_use]
    pub fn angles(&self) -> Angles {
        Angles {
            yaw: self.yaw,
            pitch: self.pitch,
            roll: self.roll,
        }
    }
}

/// Applies the calibration to averages over full scale, in channel order.
#[must_use]
pub fn calibrate(averages: &[f64; CHANNELS], calibration: &Calibration) -> Readings {
    let pair = |x: Channel, y: Channel, matrix: &[[f64; 2]; 2], offset: [f64; 2]| {
        let average = Vector2::new(averages[x as usize], averages[y as usize]);
        let matrix = Matrix2::new(matrix[0][0], matrix[0][1], matrix[1][0], matrix[1][1]);
        (matrix * (average - Vector2::from(offset))).into()
    };
    Readings {
        tilt: pair(
            Channel::TiltX,
            Channel::TiltY,
            &calibration.tilt_matrix,
            calibration.tilt_offset,
        ),
        field: pair(
            Channel::FieldX,
            Channel::FieldY,
            &calibration.field_matrix,
            calibration.field_offset,
        ),
    }
}

/// Solves one set of averages (fractions of full scale, in channel order), and that of the third tilt axis
/// where it is measured, which then is what `memory` says of it. `record` takes each
/// node's index in [`cardan_spec::nodes::SHARED`] and value at each write, in signal order, from the
/// averages on. The saturation flag is the caller's, who has seen the conversions.
pub fn solve(
    averages: &[f64; CHANNELS],
    tilt_z: Option<f64>,
    calibration: &Calibration,
    memory: &mut Memory,
    record: &mut impl FnMut(usize, f64),
) -> Solution {
    for &average in averages.iter().chain(&tilt_z) {
        record(node::AVERAGE, average);
    }
    if let Some(average) = tilt_z {
        let t3 = calibration.tilt_z_gain * (average - calibration.tilt_z_offset);
        memory.third = Some(Third::Measured(t3));
    }
    solve_readings(
        &calibrate(averages, calibration),
        EarthField::from(calibration),
        memory,
        record,
    )
}

/// Solves one set of calibrated readings; see [`solve`].
pub fn solve_readings(
    readings: &Readings,
    earth: EarthField,
    memory: &mut Memory,
    record: &mut impl FnMut(usize, f64),
) -> Solution {
    record(node::TILT_X, readings.tilt[0]);
    record(node::TILT_Y, readings.tilt[1]);
    record(node::TILT_Z, memory.third.map_or(0.0, Third::t3));
    record(node::FIELD_X, readings.field[0]);
    record(node::FIELD_Y, readings.field[1]);
    let mut domain = Domain::default();
    let Gravity {
        readings,
        down_square,
        force_excess,
    } = gravity(readings, memory.third);
    record(node::GRAVITY_X, readings.tilt[0]);
    record(node::GRAVITY_Y, readings.tilt[1]);

    let down = root(down_square);
    let tilt_1 = orders::tilt_1(&readings, down, &mut domain);
    let tilt_2 = orders::tilt_2(&readings, down, &mut domain);
    record(node::COS_1, tilt_1.cos_pitch);
    record(node::COS_2, tilt_2.cos_roll);
    record(node::DOWN, down);

    let heading_1 = orders::heading_1(&readings, &tilt_1, earth, &mut domain);
    let heading_2 = orders::heading_2(&readings, &tilt_2, earth, &mut domain);
    record(node::HEADING_COS_1, heading_1.cosine);
    record(node::HEADING_SIN_2, heading_2.sine);
    let yaw_2 = in_set_1(&tilt_2, &heading_2);
    record(node::YAW_1, heading_1.yaw.0);
    record(node::YAW_2, yaw_2.0);
    let east = orders::east_1(&tilt_1, &heading_1);
    let upright_yaw = weighed(east, heading_1.yaw, yaw_2, record);

    let vertical = Vertical::with_down_square(&readings, down_square, earth);
    let side = memory.half_space.track(&vertical, memory.third);
    if let Some(yaw) = upright_yaw {
        memory.yaw = HalfTurns(if side.is_upside_down { -yaw.0 } else { yaw.0 }).wrapped();
    }
    let angles = angles(memory.yaw, &tilt_1, side.is_upside_down);
    record(node::YAW, angles.yaw.0);
    record(node::PITCH, angles.pitch.0);
    record(node::ROLL, angles.roll.0);

    record(node::DIP_PRODUCT, vertical.dip_product);
    record(node::FIELD_Z_SQUARE, vertical.field_square);
    let heading_square = heading_1.cosine * heading_1.cosine + heading_1.sine * heading_1.sine;
    let unrest = memory.unrest.track(heading_square, force_excess, record);

    let flags = bit(flags::HALF_SPACE, side.is_flagged)
        | bit(flags::DISTURBED, vertical.is_disturbed())
        | bit(flags::DOMAIN, domain.was_left())
        | bit(flags::YAW_HELD, upright_yaw.is_none())
        | unrest;
    Solution {
        yaw: angles.yaw,
        pitch: angles.pitch,
        roll: angles.roll,
        flags,
        attitude: set_1_matrix(angles),
    }
}

/// What the readings say of gravity.
struct Gravity {
    /// With gravity's direction in place of the tilt readings where all three axes are measured.
    readings: Readings,
    /// d3^2.
    down_square: f64,
    /// By how much the squared specific force differs from gravity's; without a third axis only if it is
    /// larger.
    force_excess: f64,
}

/// Gravity's direction. A force that cannot be gravity's alone (the limit of
/// [`cardan_spec::flags::ACCELERATED`]) is scaled as one at the limit.
fn gravity(readings: &Readings, third: Option<Third>) -> Gravity {
    let down_square = orders::down_square(readings);
    let Some(Third::Measured(t3)) = third else {
        return Gravity {
            readings: *readings,
            down_square,
            force_excess: (-down_square).max(0.0),
        };
    };
    let [t1, t2] = readings.tilt;
    let square = t1 * t1 + t2 * t2 + t3 * t3;
    let likely = square.clamp(1.0 - ACCELERATION_LIMIT, 1.0 + ACCELERATION_LIMIT);
    let inverse = 1.0 / likely.sqrt();
    Gravity {
        readings: Readings {
            tilt: [t1 * inverse, t2 * inverse],
            ..*readings
        },
        down_square: (t3 * inverse) * (t3 * inverse),
        force_excess: (square - 1.0).abs(),
    }
}

/// Set 1's angles, turned to the other attitude of the same readings if the device is upside down (7.4);
/// the yaw has been turned.
fn angles(yaw: HalfTurns, tilt: &Tilt, is_upside_down: bool) -> Angles {
    let roll = HalfTurns::from_radians(libm::asin(tilt.sin_roll.clamp(-1.0, 1.0)));
    Angles {
        yaw,
        pitch: HalfTurns::from_radians(libm::asin(tilt.sin_pitch)),
        roll: if is_upside_down {
            HalfTurns(1.0 - roll.0).wrapped()
        } else {
            roll
        },
    }
}

const fn bit(flag: u16, set: bool) -> u16 {
    if set { flag } else { 0 }
}

/// Set 2's yaw as set 1 would name it: from the matrix elements M01 and M00 (7.3).
fn in_set_1(tilt: &Tilt, heading: &Heading) -> HalfTurns {
    let matrix = orders::matrix_2(tilt, heading.yaw);
    HalfTurns::from_radians(libm::atan2(matrix[(0, 1)], matrix[(0, 0)]))
}

/// The two yaws weighed by the squares of east's body components e1 and e2 (7.6); none where body z is so
/// near east or west that both vanish.
fn weighed(
    (e1, e2): (f64, f64),
    yaw_1: HalfTurns,
    yaw_2: HalfTurns,
    record: &mut impl FnMut(usize, f64),
) -> Option<HalfTurns> {
    let east_square = e1 * e1 + e2 * e2;
    if east_square < YAW_LEAST_EAST_SQUARE {
        record(node::WEIGHT_1, e1 * e1);
        return None;
    }
    let weight_1 = e1 * e1 / east_square;
    record(node::WEIGHT_1, weight_1);
    let difference = HalfTurns(yaw_1.0 - yaw_2.0).wrapped();
    Some(HalfTurns(yaw_2.0 + weight_1 * difference.0))
}
