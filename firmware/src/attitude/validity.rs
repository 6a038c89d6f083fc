//! What the readings tell of the vertical: agreement with the calibrated field, and the half-space.

use cardan_datapath::{Arithmetic, Value};
use cardan_spec::{ThirdTilt, flags};

use super::constants::{LeastDown, LeastVertical, ResidualLimit, Unity};
use super::tilt::Tilt;
use super::{Readings, State, Third};
use crate::calibration::Calibration;
use crate::nodes::{
    DipProduct, DownSquare, FieldZSquare, Limit, One, ReadingsPart, ReadingsSum, Residual,
    ResidualPart, Vertical, VerticalSum,
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
    third: &Third<M>,
) -> M::Bool {
    let down_square = vertical.down_square;
    let steep = m.less(down_square, m.constant::<Limit, LeastDown>());
    let over = m.negative(third.t3);
    if third.kind == ThirdTilt::Measured {
        m.raise(flags::HALF_SPACE, steep);
        return over;
    }
    track_signs(m, state, vertical);
    let sum: Value<M, VerticalSum> = m.add(down_square, vertical.field_z_square);
    let lost = m.less(sum, m.constant::<Limit, LeastVertical>());
    state.signs_lost = m.or(state.signs_lost, lost);
    if third.kind == ThirdTilt::Comparator {
        // What it tells, where gravity is clear of its offset.
        let field_z = m.xor(over, vertical.product_negative);
        state.down_negative = m.either(steep, state.down_negative, over);
        state.field_z_negative = m.either(steep, state.field_z_negative, field_z);
        m.raise(flags::HALF_SPACE, steep);
    } else {
        m.raise(flags::HALF_SPACE, m.or(steep, state.signs_lost));
    }
    state.down_negative
}

/// The z component that is farther from zero has kept its sign and gives the other its own.
#[inline(always)]
fn track_signs<M: Arithmetic>(m: &M, state: &mut State<M>, vertical: &Verticals<M>) {
    let product_negative = vertical.product_negative;
    if state.started {
        let down_smaller = m.less(vertical.down_square, vertical.field_z_square);
        let down = m.xor(state.field_z_negative, product_negative);
        let field_z = m.xor(state.down_negative, product_negative);
        let before = state.down_negative;
        state.down_negative = m.either(down_smaller, down, before);
        state.field_z_negative = m.either(down_smaller, state.field_z_negative, field_z);
    } else {
        state.field_z_negative = product_negative;
        state.started = true;
    }
}
