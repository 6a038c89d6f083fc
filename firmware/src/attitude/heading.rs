//! The headings of both sets and their weighted mean.

use cardan_datapath::{Arithmetic, Node, Value};
use cardan_spec::flags;

use super::constants::{DomainLimit, LeastEast, MinusUnity, OppositeDomainLimit, Unity};
use super::tilt::Tilt;
use super::{Readings, State, root, same};
use crate::calibration::Calibration;
use crate::inverse;
use crate::nodes::{
    AsinArgument, CosRoll, Cross1, Cross2, DipPart, EastX, HeadingCos1, HeadingCos2,
    HeadingMagnitude, HeadingPart, HeadingQuotient, HeadingSin1, HeadingSin2, HeadingSquare,
    LeastShare, LeastSum, LevelCos, LevelSin, LevelX, LevelY, Limit, MatrixLength, MatrixTerm,
    NorthX, One, Rest, Square, TiltCross, Twist1, TwistPart, UnitArgument, Weight1, WeightPart,
    WeightSquare, WeightSum, WeightX, WeightY, Yaw, Yaw1, Yaw2, YawCorrection, YawDifference,
    YawFresh,
};

#[inline(always)]
pub(super) fn yaw<M: Arithmetic>(
    m: &M,
    calibration: &Calibration<M>,
    state: &mut State<M>,
    readings: &Readings<M>,
    tilt: &Tilt<M>,
    upside_down: M::Bool,
) -> Value<M, Yaw> {
    let (t1, t2, b1, b2) = (tilt.x, tilt.y, readings.b1, readings.b2);
    // Level components of the field over its horizontal part: C cos_1 and S cos_2.
    let part: Value<M, DipPart> = m.mul(calibration.vertical, t1);
    let level_x: Value<M, LevelX> = m.sub(b1, part);
    let part: Value<M, DipPart> = m.mul(calibration.vertical, t2);
    let level_y: Value<M, LevelY> = m.sub(part, b2);
    let level_cos: Value<M, LevelCos> = m.mul(level_x, calibration.inverse_horizontal);
    let level_sin: Value<M, LevelSin> = m.mul(level_y, calibration.inverse_horizontal);
    let c_1: Value<M, HeadingCos1> = m.div(level_cos, tilt.cos_1);
    let s_2: Value<M, HeadingSin2> = m.div(level_sin, tilt.cos_2);
    check_domain(m, c_1);
    check_domain(m, s_2);
    // The other function of each heading, times cosines that are never negative: of the third angle,
    // and for set 2 of both tilt angles.
    let twist_1: Value<M, Twist1> = m.mul(t1, tilt.sin_roll);
    let part: Value<M, TwistPart> = m.mul(twist_1, c_1);
    let cross_1: Value<M, Cross1> = m.sub(level_sin, part);
    let tilts: Value<M, TiltCross> = m.mul(t1, t2);
    let scaled: Value<M, TwistPart> = m.mul(level_cos, tilt.cos_2);
    let part: Value<M, TwistPart> = m.mul(tilts, s_2);
    let cross_2: Value<M, Cross2> = m.sub(scaled, part);

    let yaw_1 = yaw_of_set_1(m, c_1, m.negative(cross_1));
    let yaw_2 = yaw_of_set_2(m, s_2, m.negative(cross_2), tilts, tilt);

    let heading = heading_1(m, c_1, cross_1, tilt.cos_roll);
    let (weight, defined) = weight(m, tilt, twist_1, c_1, &heading);
    let difference: Value<M, YawDifference> = m.sub(yaw_1, yaw_2);
    let correction: Value<M, YawCorrection> = m.mul(weight, difference);
    let fresh: Value<M, YawFresh> = m.add(yaw_2, correction);
    let opposite: Value<M, YawFresh> = m.neg(fresh);
    let fresh: Value<M, YawFresh> = m.select(upside_down, opposite, fresh);
    let yaw = m.select(defined, fresh, state.yaw);
    m.raise(flags::YAW_HELD, m.not(defined));
    state.yaw = yaw;
    state.unrest.track(m, heading.square, tilt.excess);
    yaw
}

/// Limits a heading's sine or cosine to -1..1.
#[inline(always)]
fn clamp<M: Arithmetic, A: Node>(m: &M, a: Value<M, A>) -> Value<M, UnitArgument> {
    let one = m.constant::<UnitArgument, Unity>();
    let minus_one = m.constant::<UnitArgument, MinusUnity>();
    let upper: Value<M, UnitArgument> = m.select(m.less(one, a), one, a);
    m.select(m.less(upper, minus_one), minus_one, upper)
}

/// The other function of a clamped sine or cosine: sqrt(1 - a^2) with the given sign.
#[inline(always)]
fn co_function<M: Arithmetic, N: Node>(
    m: &M,
    a: Value<M, UnitArgument>,
    negative: M::Bool,
) -> Value<M, N> {
    let square: Value<M, Square> = m.mul(a, a);
    let rest: Value<M, Rest> = m.sub(m.constant::<One, Unity>(), square);
    let magnitude: Value<M, HeadingMagnitude> = root(m, rest);
    let opposite: Value<M, HeadingMagnitude> = m.neg(magnitude);
    m.select(negative, opposite, magnitude)
}

/// sgn(S) acos(C).
#[inline(always)]
fn yaw_of_set_1<M: Arithmetic>(
    m: &M,
    cosine: Value<M, HeadingCos1>,
    sine_negative: M::Bool,
) -> Value<M, Yaw1> {
    let cosine = clamp(m, cosine);
    let sine: Value<M, HeadingSin1> = co_function(m, cosine, sine_negative);
    same(m, inverse::angle(m, sine, cosine, |x| same(m, x)))
}

/// asin(S) in the half given by the sign of C, as a yaw of set 1: atan2(M01, M00) of its matrix.
#[inline(always)]
fn yaw_of_set_2<M: Arithmetic>(
    m: &M,
    sine: Value<M, HeadingSin2>,
    cosine_negative: M::Bool,
    tilts: Value<M, TiltCross>,
    tilt: &Tilt<M>,
) -> Value<M, Yaw2> {
    let sine = clamp(m, sine);
    let cosine: Value<M, HeadingCos2> = co_function(m, sine, cosine_negative);
    // Times cos_2: cos(theta) of set 2 is down, sin(psi) sin(theta) is -t1 t2.
    let term_a: Value<M, MatrixTerm> = m.mul(tilt.down, cosine);
    let term_b: Value<M, MatrixTerm> = m.mul(tilts, sine);
    let north: Value<M, NorthX> = m.add(term_a, term_b);
    let term_a: Value<M, MatrixTerm> = m.mul(tilt.down, sine);
    let term_b: Value<M, MatrixTerm> = m.mul(tilts, cosine);
    let east: Value<M, EastX> = m.sub(term_a, term_b);
    // (M00, M01) has the length cos_1.
    let length: Value<M, MatrixLength> = m.mul(tilt.cos_1, tilt.cos_2);
    same(
        m,
        inverse::angle(m, east, north, |x| m.div::<AsinArgument, _, _>(x, length)),
    )
}

/// Set 1's heading with both functions as quotients: sine and cosine of one angle where the readings agree.
struct Heading1<M: Arithmetic> {
    sine: Value<M, HeadingQuotient>,
    square: Value<M, HeadingSquare>,
}

/// S of set 1, and C^2 + S^2.
#[inline(always)]
fn heading_1<M: Arithmetic>(
    m: &M,
    c_1: Value<M, HeadingCos1>,
    cross_1: Value<M, Cross1>,
    cos_roll: Value<M, CosRoll>,
) -> Heading1<M> {
    let sine: Value<M, HeadingQuotient> = m.div(cross_1, cos_roll);
    let sine_square: Value<M, HeadingPart> = m.mul(sine, sine);
    let cosine_square: Value<M, HeadingPart> = m.mul(c_1, c_1);
    let square = m.add(cosine_square, sine_square);
    Heading1 { sine, square }
}

/// e1^2 / (e1^2 + e2^2) with e from set 1's atan2 solution, and whether yaw is defined. Both squares are
/// taken times C^2 + S^2, near 1, which spares the root.
#[inline(always)]
fn weight<M: Arithmetic>(
    m: &M,
    tilt: &Tilt<M>,
    twist_1: Value<M, Twist1>,
    c_1: Value<M, HeadingCos1>,
    heading: &Heading1<M>,
) -> (Value<M, Weight1>, M::Bool) {
    let east_1: Value<M, WeightX> = m.mul(tilt.cos_1, heading.sine);
    let part_a: Value<M, WeightPart> = m.mul(tilt.cos_roll, c_1);
    let part_b: Value<M, WeightPart> = m.mul(twist_1, heading.sine);
    let east_2: Value<M, WeightY> = m.sub(part_a, part_b);
    let square_1: Value<M, WeightSquare> = m.mul(east_1, east_1);
    let square_2: Value<M, WeightSquare> = m.mul(east_2, east_2);
    let sum: Value<M, WeightSum> = m.add(square_1, square_2);
    let least: Value<M, LeastSum> = m.mul(m.constant::<LeastShare, LeastEast>(), heading.square);
    let undefined = m.less(sum, least);
    let one = m.constant::<WeightSum, Unity>();
    let divisor: Value<M, WeightSum> = m.select(undefined, one, sum);
    (m.div(square_1, divisor), m.not(undefined))
}

/// Raises the domain status if |a| is beyond 1 by more than noise.
#[inline(always)]
fn check_domain<M: Arithmetic, A: Node>(m: &M, a: Value<M, A>) {
    let limit = m.constant::<Limit, DomainLimit>();
    let opposite = m.constant::<Limit, OppositeDomainLimit>();
    m.raise(flags::DOMAIN, m.or(m.less(limit, a), m.less(a, opposite)));
}
