//! The attitude: calibration, both Cardan solutions, their weighted mean, validity.
//!
//! Equations: docs/sensors.md, sections 7.2 (set 1, Z-Y-X), 7.3 (set 2, Z-X-Y), 7.6 (weights), 7.7
//! (domains). Letters: t1, t2 gravity along body x, y in g; b1, b2 field over |B|; h, v cosine and
//! sine of the inclination; C, S cosine and sine of a heading. All angles are set 1's unless said.
//! Sines and cosines come from the readings, never from angles.
//!
//! Everything is computed for the upright half-space; where gravity's z component is negative, yaw and
//! roll are turned at the end (7.4). A Rust `if` on whether a third tilt axis is fitted, and how, is allowed:
//! it is constant in a run.

mod constants;
mod heading;
mod tilt;
mod unrest;
mod validity;

use cardan_datapath::{Arithmetic, Node, Value};
use cardan_spec::timing::Averaging;
use cardan_spec::{Channel, MOST_CHANNELS, ThirdTilt, flags};

use self::constants::Zero;
use self::unrest::Unrest;
use crate::averaging::Averages;
use crate::calibration::Calibration;
use crate::inverse;
use crate::nodes::{
    Angle, Average, Centred, FieldProduct, FieldX, FieldY, One, Pitch, Radicand, Rest, Roll,
    TiltProduct, TiltX, TiltY, TiltZ, Yaw,
};

/// What a solution leaves to the next.
pub struct State<M: Arithmetic> {
    yaw: Value<M, Yaw>,
    down_negative: M::Bool,
    field_z_negative: M::Bool,
    signs_lost: M::Bool,
    started: bool,
    unrest: Unrest<M>,
}

impl<M: Arithmetic> State<M> {
    /// An upright device that has seen nothing yet, and solves once per period of `averaging`.
    pub fn new(m: &M, averaging: Averaging) -> Self {
        Self {
            yaw: m.constant::<Yaw, Zero>(),
            down_negative: m.truth(false),
            field_z_negative: m.truth(false),
            signs_lost: m.truth(false),
            started: false,
            unrest: Unrest::new(m, averaging),
        }
    }

    /// Somebody knows that the device is upright now.
    pub fn set_upright(&mut self, m: &M) {
        self.down_negative = m.truth(false);
        self.field_z_negative = m.truth(false);
        self.signs_lost = m.truth(false);
        self.started = false;
    }
}

/// A solution: set 1's angles in half turns.
pub struct Angles<M: Arithmetic> {
    /// About the vertical, from magnetic north, clockwise seen from above.
    pub yaw: Value<M, Yaw>,
    /// Nose up.
    pub pitch: Value<M, Pitch>,
    /// Right side down.
    pub roll: Value<M, Roll>,
}

/// The calibrated readings.
struct Readings<M: Arithmetic> {
    t1: Value<M, TiltX>,
    t2: Value<M, TiltY>,
    b1: Value<M, FieldX>,
    b2: Value<M, FieldY>,
}

/// Computes the attitude from one solution's averages and, where the third tilt axis is at the comparator,
/// from the `sign` of gravity along body z: 1 upright, -1 upside down. Status bits are raised in `m`.
#[inline(always)]
pub fn solve<M: Arithmetic>(
    m: &M,
    calibration: &Calibration<M>,
    state: &mut State<M>,
    averages: &Averages<M>,
    sign: i8,
) -> Angles<M> {
    m.raise(flags::SATURATION, m.truth(averages.clipped));
    let readings = calibrate(m, calibration, &averages.values);
    let third = third_tilt(m, calibration, &averages.values, sign);
    let tilt = tilt::tilt(m, &readings, &third);
    let pitch = m.neg::<Pitch, _>(inverse::angle(m, tilt.x, tilt.cos_1, |x| same(m, x)));
    let vertical = validity::vertical(m, calibration, &readings, &tilt);
    let upside_down = validity::half_space(m, state, &vertical, &third);
    let roll = inverse::angle(m, tilt.sin_roll, tilt.cos_roll, |x| same(m, x));
    let behind: Value<M, Angle> = inverse::half_turn_less(m, roll);
    let roll: Value<M, Roll> = m.select(upside_down, behind, roll);
    let yaw = heading::yaw(m, calibration, state, &readings, &tilt, upside_down);
    Angles { yaw, pitch, roll }
}

/// The same value in another node.
#[inline(always)]
fn same<M: Arithmetic, N: Node, A: Node>(m: &M, a: Value<M, A>) -> Value<M, N> {
    m.shift::<N, A, 0>(a)
}

/// Offsets and matrices: averages over full scale to g and |B|.
#[inline(always)]
fn calibrate<M: Arithmetic>(
    m: &M,
    calibration: &Calibration<M>,
    averages: &[Value<M, Average>; MOST_CHANNELS],
) -> Readings<M> {
    let centred =
        |channel: usize, offset| -> Value<M, Centred> { m.sub(averages[channel], offset) };
    let tilt = [
        centred(0, calibration.tilt_offset[0]),
        centred(1, calibration.tilt_offset[1]),
    ];
    let field = [
        centred(2, calibration.field_offset[0]),
        centred(3, calibration.field_offset[1]),
    ];
    let gain = &calibration.tilt_gain;
    let tilt_product = |row: usize, column: usize| -> Value<M, TiltProduct> {
        m.mul(gain[row][column], tilt[column])
    };
    let t1 = m.add(tilt_product(0, 0), tilt_product(0, 1));
    let t2 = m.add(tilt_product(1, 0), tilt_product(1, 1));
    let gain = &calibration.field_gain;
    let field_product = |row: usize, column: usize| -> Value<M, FieldProduct> {
        m.mul(gain[row][column], field[column])
    };
    let b1 = m.add(field_product(0, 0), field_product(0, 1));
    let b2 = m.add(field_product(1, 0), field_product(1, 1));
    Readings { t1, t2, b1, b2 }
}

/// What the third tilt axis tells.
struct Third<M: Arithmetic> {
    /// Constant in a run.
    kind: ThirdTilt,
    /// Gravity along body z in g where it is measured, its sign (1 or -1) where it is compared, else 0.
    t3: Value<M, TiltZ>,
}

/// Fractional bits with which a comparator's sign is taken in.
pub const SIGN_FRAC: u32 = 14;

/// The reading of the third tilt axis.
#[inline(always)]
fn third_tilt<M: Arithmetic>(
    m: &M,
    calibration: &Calibration<M>,
    averages: &[Value<M, Average>; MOST_CHANNELS],
    sign: i8,
) -> Third<M> {
    let kind = calibration.third_tilt;
    let t3 = match kind {
        ThirdTilt::Measured => {
            let average = averages[Channel::TiltZ as usize];
            let centred: Value<M, Centred> = m.sub(average, calibration.tilt_z_offset);
            m.mul(calibration.tilt_z_gain, centred)
        }
        // With the node's own fractional bits, which spares a shift.
        ThirdTilt::Comparator | ThirdTilt::Absent => {
            m.input::<TiltZ, SIGN_FRAC>(i32::from(i16::from(sign) << SIGN_FRAC))
        }
    };
    Third { kind, t3 }
}

/// sqrt(max(0, rest)).
#[inline(always)]
fn root<M: Arithmetic, N: Node>(m: &M, rest: Value<M, Rest>) -> Value<M, N> {
    let zero = m.constant::<One, Zero>();
    let radicand: Value<M, Radicand> = m.select(m.negative(rest), zero, rest);
    m.sqrt(radicand)
}
