//! Gravity's direction, and sines and cosines of the tilt angles of both sets.

use cardan_datapath::{Arithmetic, Table, Value};
use cardan_spec::ThirdTilt;

use super::constants::{AccelerationLimit, OppositeAccelerationLimit, Unity, Zero};
use super::{Readings, Third, root, same};
use crate::nodes::{
    Cos1, Cos2, CosRoll, Down, DownSquare, Excess, GravitySquare, GravityX, GravityY, GravityZ,
    InverseLength, InverseSum, InverseTerm, One, Rest, SinRoll, Square, SquareSum,
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

/// 1 / sqrt(1 + x) = 1 + x (c_0 + x (c_1 + x (c_2 + x c_3))) for |x| up to the limit of
/// [`flags::ACCELERATED`](cardan_spec::flags::ACCELERATED), minimax: error 1.8e-5.
struct InverseRoot;
impl Table for InverseRoot {
    const VALUES: &'static [f64] = &[
        -0.499_697_717_620_584_8,
        0.374_375_264_822_581_6,
        -0.332_444_219_327_665_7,
        0.298_345_123_372_127,
    ];
}

/// What is known of gravity's direction.
struct Gravity<M: Arithmetic> {
    x: Value<M, GravityX>,
    y: Value<M, GravityY>,
    square_1: Value<M, Square>,
    square_2: Value<M, Square>,
    /// Along body z and by how much the squared specific force differs from gravity's, where a third axis
    /// measures.
    measured: Option<(Value<M, GravityZ>, Value<M, Excess>)>,
}

#[inline(always)]
pub(super) fn tilt<M: Arithmetic>(m: &M, readings: &Readings<M>, third: &Third<M>) -> Tilt<M> {
    let gravity = gravity(m, readings, third);
    let one = m.constant::<One, Unity>();
    let rest_1: Value<M, Rest> = m.sub(one, gravity.square_1);
    let rest_2: Value<M, Rest> = m.sub(one, gravity.square_2);
    let cos_1: Value<M, Cos1> = root(m, rest_1);
    let cos_2: Value<M, Cos2> = root(m, rest_2);
    let (down, down_square, excess): (Value<M, Down>, Value<M, DownSquare>, Value<M, Excess>) =
        if let Some((z, excess)) = gravity.measured {
            (m.abs(z), m.mul(z, z), m.abs(excess))
        } else {
            let rest: Value<M, Rest> = m.sub(rest_1, gravity.square_2);
            let down_square: Value<M, DownSquare> = same(m, rest);
            // Too short a vector cannot be told from a slope.
            let beyond: Value<M, Excess> = m.neg(down_square);
            let none = m.constant::<Excess, Zero>();
            let excess = m.select(m.negative(beyond), none, beyond);
            (root(m, rest), down_square, excess)
        };
    let sin_roll: Value<M, SinRoll> = m.div(gravity.y, cos_1);
    let cos_roll = m.div(down, cos_1);
    Tilt {
        x: gravity.x,
        y: gravity.y,
        cos_1,
        cos_2,
        down,
        sin_roll,
        cos_roll,
        down_square,
        excess,
    }
}

/// Gravity from the readings: their direction where all three are measured, else as they are.
#[inline(always)]
fn gravity<M: Arithmetic>(m: &M, readings: &Readings<M>, third: &Third<M>) -> Gravity<M> {
    let (t1, t2, t3) = (readings.t1, readings.t2, third.t3);
    let square_1: Value<M, Square> = m.mul(t1, t1);
    let square_2: Value<M, Square> = m.mul(t2, t2);
    if third.kind != ThirdTilt::Measured {
        return Gravity {
            x: same(m, t1),
            y: same(m, t2),
            square_1,
            square_2,
            measured: None,
        };
    }
    let square_3: Value<M, Square> = m.mul(t3, t3);
    let sum: Value<M, SquareSum> = m.add(square_1, square_2);
    let sum: Value<M, SquareSum> = m.add(sum, square_3);
    let square: Value<M, GravitySquare> = same(m, sum);
    let excess: Value<M, Excess> = m.sub(square, m.constant::<GravitySquare, Unity>());
    let inverse = inverse_root(m, limited(m, excess));
    let (x, y) = (m.mul(t1, inverse), m.mul(t2, inverse));
    Gravity {
        x,
        y,
        square_1: m.mul(x, x),
        square_2: m.mul(y, y),
        measured: Some((m.mul(t3, inverse), excess)),
    }
}

/// An excess within the limit of [`flags::ACCELERATED`](cardan_spec::flags::ACCELERATED), or the limit: the
/// series holds no further, and beyond it nobody knows gravity's direction.
#[inline(always)]
fn limited<M: Arithmetic>(m: &M, x: Value<M, Excess>) -> Value<M, Excess> {
    let most = m.constant::<Excess, AccelerationLimit>();
    let least = m.constant::<Excess, OppositeAccelerationLimit>();
    let upper: Value<M, Excess> = m.select(m.less(most, x), most, x);
    m.select(m.less(upper, least), least, upper)
}

/// 1 / sqrt(1 + x).
#[inline(always)]
fn inverse_root<M: Arithmetic>(m: &M, x: Value<M, Excess>) -> Value<M, InverseLength> {
    let coefficient = |k: usize| m.entry::<InverseSum, InverseRoot>(k);
    let term: Value<M, InverseTerm> = m.mul(coefficient(3), x);
    let sum: Value<M, InverseSum> = m.add(term, coefficient(2));
    let term: Value<M, InverseTerm> = m.mul(sum, x);
    let sum: Value<M, InverseSum> = m.add(term, coefficient(1));
    let term: Value<M, InverseTerm> = m.mul(sum, x);
    let sum: Value<M, InverseSum> = m.add(term, coefficient(0));
    let term: Value<M, InverseTerm> = m.mul(sum, x);
    m.add(term, m.constant::<InverseSum, Unity>())
}
