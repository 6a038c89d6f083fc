//! The attitude: calibration, both Cardan solutions, their weighted mean, validity.
//!
//! Equations: sensors reference, sections 7.2 (set 1, Z-Y-X), 7.3 (set 2, Z-X-Y), 7.6 (weights), 7.7
//! (domains). Letters: t1, t2 gravity along body x, y in g; b1, b2 field over |B|; h, v cosine and
//! sine of the inclination; C, S cosine and sine of a heading. All angles are set 1's unless said.
//! Divisions: two for the roll, one for each heading, one for set 2's yaw, one for the weight. Set 2's
//! tilt is never divided out: its matrix is taken times cos_2. Sines and cosines come from the
//! readings, never from angles.
//!
//! Everything is computed for the upright half-space; where a third tilt axis tells that the device is
//! upside down, yaw and roll are turned at the end (7.4). A Rust `if` on whether that axis is fitted, and
//! how, is allowed: it is constant in a run.

use cardan_datapath::{Arithmetic, Constant, Node, Value};
use cardan_spec::{Channel, DOMAIN_MARGIN, FIELD_RESIDUAL_LIMIT, MOST_CHANNELS, ThirdTilt, flags};
use cardan_spec::{HALF_SPACE_LEAST_DOWN_SQUARE, HALF_SPACE_LEAST_SUM, YAW_LEAST_EAST_SQUARE};

use crate::averaging::Averages;
use crate::calibration::Calibration;
use crate::inverse;
use crate::nodes::{
    Angle, AsinArgument, Average, Centred, Cos1, Cos2, CosRoll, Cross1, Cross2, DipPart,
    DipProduct, Down, DownSquare, EastX, FieldProduct, FieldX, FieldY, FieldZSquare, HeadingCos1,
    HeadingCos2, HeadingMagnitude, HeadingSin1, HeadingSin2, LeastShare, LeastSum, LevelCos,
    LevelSin, LevelX, LevelY, Limit, MatrixLength, MatrixTerm, NorthX, One, Pitch, Radicand,
    ReadingsPart, ReadingsSum, Residual, ResidualPart, Rest, Roll, RollSquare, Scale, ScalePart,
    SinRoll, Square, TiltCross, TiltProduct, TiltX, TiltY, TiltZ, Twist1, TwistPart, UnitArgument,
    Vertical, VerticalSum, Weight1, WeightPart, WeightSquare, WeightSum, WeightX, WeightY, Yaw,
    Yaw1, Yaw2, YawCorrection, YawDifference, YawFresh,
};

macro_rules! constants {
    ($($name:ident = $value:expr;)*) => {$(
        struct $name;
        impl Constant for $name {
            const VALUE: f64 = $value;
        }
    )*};
}
constants! {
    Zero = 0.0;
    Unity = 1.0;
    MinusUnity = -1.0;
    DomainLimit = 1.0 + DOMAIN_MARGIN;
    OppositeDomainLimit = -(1.0 + DOMAIN_MARGIN);
    LeastEast = YAW_LEAST_EAST_SQUARE;
    LeastDown = HALF_SPACE_LEAST_DOWN_SQUARE;
    LeastVertical = HALF_SPACE_LEAST_SUM;
    ResidualLimit = FIELD_RESIDUAL_LIMIT;
}

/// What a solution leaves to the next.
pub struct State<M: Arithmetic> {
    yaw: Value<M, Yaw>,
    down_negative: M::Bool,
    field_z_negative: M::Bool,
    signs_lost: M::Bool,
    started: bool,
}

impl<M: Arithmetic> State<M> {
    /// An upright device that has seen nothing yet.
    pub fn new(m: &M) -> Self {
        Self {
            yaw: m.constant::<Yaw, Zero>(),
            down_negative: m.truth(false),
            field_z_negative: m.truth(false),
            signs_lost: m.truth(false),
            started: false,
        }
    }

    /// Somebody knows that the device is upright now.
    pub fn set_upright(&mut self, m: &M) {
        *self = Self {
            yaw: self.yaw,
            ..Self::new(m)
        };
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

/// Sines and cosines of the tilt angles of both sets.
struct Tilt<M: Arithmetic> {
    cos_1: Value<M, Cos1>,
    cos_2: Value<M, Cos2>,
    down: Value<M, Down>,
    sin_roll: Value<M, SinRoll>,
    cos_roll: Value<M, CosRoll>,
    down_square: Value<M, DownSquare>,
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
    let tilt = tilt(m, &readings);
    let pitch = m.neg::<Pitch, _>(inverse::angle(m, readings.t1, tilt.cos_1, |x| same(m, x)));
    let third = third_tilt(m, calibration, &averages.values, sign);
    let vertical = vertical(m, calibration, &readings, &tilt);
    let upside_down = half_space(m, state, &vertical, &third);
    let roll = inverse::angle(m, tilt.sin_roll, tilt.cos_roll, |x| same(m, x));
    let behind: Value<M, Angle> = inverse::half_turn_less(m, roll);
    let roll: Value<M, Roll> = m.select(upside_down, behind, roll);
    let yaw = yaw(m, calibration, state, &readings, &tilt, upside_down);
    Angles { yaw, pitch, roll }
}

/// The same value in another node.
#[inline(always)]
fn same<M: Arithmetic, N: Node, A: Node>(m: &M, a: Value<M, A>) -> Value<M, N> {
    m.shift::<N, A, 0>(a)
}

/// Raises the domain status if |a| is beyond 1 by more than noise.
#[inline(always)]
fn check_domain<M: Arithmetic, A: Node>(m: &M, a: Value<M, A>) {
    let limit = m.constant::<Limit, DomainLimit>();
    let opposite = m.constant::<Limit, OppositeDomainLimit>();
    m.raise(flags::DOMAIN, m.or(m.less(limit, a), m.less(a, opposite)));
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

#[inline(always)]
fn tilt<M: Arithmetic>(m: &M, readings: &Readings<M>) -> Tilt<M> {
    let (t1, t2) = (readings.t1, readings.t2);
    let one = m.constant::<One, Unity>();
    let square_1: Value<M, Square> = m.mul(t1, t1);
    let square_2: Value<M, Square> = m.mul(t2, t2);
    let rest_1: Value<M, Rest> = m.sub(one, square_1);
    let rest_2: Value<M, Rest> = m.sub(one, square_2);
    let rest: Value<M, Rest> = m.sub(rest_1, square_2);
    let cos_1: Value<M, Cos1> = root(m, rest_1);
    let cos_2: Value<M, Cos2> = root(m, rest_2);
    let down: Value<M, Down> = root(m, rest);
    let sin_roll: Value<M, SinRoll> = m.div(t2, cos_1);
    let cos_roll = m.div(down, cos_1);
    check_domain(m, t1);
    check_domain(m, sin_roll);
    let down_square = same(m, rest);
    Tilt {
        cos_1,
        cos_2,
        down,
        sin_roll,
        cos_roll,
        down_square,
    }
}

#[inline(always)]
fn yaw<M: Arithmetic>(
    m: &M,
    calibration: &Calibration<M>,
    state: &mut State<M>,
    readings: &Readings<M>,
    tilt: &Tilt<M>,
    upside_down: M::Bool,
) -> Value<M, Yaw> {
    let (t1, t2, b1, b2) = (readings.t1, readings.t2, readings.b1, readings.b2);
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

    let (weight, defined) = weight(m, tilt, twist_1, c_1, cross_1);
    let difference: Value<M, YawDifference> = m.sub(yaw_1, yaw_2);
    let correction: Value<M, YawCorrection> = m.mul(weight, difference);
    let fresh: Value<M, YawFresh> = m.add(yaw_2, correction);
    let opposite: Value<M, YawFresh> = m.neg(fresh);
    let fresh: Value<M, YawFresh> = m.select(upside_down, opposite, fresh);
    let yaw = m.select(defined, fresh, state.yaw);
    m.raise(flags::YAW_HELD, m.not(defined));
    state.yaw = yaw;
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

/// e1^2 / (e1^2 + e2^2) with e from set 1's atan2 solution, and whether yaw is defined. Numerator
/// and denominator are both taken times cos_roll^2 (S^2 + C^2), which spares three divisions.
#[inline(always)]
fn weight<M: Arithmetic>(
    m: &M,
    tilt: &Tilt<M>,
    twist_1: Value<M, Twist1>,
    c_1: Value<M, HeadingCos1>,
    cross_1: Value<M, Cross1>,
) -> (Value<M, Weight1>, M::Bool) {
    let roll_square: Value<M, RollSquare> = m.mul(tilt.cos_roll, tilt.cos_roll);
    let east_1: Value<M, WeightX> = m.mul(tilt.cos_1, cross_1);
    let part_a: Value<M, WeightPart> = m.mul(roll_square, c_1);
    let part_b: Value<M, WeightPart> = m.mul(twist_1, cross_1);
    let east_2: Value<M, WeightY> = m.sub(part_a, part_b);
    let square_1: Value<M, WeightSquare> = m.mul(east_1, east_1);
    let square_2: Value<M, WeightSquare> = m.mul(east_2, east_2);
    let sum: Value<M, WeightSum> = m.add(square_1, square_2);
    let weight: Value<M, Weight1> = m.div(square_1, sum);

    let sine: Value<M, ScalePart> = m.mul(cross_1, cross_1);
    let cosine: Value<M, ScalePart> = m.mul(part_a, c_1);
    let scale: Value<M, Scale> = m.add(sine, cosine);
    let least: Value<M, LeastSum> = m.mul(m.constant::<LeastShare, LeastEast>(), scale);
    (weight, m.not(m.less(sum, least)))
}

/// What the readings tell of the z components of gravity and field.
struct Verticals<M: Arithmetic> {
    down_square: Value<M, DownSquare>,
    field_z_square: Value<M, FieldZSquare>,
    product_negative: M::Bool,
}

/// Squares and product of the z components, and whether they agree with the calibrated field.
#[inline(always)]
fn vertical<M: Arithmetic>(
    m: &M,
    calibration: &Calibration<M>,
    readings: &Readings<M>,
    tilt: &Tilt<M>,
) -> Verticals<M> {
    let vertical: Value<M, Vertical> = calibration.vertical;
    let part: Value<M, ReadingsPart> = m.mul(readings.b1, readings.t1);
    let sum: Value<M, ReadingsSum> = m.sub(vertical, part);
    let part: Value<M, ReadingsPart> = m.mul(readings.b2, readings.t2);
    let dip_product: Value<M, DipProduct> = m.sub(sum, part);
    let part: Value<M, ReadingsPart> = m.mul(readings.b1, readings.b1);
    let sum: Value<M, ReadingsSum> = m.sub(m.constant::<One, Unity>(), part);
    let part: Value<M, ReadingsPart> = m.mul(readings.b2, readings.b2);
    let field_z_square: Value<M, FieldZSquare> = m.sub(sum, part);

    let seen: Value<M, ResidualPart> = m.mul(dip_product, dip_product);
    let expected: Value<M, ResidualPart> = m.mul(tilt.down_square, field_z_square);
    let residual: Value<M, Residual> = m.sub(seen, expected);
    let magnitude: Value<M, Residual> = m.abs(residual);
    m.raise(
        flags::DISTURBED,
        m.less(m.constant::<Limit, ResidualLimit>(), magnitude),
    );
    Verticals {
        down_square: tilt.down_square,
        field_z_square,
        product_negative: m.negative(dip_product),
    }
}

/// The rule of [`flags::HALF_SPACE`]. Whether the device is upside down, as far as a third tilt axis
/// makes that certain enough for the angles to be turned.
#[inline(always)]
fn half_space<M: Arithmetic>(
    m: &M,
    state: &mut State<M>,
    vertical: &Verticals<M>,
    third: &Third<M>,
) -> M::Bool {
    let Verticals {
        down_square,
        field_z_square,
        product_negative,
    } = *vertical;
    if state.started {
        let down_smaller = m.less(down_square, field_z_square);
        let down = m.xor(state.field_z_negative, product_negative);
        let field_z = m.xor(state.down_negative, product_negative);
        let before = state.down_negative;
        state.down_negative = m.either(down_smaller, down, before);
        state.field_z_negative = m.either(down_smaller, state.field_z_negative, field_z);
    } else {
        state.field_z_negative = product_negative;
        state.started = true;
    }
    let steep = m.less(down_square, m.constant::<Limit, LeastDown>());
    let sum: Value<M, VerticalSum> = m.add(down_square, field_z_square);
    let lost = m.less(sum, m.constant::<Limit, LeastVertical>());
    let lost = m.or(state.signs_lost, lost);

    // What a third axis tells, where it is fitted and gravity is clear of its offset.
    let (no, over) = (m.truth(false), m.negative(third.t3));
    let fitted = m.truth(third.kind.is_fitted());
    let told = m.either(steep, no, fitted);
    state.down_negative = m.either(told, over, state.down_negative);
    let field_z = m.xor(over, product_negative);
    state.field_z_negative = m.either(told, field_z, state.field_z_negative);
    state.signs_lost = m.either(told, no, lost);
    let outside = m.either(fitted, no, m.or(state.down_negative, state.signs_lost));
    m.raise(flags::HALF_SPACE, m.or(steep, outside));
    m.either(fitted, state.down_negative, no)
}
