//! Layout of the settings in the controller's EEPROM, from address 0, all little-endian.
//!
//! | offset | type | content |
//! |---|---|---|
//! | 0 | u16 | [`MAGIC`] |
//! | 2 | u8 | [`VERSION`] |
//! | 3 | u8 | number of words, [`WORDS`] |
//! | 4 | u8 | log2 of the conversions averaged per channel, 0 to 12 |
//! | 5 | u8 | log2 of the conversions per channel from one solution to the next, 4 to 12, not less than the former |
//! | 6 | u8 | options: the third tilt axis ([`crate::ThirdTilt`]): 0 absent, 1 at the comparator (bit 0), 2 measured (bit 1); anything else is not valid |
//! | 7 | i32 x WORDS | values with [`FRAC`] fractional bits, in the order of [`Calibration`]'s fields |
//! | 7 + 4 WORDS | u16 | CRC-16/CCITT (as in frames) of everything before |
//!
//! A device that finds anything else is uncalibrated: nominal values, 16 of 16 conversions averaged.
//!
//! With a = average bipolar code / 512 (a fraction of full scale, -1..1):
//! (t1, t2) = tilt_matrix (a_tilt - tilt_offset), the gravity component along body x and y in g;
//! (b1, b2) = field_matrix (a_field - field_offset), the field along body x and y over |B|.
//! t3 = tilt_z_gain (a_tilt_z - tilt_z_offset), gravity along body z, where it is measured.
//! An accelerometer at rest reads minus gravity, so the diagonal of `tilt_matrix` is negative, and so is
//! `tilt_z_gain`.

/// First word of a valid image.
pub const MAGIC: u16 = 0xCA1D;
/// Layout version.
pub const VERSION: u8 = 4;
/// Number of values.
pub const WORDS: usize = 17;
/// Fractional bits of every value: +-8 with a resolution of 4e-9.
pub const FRAC: u32 = 28;
/// Bytes of the image.
pub const LEN: usize = WORDS_AT + 4 * WORDS + 2;
/// Offset of the log2 of the averaging length.
pub const AVERAGING_AT: usize = 4;
/// Offset of the log2 of the solution period.
pub const PERIOD_AT: usize = 5;
/// Offset of the options, a [`crate::ThirdTilt`].
pub const OPTIONS_AT: usize = 6;
/// Offset of the first value.
pub const WORDS_AT: usize = 7;

/// The calibration as real numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Average at zero g, fractions of full scale; -0.5 LSB of it is the converter's floor.
    pub tilt_offset: [f64; 2],
    /// Rows: gravity along body x, y in g per full scale.
    pub tilt_matrix: [[f64; 2]; 2],
    /// Average at zero field, fractions of full scale.
    pub field_offset: [f64; 2],
    /// Rows: field along body x, y over |B| per full scale.
    pub field_matrix: [[f64; 2]; 2],
    /// Horizontal field over |B|: cos of the inclination I.
    pub horizontal: f64,
    /// Vertical (downward) field over |B|: sin of the inclination I.
    pub vertical: f64,
    /// |B| over the horizontal field: 1 / cos I, so that the device need not divide.
    pub inverse_horizontal: f64,
    /// Average of the third tilt axis at zero g, fractions of full scale.
    pub tilt_z_offset: f64,
    /// Gravity along body z in g per full scale of the third tilt axis.
    pub tilt_z_gain: f64,
}

impl Calibration {
    /// A device whose sensors are exactly as designed, in a field of `total_ut` microtesla with the
    /// given cosine and sine of the inclination.
    #[must_use]
    pub fn nominal(total_ut: f64, cos_inclination: f64, sin_inclination: f64) -> Self {
        let half_lsb = -0.5 / 512.0;
        let tilt = -crate::TILT_FULL_SCALE_G;
        let field = crate::FIELD_FULL_SCALE_UT / total_ut;
        Self {
            tilt_offset: [half_lsb; 2],
            tilt_matrix: [[tilt, 0.0], [0.0, tilt]],
            field_offset: [half_lsb; 2],
            field_matrix: [[field, 0.0], [0.0, field]],
            horizontal: cos_inclination,
            vertical: sin_inclination,
            inverse_horizontal: 1.0 / cos_inclination,
            tilt_z_offset: half_lsb,
            tilt_z_gain: tilt,
        }
    }

    /// The values in the order of the image.
    #[must_use]
    pub fn to_values(&self) -> [f64; WORDS] {
        let (t, f) = (&self.tilt_matrix, &self.field_matrix);
        [
            self.tilt_offset[0],
            self.tilt_offset[1],
            t[0][0],
            t[0][1],
            t[1][0],
            t[1][1],
            self.field_offset[0],
            self.field_offset[1],
            f[0][0],
            f[0][1],
            f[1][0],
            f[1][1],
            self.horizontal,
            self.vertical,
            self.inverse_horizontal,
            self.tilt_z_offset,
            self.tilt_z_gain,
        ]
    }

    /// From values in the order of the image.
    #[must_use]
    pub fn from_values(v: &[f64; WORDS]) -> Self {
        Self {
            tilt_offset: [v[0], v[1]],
            tilt_matrix: [[v[2], v[3]], [v[4], v[5]]],
            field_offset: [v[6], v[7]],
            field_matrix: [[v[8], v[9]], [v[10], v[11]]],
            horizontal: v[12],
            vertical: v[13],
            inverse_horizontal: v[14],
            tilt_z_offset: v[15],
            tilt_z_gain: v[16],
        }
    }
}
