//! How much motion there was lately: the rules of [`flags::INCONSISTENT`] and [`flags::ACCELERATED`].

use cardan_datapath::{Arithmetic, Node, Value};
use cardan_spec::flags;
use cardan_spec::timing::Averaging;

use super::constants::{AccelerationLimit, InconsistencyLimit, MostUnrest, Unity, Zero};
use crate::nodes::{Acceleration, Excess, Faded, Fading, HeadingSquare, Inconsistency};

/// Fractional bits of the part that is left of an excess.
const FADING_FRAC: u32 = 15;

/// The largest excesses of late, which fade from solution to solution.
pub(super) struct Unrest<M: Arithmetic> {
    /// Part that is left after a solution.
    fading: Value<M, Fading>,
    inconsistency: Value<M, Inconsistency>,
    acceleration: Value<M, Acceleration>,
}

impl<M: Arithmetic> Unrest<M> {
    /// None so far.
    pub(super) fn new(m: &M, averaging: Averaging) -> Self {
        let whole = 1 << FADING_FRAC;
        let lost = whole >> flags::unrest_shift(averaging);
        Self {
            fading: m.parameter::<Fading, FADING_FRAC>(whole - lost),
            inconsistency: m.constant::<Inconsistency, Zero>(),
            acceleration: m.constant::<Acceleration, Zero>(),
        }
    }

    /// Takes C^2 + S^2 and by how much the squared specific force is beyond gravity's.
    #[inline(always)]
    pub(super) fn track(
        &mut self,
        m: &M,
        heading_square: Value<M, HeadingSquare>,
        force: Value<M, Excess>,
    ) {
        let difference: Value<M, Excess> =
            m.sub(heading_square, m.constant::<HeadingSquare, Unity>());
        let field: Value<M, Excess> = m.abs(difference);
        self.inconsistency = larger(m, self.fading, self.inconsistency, field);
        self.acceleration = larger(m, self.fading, self.acceleration, force);
        m.raise(
            flags::INCONSISTENT,
            m.less(
                m.constant::<Inconsistency, InconsistencyLimit>(),
                self.inconsistency,
            ),
        );
        m.raise(
            flags::ACCELERATED,
            m.less(
                m.constant::<Acceleration, AccelerationLimit>(),
                self.acceleration,
            ),
        );
    }
}

/// The larger of an excess, up to the most, and what is left of the one before.
#[inline(always)]
fn larger<M: Arithmetic, N: Node>(
    m: &M,
    fading: Value<M, Fading>,
    before: Value<M, N>,
    excess: Value<M, Excess>,
) -> Value<M, N> {
    let most = m.constant::<Excess, MostUnrest>();
    let faded: Value<M, Faded> = m.mul(fading, before);
    let limited: Value<M, Excess> = m.select(m.less(most, excess), most, excess);
    m.select(m.less(faded, limited), limited, faded)
}
