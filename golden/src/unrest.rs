//! How much motion there was lately: the rules of [`cardan_spec::flags::INCONSISTENT`] and
//! [`cardan_spec::flags::ACCELERATED`].

use cardan_spec::flags::{self, UNREST_MOST};
use cardan_spec::timing::Averaging;
use cardan_spec::{ACCELERATION_LIMIT, INCONSISTENCY_LIMIT};

use crate::node;

/// The largest excess of late, which fades from solution to solution.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Unrest {
    /// Part that is left after a solution.
    left: f64,
    inconsistency: f64,
    acceleration: f64,
}

impl Unrest {
    /// None so far, on a device that solves once per period of `averaging`.
    pub(crate) fn new(averaging: Averaging) -> Self {
        let solutions = f64::from(1_u32 << flags::unrest_shift(averaging));
        Self {
            left: 1.0 - 1.0 / solutions,
            inconsistency: 0.0,
            acceleration: 0.0,
        }
    }

    /// Takes C^2 + S^2 and by how much the squared specific force exceeds gravity; gives the status bits.
    pub(crate) fn track(
        &mut self,
        heading_square: f64,
        force_excess: f64,
        record: &mut impl FnMut(usize, f64),
    ) -> u16 {
        let larger = |before: f64, excess: f64| excess.min(UNREST_MOST).max(before * self.left);
        self.inconsistency = larger(self.inconsistency, (heading_square - 1.0).abs());
        self.acceleration = larger(self.acceleration, force_excess);
        record(node::HEADING_SQUARE, heading_square);
        record(node::INCONSISTENCY, self.inconsistency);
        record(node::ACCELERATION, self.acceleration);
        let mut status = 0;
        if self.inconsistency > INCONSISTENCY_LIMIT {
            status |= flags::INCONSISTENT;
        }
        if self.acceleration > ACCELERATION_LIMIT {
            status |= flags::ACCELERATED;
        }
        status
    }
}
