//! Names and units of the nodes of the attitude datapath that the golden model knows as well.
//!
//! The firmware has further nodes of its own (products, polynomial terms), which no other model
//! knows; they are declared with the formats in `firmware/wordlengths.toml`. Every node takes the
//! given number of values per solution. Letters: t1, t2 gravity along body x, y in g; b1, b2 field
//! along body x, y over |B|; h, v = cos, sin of the inclination; set 1 = Z-Y-X (yaw, pitch, roll),
//! set 2 = Z-X-Y (sensors reference, 7.2 and 7.3).

/// A node that golden model and firmware share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SharedNode {
    /// Name, as in reports, word-length files and tolerances.
    pub name: &'static str,
    /// Unit: `lsb` ADC steps, `fs` fractions of full scale, `g`, `B` (over |B|), `1`, or
    /// `half_turn` (180 degrees).
    pub unit: &'static str,
    /// Values per solution: one per conversion, per channel, or one.
    pub per_solution: usize,
}

const fn node(name: &'static str, unit: &'static str, per_solution: usize) -> SharedNode {
    SharedNode {
        name,
        unit,
        per_solution,
    }
}

/// Bipolar ADC code, one per conversion.
pub const SAMPLE: SharedNode = node("sample", "lsb", super::timing::CONVERSIONS_PER_SOLUTION);
/// Running sum of a channel's bipolar codes after each conversion; starts at 0 in each solution.
pub const ACCUMULATOR: SharedNode = node(
    "accumulator",
    "lsb",
    super::timing::CONVERSIONS_PER_SOLUTION,
);
/// Average of a channel over full scale (sum / (512 * AVERAGING)), in channel order.
pub const AVERAGE: SharedNode = node("average", "fs", super::CHANNELS);
/// t1: gravity along body x.
pub const TILT_X: SharedNode = node("tilt_x", "g", 1);
/// t2: gravity along body y.
pub const TILT_Y: SharedNode = node("tilt_y", "g", 1);
/// b1: field along body x.
pub const FIELD_X: SharedNode = node("field_x", "B", 1);
/// b2: field along body y.
pub const FIELD_Y: SharedNode = node("field_y", "B", 1);
/// Cosine of set 1's pitch: sqrt(max(0, 1 - t1^2)).
pub const COS_1: SharedNode = node("cos_1", "1", 1);
/// Cosine of set 2's first tilt angle: sqrt(max(0, 1 - t2^2)).
pub const COS_2: SharedNode = node("cos_2", "1", 1);
/// Cosine of the tilt, d3 = sqrt(max(0, 1 - t1^2 - t2^2)).
pub const DOWN: SharedNode = node("down", "1", 1);
/// C of set 1 before clamping: (b1 - v t1) / (h cos_1), the cosine of the heading.
pub const HEADING_COS_1: SharedNode = node("heading_cos_1", "1", 1);
/// S of set 2 before clamping: (v t2 - b2) / (h cos_2), the sine of set 2's heading.
pub const HEADING_SIN_2: SharedNode = node("heading_sin_2", "1", 1);
/// Yaw of set 1, sgn(S) acos(C).
pub const YAW_1: SharedNode = node("yaw_1", "half_turn", 1);
/// Yaw of set 2's attitude, expressed in set 1 (atan2 of its matrix elements M01, M00).
pub const YAW_2: SharedNode = node("yaw_2", "half_turn", 1);
/// Weight of set 1, w1 = e1^2 / (e1^2 + e2^2), with e from set 1's atan2 solution (7.6).
pub const WEIGHT_1: SharedNode = node("weight_1", "1", 1);
/// Yaw: yaw_2 + w1 wrap(yaw_1 - yaw_2); the previous value while undefined (0 at first).
pub const YAW: SharedNode = node("yaw", "half_turn", 1);
/// Pitch of set 1, -asin(t1).
pub const PITCH: SharedNode = node("pitch", "half_turn", 1);
/// Roll of set 1, asin(t2 / cos_1).
pub const ROLL: SharedNode = node("roll", "half_turn", 1);
/// v - b1 t1 - b2 t2: the product of the z components of gravity and field, with its sign.
pub const DIP_PRODUCT: SharedNode = node("dip_product", "B", 1);
/// 1 - b1^2 - b2^2: the squared z component of the field.
pub const FIELD_Z_SQUARE: SharedNode = node("field_z_square", "B", 1);

/// All shared nodes in signal order.
pub const SHARED: [SharedNode; 20] = [
    SAMPLE,
    ACCUMULATOR,
    AVERAGE,
    TILT_X,
    TILT_Y,
    FIELD_X,
    FIELD_Y,
    COS_1,
    COS_2,
    DOWN,
    HEADING_COS_1,
    HEADING_SIN_2,
    YAW_1,
    YAW_2,
    WEIGHT_1,
    YAW,
    PITCH,
    ROLL,
    DIP_PRODUCT,
    FIELD_Z_SQUARE,
];
