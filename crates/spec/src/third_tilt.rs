//! The third tilt axis, along body z: an option.

use crate::{CHANNELS, MOST_CHANNELS};

/// Whether an accelerometer along body z is fitted, and what reads it. The discriminants are the
/// options of the EEPROM image ([`crate::calibration`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum ThirdTilt {
    /// None is fitted.
    #[default]
    Absent = 0,
    /// The controller's analog comparator, once per solution: the sign of gravity along body z.
    Comparator = 1,
    /// The converter, as the fifth channel of every round: gravity along body z.
    Measured = 2,
}

impl ThirdTilt {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Absent, Self::Comparator, Self::Measured];

    /// Channels that the converter converts in a round.
    #[must_use]
    pub const fn channels(self) -> usize {
        match self {
            Self::Absent | Self::Comparator => CHANNELS,
            Self::Measured => MOST_CHANNELS,
        }
    }

    /// Whether an axis is fitted.
    #[must_use]
    pub const fn is_fitted(self) -> bool {
        !matches!(self, Self::Absent)
    }

    /// From the options of an EEPROM image; `None` if they mean nothing.
    #[must_use]
    pub const fn from_options(options: u8) -> Option<Self> {
        match options {
            0 => Some(Self::Absent),
            1 => Some(Self::Comparator),
            2 => Some(Self::Measured),
            _ => None,
        }
    }

    /// Name, as in scenarios and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Absent => "absent",
            Self::Comparator => "comparator",
            Self::Measured => "measured",
        }
    }
}
