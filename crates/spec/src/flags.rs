//! Status bits of a solution, on the wire and in the golden model.

/// A channel's code reached either end of the scale in this solution.
pub const SATURATION: u16 = 1 << 0;
/// The device is, or may be, where the sign of gravity's z component is not known: without a third
/// tilt axis outside the upright half-space, with one near the horizon.
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
/// The flag is set while sign(d3) < 0, or d3^2 < [`crate::HALF_SPACE_LEAST_DOWN_SQUARE`], or the
/// signs are lost.
///
/// A third tilt axis tells sign(d3), but for its offset and noise; measured, it is that of t3. Where it is fitted, in every
/// solution after the above: unless d3^2 < [`crate::HALF_SPACE_LEAST_DOWN_SQUARE`], sign(d3) is
/// what it tells, sign(b3) := sign(d3) sign(q), and the signs are no longer lost. The flag is set
/// while d3^2 is under that limit, and nowhere else. While sign(d3) < 0 the angles are those of the
/// attitude that the readings stand for as well (sensors reference, 7.4): (yaw, pitch, roll) of the
/// upright half becomes (-yaw, pitch, half a turn - roll).
pub const HALF_SPACE: u16 = 1 << 1;
/// The four readings contradict the calibrated Earth field.
pub const DISTURBED: u16 = 1 << 2;
/// The calibration in EEPROM is absent or damaged; nominal values are in use.
pub const UNCALIBRATED: u16 = 1 << 3;
/// An argument left the domain of an inverse function by more than noise, or a divisor was zero.
pub const DOMAIN: u16 = 1 << 4;
/// The previous solution was not finished when this one's averages were complete, or a conversion
/// came late.
pub const LATE: u16 = 1 << 5;
/// Yaw is undefined at this attitude; the last defined value is repeated.
pub const YAW_HELD: u16 = 1 << 6;

/// Every bit with its name, lowest first.
pub const NAMES: [(u16, &str); 7] = [
    (SATURATION, "saturation"),
    (HALF_SPACE, "half_space"),
    (DISTURBED, "disturbed"),
    (UNCALIBRATED, "uncalibrated"),
    (DOMAIN, "domain"),
    (LATE, "late"),
    (YAW_HELD, "yaw_held"),
];
