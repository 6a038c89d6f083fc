//! Names and units of the nodes of the attitude datapath that the golden model knows as well.
//!
//! The firmware has further nodes of its own (products, polynomial terms), which no other model
//! knows; they are declared with the formats in `firmware/wordlengths.toml`. Letters: t1, t2 gravity along body x, y in g; b1, b2 field
//! along body x, y over |B|; h, v = cos, sin of the inclination; set 1 = Z-Y-X (yaw, pitch, roll),
//! set 2 = Z-X-Y (docs/sensors.md, 7.2 and 7.3).

use crate::timing::Averaging;

/// How often a node takes a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Writes {
    /// At every conversion that is summed in its block, whether or not the block counts.
    Conversion,
    /// Per channel, at the end of every block that counts.
    Block,
    /// Per channel.
    Channel,
    /// Once.
    Once,
}

/// A node that golden model and firmware share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SharedNode {
    /// Name, as in reports, word-length files and tolerances.
    pub name: &'static str,
    /// Unit: `lsb` ADC steps, `fs` fractions of full scale, `g`, `B` (over |B|), `1`, or
    /// `half_turn` (180 degrees).
    pub unit: &'static str,
    /// How often it takes a value in a solution.
    pub writes: Writes,
}

impl SharedNode {
    /// Values per solution.
    #[must_use]
    pub const fn per_solution(&self, averaging: Averaging) -> usize {
        match self.writes {
            Writes::Conversion => averaging.summed_conversions() * averaging.blocks(),
            Writes::Block => averaging.counted_blocks() * averaging.channels(),
            Writes::Channel => averaging.channels(),
            Writes::Once => 1,
        }
    }
}

const fn node(name: &'static str, unit: &'static str, writes: Writes) -> SharedNode {
    SharedNode { name, unit, writes }
}

/// Bipolar ADC code, one per conversion.
pub const SAMPLE: SharedNode = node("sample", "lsb", Writes::Conversion);
/// Running sum of a channel's bipolar codes after each conversion; starts at 0 in each block.
pub const ACCUMULATOR: SharedNode = node("accumulator", "lsb", Writes::Conversion);
/// Running sum of a channel's blocks over full scale (512 codes) and the averaging length; starts at 0
/// in each solution and ends as the exact average.
pub const MEAN: SharedNode = node("mean", "fs", Writes::Block);
/// Average of a channel over full scale, in channel order.
pub const AVERAGE: SharedNode = node("average", "fs", Writes::Channel);
/// t1: gravity along body x.
pub const TILT_X: SharedNode = node("tilt_x", "g", Writes::Once);
/// t2: gravity along body y.
pub const TILT_Y: SharedNode = node("tilt_y", "g", Writes::Once);
/// t3: gravity along body z where a third tilt axis is measured; where it is at the comparator, its
/// sign (1 upright, -1 upside down); 0 where none is fitted.
pub const TILT_Z: SharedNode = node("tilt_z", "g", Writes::Once);
/// b1: field along body x.
pub const FIELD_X: SharedNode = node("field_x", "B", Writes::Once);
/// b2: field along body y.
pub const FIELD_Y: SharedNode = node("field_y", "B", Writes::Once);
/// Gravity along body x in g: t1; over sqrt(t1^2 + t2^2 + t3^2) where a third tilt axis is measured. In all
/// that follows it stands for t1.
pub const GRAVITY_X: SharedNode = node("gravity_x", "g", Writes::Once);
/// The same along body y, for t2.
pub const GRAVITY_Y: SharedNode = node("gravity_y", "g", Writes::Once);
/// Cosine of set 1's pitch: sqrt(max(0, 1 - t1^2)).
pub const COS_1: SharedNode = node("cos_1", "1", Writes::Once);
/// Cosine of set 2's first tilt angle: sqrt(max(0, 1 - t2^2)).
pub const COS_2: SharedNode = node("cos_2", "1", Writes::Once);
/// Cosine of the tilt, d3 = sqrt(max(0, 1 - t1^2 - t2^2)).
pub const DOWN: SharedNode = node("down", "1", Writes::Once);
/// C of set 1 before clamping: (b1 - v t1) / (h cos_1), the cosine of the heading.
pub const HEADING_COS_1: SharedNode = node("heading_cos_1", "1", Writes::Once);
/// S of set 2 before clamping: (v t2 - b2) / (h cos_2), the sine of set 2's heading.
pub const HEADING_SIN_2: SharedNode = node("heading_sin_2", "1", Writes::Once);
/// Yaw of set 1, sgn(S) acos(C).
pub const YAW_1: SharedNode = node("yaw_1", "half_turn", Writes::Once);
/// Yaw of set 2's attitude, expressed in set 1 (atan2 of its matrix elements M01, M00).
pub const YAW_2: SharedNode = node("yaw_2", "half_turn", Writes::Once);
/// Weight of set 1, w1 = e1^2 / (e1^2 + e2^2), with e from set 1's atan2 solution (7.6).
pub const WEIGHT_1: SharedNode = node("weight_1", "1", Writes::Once);
/// Yaw: yaw_2 + w1 wrap(yaw_1 - yaw_2); the previous value while undefined (0 at first).
pub const YAW: SharedNode = node("yaw", "half_turn", Writes::Once);
/// Pitch of set 1, -asin(t1).
pub const PITCH: SharedNode = node("pitch", "half_turn", Writes::Once);
/// Roll of set 1, asin(t2 / cos_1).
pub const ROLL: SharedNode = node("roll", "half_turn", Writes::Once);
/// v - b1 t1 - b2 t2: the product of the z components of gravity and field, with its sign.
pub const DIP_PRODUCT: SharedNode = node("dip_product", "B", Writes::Once);
/// 1 - b1^2 - b2^2: the squared z component of the field.
pub const FIELD_Z_SQUARE: SharedNode = node("field_z_square", "B", Writes::Once);

/// K = C^2 + S^2, both of set 1: the squared horizontal field over the calibration's.
pub const HEADING_SQUARE: SharedNode = node("heading_square", "1", Writes::Once);
/// What is left of |K - 1| ([`crate::flags::INCONSISTENT`]).
pub const INCONSISTENCY: SharedNode = node("inconsistency", "1", Writes::Once);
/// What is left of the excess of the specific force over gravity ([`crate::flags::ACCELERATED`]).
pub const ACCELERATION: SharedNode = node("acceleration", "g2", Writes::Once);

/// All shared nodes in signal order.
pub const SHARED: [SharedNode; 27] = [
    SAMPLE,
    ACCUMULATOR,
    MEAN,
    AVERAGE,
    TILT_X,
    TILT_Y,
    TILT_Z,
    FIELD_X,
    FIELD_Y,
    GRAVITY_X,
    GRAVITY_Y,
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
    HEADING_SQUARE,
    INCONSISTENCY,
    ACCELERATION,
];
