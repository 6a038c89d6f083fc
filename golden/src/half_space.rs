//! Which way is up: tracking the signs that two readings of gravity and two of field leave open.
//!
//! The rule is agreed in [`cardan_spec::flags::HALF_SPACE`]; its base is 7.4 of the sensors
//! reference.

use cardan_spec::{FIELD_RESIDUAL_LIMIT, HALF_SPACE_LEAST_DOWN_SQUARE, HALF_SPACE_LEAST_SUM};

use crate::orders::down_square;
use crate::rotation::{EarthField, Readings};
use crate::solve::Third;

/// The products of the z components that four readings make observable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vertical {
    /// q = v - b1 t1 - b2 t2 = d3 b3.
    pub dip_product: f64,
    /// d3^2, which is 1 - t1^2 - t2^2 where no third axis measures it.
    pub down_square: f64,
    /// b3^2 = 1 - b1^2 - b2^2.
    pub field_square: f64,
}

impl Vertical {
    /// From readings of two tilt axes; noise may make the squares negative.
    #[must_use]
    pub fn of(readings: &Readings, earth: EarthField) -> Self {
        Self::with_down_square(readings, down_square(readings), earth)
    }

    /// The same where d3^2 is known otherwise.
    pub(crate) fn with_down_square(
        readings: &Readings,
        down_square: f64,
        earth: EarthField,
    ) -> Self {
        let ([t1, t2], [b1, b2]) = (readings.tilt, readings.field);
        Self {
            dip_product: earth.vertical - b1 * t1 - b2 * t2,
            down_square,
            field_square: 1.0 - b1 * b1 - b2 * b2,
        }
    }

    /// True when the readings contradict the calibrated field: q^2 and d3^2 b3^2 differ by more
    /// than [`FIELD_RESIDUAL_LIMIT`].
    #[must_use]
    pub fn is_disturbed(&self) -> bool {
        let residual = self.dip_product * self.dip_product - self.down_square * self.field_square;
        residual.abs() > FIELD_RESIDUAL_LIMIT
    }
}

/// Signs of the z components of gravity and field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Signs {
    down_positive: bool,
    field_positive: bool,
}

/// Carries the signs from solution to solution, from an upright start.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct HalfSpace {
    signs: Option<Signs>,
    /// Both factors were near zero once: nothing tells since then which of them changed its sign.
    lost: bool,
}

/// Where a solution is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Side {
    /// The sign of gravity's z component is not known: the status bit.
    pub is_flagged: bool,
    /// It is negative, as far as it is known.
    pub is_upside_down: bool,
}

impl HalfSpace {
    /// Takes the next solution, and what a third tilt axis tells of it if one is fitted.
    pub fn track(&mut self, vertical: &Vertical, third: Option<Third>) -> Side {
        let is_steep = vertical.down_square < HALF_SPACE_LEAST_DOWN_SQUARE;
        if let Some(Third::Measured(t3)) = third {
            return Side {
                is_flagged: is_steep,
                is_upside_down: t3 < 0.0,
            };
        }
        self.follow(vertical);
        if let (Some(Third::Sign { upside_down }), Some(signs), false) =
            (third, &mut self.signs, is_steep)
        {
            signs.down_positive = !upside_down;
            signs.field_positive = signs.down_positive == (vertical.dip_product >= 0.0);
        }
        Side {
            is_flagged: is_steep || third.is_none() && self.lost,
            is_upside_down: self.signs.is_some_and(|signs| !signs.down_positive),
        }
    }

    /// Carries the signs on by the product's.
    fn follow(&mut self, vertical: &Vertical) {
        let product_positive = vertical.dip_product >= 0.0;
        let mut signs = self.signs.unwrap_or(Signs {
            down_positive: true,
            field_positive: product_positive,
        });
        // The factor that is farther from zero has kept its sign and gives the other its own.
        if vertical.down_square < vertical.field_square {
            signs.down_positive = signs.field_positive == product_positive;
        } else {
            signs.field_positive = signs.down_positive == product_positive;
        }
        self.signs = Some(signs);
        self.lost |= vertical.down_square + vertical.field_square < HALF_SPACE_LEAST_SUM;
    }
}
