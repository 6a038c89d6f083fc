//! Status bits of a solution, on the wire and in the golden model.

use crate::timing::Averaging;

/// A channel's code reached either end of the scale in this solution.
pub const SATURATION: u16 = 1 << 0;
/// The sign of gravity's z component is not known, or the device is so near the horizon that it can not
/// be.
///
/// Two readings of gravity leave the sign of its z component open, and so do two of the field; but
/// the product of both is observable: q = v - b1 t1 - b2 t2 = d3 b3. While one factor passes zero
/// the other, clear of zero, keeps its sign, so the signs can be tracked from an upright start:
/// with d3^2 = 1 - t1^2 - t2^2 and b3^2 = 1 - b1^2 - b2^2, in every solution
/// if d3^2 < b3^2 then sign(d3) := sign(b3) sign(q), else sign(b3) := sign(d3) sign(q)
/// (sign(x) = +1 for x >= 0). At the first solution sign(d3) = +1 and sign(b3) = sign(q).
/// Where both factors are near zero (body z along east or west, where yaw is undefined too) nothing
/// tells which of them passes zero: once d3^2 + b3^2 < [`crate::HALF_SPACE_LEAST_SUM`], the signs
/// are lost until a reset or the command [`crate::frame::COMMAND_UPRIGHT`].
/// The flag is set while d3^2 < [`crate::HALF_SPACE_LEAST_DOWN_SQUARE`], or the signs are lost.
///
/// A third tilt axis tells sign(d3), but for its offset and noise. At the comparator, in every solution
/// after the above: unless d3^2 < [`crate::HALF_SPACE_LEAST_DOWN_SQUARE`], sign(d3) is what it tells,
/// and sign(b3) := sign(d3) sign(q). Measured (t3), it gives d3 itself: t1, t2, t3 over the length of the
/// vector that they are take the place of t1, t2 and d3 in all rules here, and sign(d3) is that of t3.
/// With either, the flag is set while d3^2 is under the limit, and nowhere else.
///
/// While sign(d3) < 0 the angles are those of the attitude that the readings stand for as well (sensors
/// reference, 7.4): (yaw, pitch, roll) of the upright half becomes (-yaw, pitch, half a turn - roll).
pub const HALF_SPACE: u16 = 1 << 1;
/// The four readings contradict the calibrated Earth field.
pub const DISTURBED: u16 = 1 << 2;
/// The calibration in EEPROM is absent or damaged; nominal values are in use.
pub const UNCALIBRATED: u16 = 1 << 3;
/// An argument left the domain of an inverse function by more than noise: |C| of set 1 or |S| of set 2 is
/// over 1 + [`crate::DOMAIN_MARGIN`]. Or a divisor was zero: d3 (gravity's readings x and y are as long as
/// gravity, or longer), cos_1, cos_2, or the length of a measured vector.
pub const DOMAIN: u16 = 1 << 4;
/// The previous solution was not finished when this one's averages were complete, or a conversion
/// came late.
pub const LATE: u16 = 1 << 5;
/// Yaw is undefined at this attitude; the last defined value is repeated.
pub const YAW_HELD: u16 = 1 << 6;

/// The readings contradict each other or the calibrated field, now or shortly before: the excess of the
/// horizontal field over [`crate::INCONSISTENCY_LIMIT`].
///
/// C and S of set 1, the cosine and the sine of one heading, come from different readings, so that
/// C^2 + S^2 is 1 only where all four agree. It is the square of the horizontal field that the readings
/// contain, over that of the calibration: a force of motion along north tilts the assumed vertical by its
/// size in g, and changes the length by tan I times that. (C of set 1 and S of set 2 belong to different
/// headings. The residual of [`DISTURBED`] is (C^2 + S^2 - 1) d3^2 h^2: on a slope it is small whatever the
/// heading's error. The quotient S is well conditioned until d3 is as small as the readings' own errors.)
/// The part of such a force along east turns the heading by as much and shows nowhere. It is as large as
/// the other one on average, and both swing through zero: what counts is the largest excess of the last
/// quarter of a second. With x = min(|C^2 + S^2 - 1|, [`UNREST_MOST`]), in every solution
/// inconsistency := max(x, inconsistency left(averaging)), from 0 at reset, where left is
/// 1 - 2^-[`unrest_shift`].
pub const INCONSISTENT: u16 = 1 << 7;
/// A force of motion acts beside gravity, now or shortly before.
///
/// With a measured third tilt axis x = min(|t^2 - 1|, [`UNREST_MOST`]), t^2 = t1^2 + t2^2 + t3^2; without
/// one only too long a vector can be told: x = min(max(t1^2 + t2^2 - 1, 0), [`UNREST_MOST`]). In every
/// solution acceleration := max(x, acceleration left(averaging)), as for [`INCONSISTENT`]; the flag is set
/// while it is over [`crate::ACCELERATION_LIMIT`]. Gravity's direction is t over its length then only as far
/// as that limit: a longer (shorter) vector is divided by sqrt(1 + limit) (sqrt(1 - limit)).
pub const ACCELERATED: u16 = 1 << 8;

/// Largest excess that is remembered: a longer vector was not more wrong than unknown.
pub const UNREST_MOST: f64 = 3.0;

/// log2 of the solutions in which what is left of an excess falls by a factor of e: a quarter of a second
/// (half a second for the longest periods). Hands move at 1 to 3 Hz, so that a force of theirs passes
/// zero for a tenth of a second, and comes back.
#[must_use]
pub const fn unrest_shift(averaging: Averaging) -> u32 {
    /// log2 of the conversions per channel in a quarter of a second.
    const QUARTER_SECOND_LOG2: u32 = 9;
    QUARTER_SECOND_LOG2.saturating_sub(averaging.period_log2() as u32)
}

/// Every bit with its name, lowest first.
pub const NAMES: [(u16, &str); 9] = [
    (SATURATION, "saturation"),
    (HALF_SPACE, "half_space"),
    (DISTURBED, "disturbed"),
    (UNCALIBRATED, "uncalibrated"),
    (DOMAIN, "domain"),
    (LATE, "late"),
    (YAW_HELD, "yaw_held"),
    (INCONSISTENT, "inconsistent"),
    (ACCELERATED, "accelerated"),
];
