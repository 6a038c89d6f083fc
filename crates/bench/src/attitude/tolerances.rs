//! By how much the golden model and the firmware's algorithm differ on real numbers: what golden may
//! be away from the native firmware beside rounding.

use cardan_spec::nodes::SHARED;

use crate::app::Tolerance;

const SAME: &str = "the same expression; f64 rounds it differently";
const SERIES: &str = "the firmware's series for the inverse sine ends after four terms";

/// Largest difference on real numbers of angles that come from the series, in half turns.
const SERIES_HALF_TURNS: f64 = 1.2e-5;
/// What rounding of f64 may add up to in any other node, in its unit.
const F64: f64 = 1e-12;

/// The allowances of all shared nodes.
pub(super) fn all() -> Vec<Tolerance> {
    let of = |shared: &cardan_spec::nodes::SharedNode| {
        let is_angle = shared.unit == "half_turn";
        Tolerance {
            node: shared.name,
            max_abs: if is_angle { SERIES_HALF_TURNS } else { F64 },
            reason: if is_angle { SERIES } else { SAME },
        }
    };
    SHARED.iter().map(of).collect()
}
