//! Gravity's direction, and sines and cosines of the tilt angles of both sets.

use cardan_datapath::{Arithmetic, Value};
use cardan_spec::ThirdTilt;

use super::constants::{Unity, Zero};
use super::{Readings, Third, root, same};
use crate::nodes::{
    Cos1, Cos2, CosRoll, Down, DownSquare, Excess, GravityLength, GravitySquare, GravityX,
    GravityY, GravityZ, InverseLength, Limit, One, Rest, SinRoll, Square, SquareSum,
};

/// Sines and cosines of the tilt angles of both sets.
pub(super) struct Tilt<M: Arithmetic> {
    /// Gravity along body x and y.
    pub(super) x: Value<M, GravityX>,
    pub(super) y: Value<M, GravityY>,
    pub(super) cos_1: Value<M, Cos1>,
    pub(super) cos_2: Value<M, Cos2>,
    pub(super) down: Value<M, Down>,
    pub(super) sin_roll: Value<M, SinRoll>,
    pub(super) cos_roll: Value<M, CosRoll>,
    pub(super) down_square: Value<M, DownSquare>,
    /// By how much the squared specific force is beyond gravity's.
    pub(super) excess: Value<M, Excess>,
}

/// What is known of gravity's direction.
struct Gravity<M: Arithmetic> {
    x: Value<M, GravityX>,
    y: Value<M, GravityY>,
    /// Along body z, where a third axis measures.
    z: Option<Value<M, GravityZ>>,
    excess: Value<M, Excess>,
}

#[inline(always)]
pub(super) fn tilt<M: Arithmetic>(m: &M, readings: &Readings<M>, third: &Third<M>) -> Tilt<M> {
    let gravity = gravity(m, readings, third);
    let (x, y) = (gravity.x, gravity.y);
    let one = m.constant::<One, Unity>();
    let square_1: Value<M, Square> = m.mul(x, x);
    let square_2: Value<M, Square> = m.mul(y, y);
    let rest_1: Value<M, Rest> = m.sub(one, square_1);
    let rest_2: Value<M, Rest> = m.sub(one, square_2);
    let cos_1: Value<M, Cos1> = root(m, rest_1);
    let cos_2: Value<M, Cos2> = root(m, rest_2);
    let (down, down_square): (Value<M, Down>, Value<M, DownSquare>) = match gravity.z {
        Some(z) => (m.abs(z), m.mul(z, z)),
        None => {
            let rest: Value<M, Rest> = m.sub(rest_1, square_2);
            (root(m, rest), same(m, rest))
        }
    };
    let sin_roll: Value<M, SinRoll> = m.div(y, cos_1);
    let cos_roll = m.div(down, cos_1);
    Tilt {
        x,
        y,
        cos_1,
        cos_2,
        down,
        sin_roll,
        cos_roll,
        down_square,
        excess: gravity.excess,
    }
}

/// Gravity from the readings: their direction where all three are measured, else as they are. By what
/// they are too long; where the third is missing, too short a vector cannot be told.
#[inline(always)]
fn gravity<M: Arithmetic>(m: &M, readings: &Readings<M>, third: &Third<M>) -> Gravity<M> {
    let (t1, t2) = (readings.t1, readings.t2);
    let square_1: Value<M, Square> = m.mul(t1, t1);
    let square_2: Value<M, Square> = m.mul(t2, t2);
    let plane: Value<M, SquareSum> = m.add(square_1, square_2);
    if third.kind == ThirdTilt::Measured {
        let square_3: Value<M, Square> = m.mul(third.t3, third.t3);
        let sum: Value<M, SquareSum> = m.add(plane, square_3);
        let beyond = beyond_gravity(m, sum);
        let length: Value<M, GravityLength> = m.sqrt(sum);
        let inverse: Value<M, InverseLength> = m.div(m.constant::<Limit, Unity>(), length);
        return Gravity {
            x: m.mul(t1, inverse),
            y: m.mul(t2, inverse),
            z: Some(m.mul(third.t3, inverse)),
            excess: m.abs(beyond),
        };
    }
    let beyond = beyond_gravity(m, plane);
    let none = m.constant::<Excess, Zero>();
    Gravity {
        x: same(m, t1),
        y: same(m, t2),
        z: None,
        excess: m.select(m.negative(beyond), none, beyond),
    }
}

/// A squared specific force less that of gravity.
#[inline(always)]
fn beyond_gravity<M: Arithmetic>(m: &M, sum: Value<M, SquareSum>) -> Value<M, Excess> {
    let square: Value<M, GravitySquare> = same(m, sum);
    m.sub(square, m.constant::<GravitySquare, Unity>())
}
