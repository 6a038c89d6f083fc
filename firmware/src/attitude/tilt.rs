//! Gravity's direction, and sines and cosines of the tilt angles of both sets.

use cardan_datapath::{Arithmetic, Value};

use super::constants::{Unity, Zero};
use super::{Readings, check_domain, root, same};
use crate::nodes::{
    Cos1, Cos2, CosRoll, Down, DownSquare, Excess, GravitySquare, GravityX, GravityY, One, Rest,
    SinRoll, Square, SquareSum,
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

#[inline(always)]
pub(super) fn tilt<M: Arithmetic>(m: &M, readings: &Readings<M>) -> Tilt<M> {
    let x: Value<M, GravityX> = same(m, readings.t1);
    let y: Value<M, GravityY> = same(m, readings.t2);
    let one = m.constant::<One, Unity>();
    let square_1: Value<M, Square> = m.mul(x, x);
    let square_2: Value<M, Square> = m.mul(y, y);
    let rest_1: Value<M, Rest> = m.sub(one, square_1);
    let rest_2: Value<M, Rest> = m.sub(one, square_2);
    let rest: Value<M, Rest> = m.sub(rest_1, square_2);
    let cos_1: Value<M, Cos1> = root(m, rest_1);
    let cos_2: Value<M, Cos2> = root(m, rest_2);
    let down: Value<M, Down> = root(m, rest);
    let sin_roll: Value<M, SinRoll> = m.div(y, cos_1);
    let cos_roll = m.div(down, cos_1);
    check_domain(m, x);
    check_domain(m, sin_roll);
    let down_square = same(m, rest);
    let sum: Value<M, SquareSum> = m.add(square_1, square_2);
    let beyond = beyond_gravity(m, sum);
    let excess = m.select(m.negative(beyond), m.constant::<Excess, Zero>(), beyond);
    Tilt {
        x,
        y,
        cos_1,
        cos_2,
        down,
        sin_roll,
        cos_roll,
        down_square,
        excess,
    }
}

/// A squared specific force less that of gravity.
#[inline(always)]
fn beyond_gravity<M: Arithmetic>(m: &M, sum: Value<M, SquareSum>) -> Value<M, Excess> {
    let square: Value<M, GravitySquare> = same(m, sum);
    m.sub(square, m.constant::<GravitySquare, Unity>())
}
