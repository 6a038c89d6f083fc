//! Settings from EEPROM: averaging, and the calibration in the datapath's formats.

use cardan_datapath::{Arithmetic, Node, Value};
use cardan_spec::ThirdTilt;
use cardan_spec::calibration::{
    AVERAGING_AT, FRAC, LEN, MAGIC, OPTIONS_AT, PERIOD_AT, VERSION, WORDS, WORDS_AT,
};
use cardan_spec::timing::Averaging;

use crate::frame::crc16;
use crate::nodes::{FieldGain, InverseHorizontal, Offset, TiltGain, Vertical};

/// What a device works with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Calibration, in the order and format of the EEPROM image.
    pub words: [i32; WORDS],
    /// Lengths of averages and periods, and the channels of `third_tilt`.
    pub averaging: Averaging,
    /// The third tilt axis.
    pub third_tilt: ThirdTilt,
    /// There is no valid image: these are the nominal values.
    pub uncalibrated: bool,
}

impl Settings {
    /// Those of an EEPROM image, the nominal ones if it is not valid.
    #[must_use]
    #[inline(never)]
    pub fn from_image(image: &[u8; LEN]) -> Self {
        let mut settings = Self {
            words: NOMINAL,
            averaging: Averaging::DEFAULT,
            third_tilt: ThirdTilt::Absent,
            uncalibrated: true,
        };
        if let Some((averaging, third_tilt)) = valid(image) {
            settings.averaging = averaging.with(third_tilt);
            settings.third_tilt = third_tilt;
            settings.uncalibrated = false;
            let bytes = image[WORDS_AT..].chunks_exact(4);
            for (word, bytes) in settings.words.iter_mut().zip(bytes) {
                *word = i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            }
        }
        settings
    }

    /// The EEPROM image of these settings.
    #[must_use]
    pub fn image(&self) -> [u8; LEN] {
        let mut image = [0; LEN];
        image[..2].copy_from_slice(&MAGIC.to_le_bytes());
        image[2] = VERSION;
        image[3] = WORDS as u8;
        image[AVERAGING_AT] = self.averaging.log2();
        image[PERIOD_AT] = self.averaging.period_log2();
        image[OPTIONS_AT] = self.third_tilt as u8;
        for (bytes, word) in image[WORDS_AT..].chunks_exact_mut(4).zip(&self.words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        let crc = crc16(&image[..LEN - 2]);
        image[LEN - 2..].copy_from_slice(&crc.to_le_bytes());
        image
    }
}

/// The averaging and the option of an image whose magic, version, length, values and checksum are right.
fn valid(image: &[u8; LEN]) -> Option<(Averaging, ThirdTilt)> {
    let stored = u16::from_le_bytes([image[LEN - 2], image[LEN - 1]]);
    let header = u16::from_le_bytes([image[0], image[1]]) == MAGIC
        && image[2] == VERSION
        && usize::from(image[3]) == WORDS;
    if !header || crc16(&image[..LEN - 2]) != stored {
        return None;
    }
    let averaging = Averaging::new(image[AVERAGING_AT], image[PERIOD_AT])?;
    Some((averaging, ThirdTilt::from_options(image[OPTIONS_AT])?))
}

const fn word(value: f64) -> i32 {
    cardan_datapath::Format::new(
        32,
        FRAC,
        cardan_datapath::Rounding::NearestAway,
        cardan_datapath::Overflow::Saturate,
    )
    .constant(value) as i32
}

/// What an uncalibrated device computes with: nominal sensors at the reference site (sensors
/// reference, section 5, 2026: Bh 23.834 uT, Bv 40.290 uT).
pub const NOMINAL: [i32; WORDS] = {
    const TOTAL_UT: f64 = 46.812;
    const COS: f64 = 23.834 / TOTAL_UT;
    const SIN: f64 = 40.290 / TOTAL_UT;
    const GAIN: f64 = cardan_spec::FIELD_FULL_SCALE_UT / TOTAL_UT;
    const TILT: f64 = -cardan_spec::TILT_FULL_SCALE_G;
    const OFFSET: f64 = -0.5 / 512.0;
    [
        word(OFFSET),
        word(OFFSET),
        word(TILT),
        0,
        0,
        word(TILT),
        word(OFFSET),
        word(OFFSET),
        word(GAIN),
        0,
        0,
        word(GAIN),
        word(COS),
        word(SIN),
        word(1.0 / COS),
        word(OFFSET),
        word(TILT),
    ]
};

/// A word in its node's format. Not inlined: fourteen of them share three formats.
#[inline(never)]
fn setting<M: Arithmetic, N: Node>(m: &M, word: i32) -> Value<M, N> {
    m.parameter::<N, FRAC>(word)
}

/// The calibration in the formats of the datapath.
pub struct Calibration<M: Arithmetic> {
    pub(crate) tilt_offset: [Value<M, Offset>; 2],
    pub(crate) tilt_gain: [[Value<M, TiltGain>; 2]; 2],
    pub(crate) field_offset: [Value<M, Offset>; 2],
    pub(crate) field_gain: [[Value<M, FieldGain>; 2]; 2],
    pub(crate) vertical: Value<M, Vertical>,
    pub(crate) inverse_horizontal: Value<M, InverseHorizontal>,
    pub(crate) tilt_z_offset: Value<M, Offset>,
    pub(crate) tilt_z_gain: Value<M, TiltGain>,
    pub(crate) third_tilt: ThirdTilt,
}

impl<M: Arithmetic> Calibration<M> {
    /// Rounds the words into the datapath's formats. `third_tilt` is constant in a run.
    pub fn new(m: &M, words: &[i32; WORDS], third_tilt: ThirdTilt) -> Self {
        let offset = |index: usize| setting::<M, Offset>(m, words[index]);
        let tilt = |index: usize| setting::<M, TiltGain>(m, words[index]);
        let field = |index: usize| setting::<M, FieldGain>(m, words[index]);
        Self {
            tilt_offset: [offset(0), offset(1)],
            tilt_gain: [[tilt(2), tilt(3)], [tilt(4), tilt(5)]],
            field_offset: [offset(6), offset(7)],
            field_gain: [[field(8), field(9)], [field(10), field(11)]],
            vertical: setting(m, words[13]),
            inverse_horizontal: setting(m, words[14]),
            tilt_z_offset: offset(15),
            tilt_z_gain: tilt(16),
            third_tilt,
        }
    }
}
