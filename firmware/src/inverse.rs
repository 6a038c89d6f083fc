//! The angle of a unit vector from its sine and cosine, without a division.
//!
//! The smaller of |sine| and |cosine| is at most 1/sqrt(2), where the inverse sine is well
//! conditioned: an odd polynomial gives the angle within the octant, the signs and the order give
//! the octant. (An arc tangent would need a division, an arc cosine loses half the digits near 1.)

use cardan_datapath::{Arithmetic, Constant, Node, Table, Value};

use crate::nodes::{
    Angle, AsinArgument, AsinCoefficient, AsinSquare, AsinSum, AsinTerm, Half, Magnitude, Octant,
    Quadrant,
};

/// asin(x) / (pi x) = sum of c_k x^(2k) for |x| <= 1/sqrt(2); minimax in the angle, error 1.1e-3
/// degrees. (A fifth term would reach 1.4e-4, a sixth of a place of the angle, for 200 cycles.)
struct Coefficients;
impl Table for Coefficients {
    const VALUES: &'static [f64] = &[
        0.318_236_722_945_106_2,
        0.054_809_690_876_860_634,
        0.012_803_647_549_659_774,
        0.037_618_883_237_403_25,
    ];
}

/// A quarter of a turn.
struct QuarterTurn;
impl Constant for QuarterTurn {
    const VALUE: f64 = 0.5;
}

/// Half a turn less one place: the format of angles ends before it, wrapping makes it exact.
struct HalfTurn;
impl Constant for HalfTurn {
    const VALUE: f64 = -1.0;
}

/// atan2(sine, cosine) in half turns. `normalise` brings the smaller magnitude to that of a unit
/// vector (the identity when sine and cosine already belong to one).
#[inline(always)]
pub(crate) fn angle<M: Arithmetic, S: Node, C: Node>(
    m: &M,
    sine: Value<M, S>,
    cosine: Value<M, C>,
    normalise: impl Fn(Value<M, Magnitude>) -> Value<M, AsinArgument>,
) -> Value<M, Angle> {
    let s: Value<M, Magnitude> = m.abs(sine);
    let c: Value<M, Magnitude> = m.abs(cosine);
    let sine_smaller = m.less(s, c);
    let smaller: Value<M, Magnitude> = m.select(sine_smaller, s, c);
    assemble(
        m,
        normalise(smaller),
        sine_smaller,
        m.negative(sine),
        m.negative(cosine),
    )
}

/// Not inlined: four angles share the code.
#[inline(never)]
fn assemble<M: Arithmetic>(
    m: &M,
    x: Value<M, AsinArgument>,
    sine_smaller: M::Bool,
    sine_negative: M::Bool,
    cosine_negative: M::Bool,
) -> Value<M, Angle> {
    let square: Value<M, AsinSquare> = m.mul(x, x);
    let coefficient = |k: usize| m.entry::<AsinCoefficient, Coefficients>(k);
    let t: Value<M, AsinTerm> = m.mul(coefficient(3), square);
    let sum: Value<M, AsinSum> = m.add(t, coefficient(2));
    let t: Value<M, AsinTerm> = m.mul(sum, square);
    let sum: Value<M, AsinSum> = m.add(t, coefficient(1));
    let t: Value<M, AsinTerm> = m.mul(sum, square);
    let sum: Value<M, AsinSum> = m.add(t, coefficient(0));
    let octant: Value<M, Octant> = m.mul(sum, x);

    let quarter = m.constant::<Half, QuarterTurn>();
    let complement: Value<M, Octant> = m.sub(quarter, octant);
    let quadrant: Value<M, Quadrant> = m.select(sine_smaller, octant, complement);
    let behind = half_turn_less(m, quadrant);
    let upper: Value<M, Angle> = m.select(cosine_negative, behind, quadrant);
    let lower: Value<M, Angle> = m.neg(upper);
    m.select(sine_negative, lower, upper)
}

/// 1 - angle, modulo a whole turn: -1 - angle is the same.
#[inline(always)]
pub(crate) fn half_turn_less<M: Arithmetic, A: Node>(m: &M, angle: Value<M, A>) -> Value<M, Angle> {
    m.sub(m.constant::<Half, HalfTurn>(), angle)
}
