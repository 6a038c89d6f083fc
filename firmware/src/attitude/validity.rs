//! What the readings tell of the vertical: agreement with the calibrated field, and the half-space.

use cardan_datapath::{Arithmetic, Value};
use cardan_spec::flags;

use super::constants::{LeastDown, LeastVertical, ResidualLimit, Unity, Zero};
use super::tilt::Tilt;
use super::{Readings, State};
use crate::calibration::Calibration;
use crate::nodes::{
    DipProduct, DownSquare, FieldZSquare, Limit, One, ReadingsPart, ReadingsSum, Residual,
    ResidualPart, TiltZ, Vertical, VerticalSum,
};

/// What the readings tell of the z components of gravity and field.
pub(super) struct Verticals<M: Arithmetic> {
    down_square: Value<M, DownSquare>,
    field_z_square: Value<M, FieldZSquare>,
    product_negative: M::Bool,
}

/// Squares and product of the z components, and whether they agree with the calibrated field.
#[inline(always)]
pub(super) fn vertical<M: Arithmetic>(
    m: &M,
    calibration: &Calibration<M>,
    readings: &Readings<M>,
    tilt: &Tilt<M>,
) -> Verticals<M> {
    let vertical: Value<M, Vertical> = calibration.vertical;
    let part: Value<M, ReadingsPart> = m.mul(readings.b1, tilt.x);
    let sum: Value<M, ReadingsSum> = m.sub(vertical, part);
    let part: Value<M, ReadingsPart> = m.mul(readings.b2, tilt.y);
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

/// The rule of [`flags::HALF_SPACE`]. Whether the device is upside down, as far as that is known.
#[inline(always)]
pub(super) fn half_space<M: Arithmetic>(
    m: &M,
    state: &mut State<M>,
    vertical: &Verticals<M>,
    tilt_z: Value<M, TiltZ>,
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
    let (no, over) = (m.truth(false), m.less(m.constant::<TiltZ, Zero>(), tilt_z));
    let fitted = m.or(m.negative(tilt_z), over);
    let told = m.either(steep, no, fitted);
    state.down_negative = m.either(told, over, state.down_negative);
    let field_z = m.xor(over, product_negative);
    state.field_z_negative = m.either(told, field_z, state.field_z_negative);
    state.signs_lost = m.either(told, no, lost);
    let unknown = m.either(fitted, no, state.signs_lost);
    m.raise(flags::HALF_SPACE, m.or(steep, unknown));
    state.down_negative
}
