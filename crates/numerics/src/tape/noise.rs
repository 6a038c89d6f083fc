//! What rounding adds in one write.

use cardan_datapath::{Format, Rounding};

/// Bits behind a word's last place from which on a result counts as endless.
const ENDLESS: i64 = 64;

/// Variance (unit of the node squared) and mean (its unit) of the error that rounding adds in one write
/// to `format`, where the exact result has `dropped` bits behind the word's last place; an endless one
/// drops 64 or more. Exact for bits of which each pattern is as likely, with either sign.
#[must_use]
pub fn rounding_noise(format: Format, dropped: i64) -> (f64, f64) {
    if dropped <= 0 {
        return (0.0, 0.0);
    }
    let lsb = format.lsb();
    let half = lsb / 2.0;
    let least = libm::ldexp(1.0, -(dropped.min(ENDLESS) as i32));
    // The 2^k errors in a row that either neighbour alone brings, and by how much their middle lies
    // beside the half of a place.
    let row = lsb * lsb / 12.0 * (1.0 - least * least);
    let (floor, tie) = (half * (1.0 - least), half * least);
    match format.rounding {
        Rounding::Floor => (row, -floor),
        Rounding::Ceil => (row, floor),
        // The tie, one of 2^k values, always goes up.
        Rounding::NearestUp => (row, tie),
        // It goes to either side as often: a bias of either sign is spread.
        Rounding::NearestAway | Rounding::NearestEven => (row + tie * tie, 0.0),
        // So does everything toward zero.
        Rounding::Zero => (row + floor * floor, 0.0),
    }
}
