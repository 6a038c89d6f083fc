//! Why a calibration cannot be estimated.

/// Each message says what is missing and how to mend it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// Not enough observations for four parameters per channel and their errors.
    #[error(
        "{found} usable attitudes; expected at least {least}: four unknowns per channel, and some \
         more attitudes to judge them by"
    )]
    TooFew {
        /// Usable observations.
        found: usize,
        /// Needed.
        least: usize,
    },
    /// The attitudes leave a combination of parameters open.
    #[error(
        "the attitudes do not determine the calibration (condition number {condition:.0}, expected \
         at most {limit:.0}): {vector} along body {axes} {covers}, so its effect cannot be told from an \
         offset or from another axis; add attitudes with both signs of it"
    )]
    Degenerate {
        /// "gravity" or "the field".
        vector: &'static str,
        /// Axes that take part in the open combination.
        axes: String,
        /// What they take, in g or |B|.
        covers: String,
        /// Condition number of the design.
        condition: f64,
        /// Largest admissible.
        limit: f64,
    },
    /// Averages that do not follow their axes.
    #[error(
        "the channels of {vector} do not tell body x from y: their sensitivities {sensitivity:?} (full \
         scales per unit) have no inverse; a channel is dead, or both lie along one axis"
    )]
    Insensitive {
        /// "gravity" or "the field".
        vector: &'static str,
        /// Rows: channels; columns: body x, y.
        sensitivity: [[f64; 2]; 2],
    },
    /// A third axis that does not follow its own.
    #[error(
        "the channel of the third tilt axis does not tell body z: its sensitivities to x, y, z are \
         {sensitivity:?} (full scales per g); the channel is dead, or lies along another axis"
    )]
    InsensitiveToZ {
        /// To body x, y, z.
        sensitivity: [f64; 3],
    },
    /// Beyond what the EEPROM's words hold.
    #[error(
        "{name} would be {value:.3}, and the device's words hold less than {limit} to either side: \
         the unit is too insensitive to be calibrated"
    )]
    OutOfRange {
        /// Value of the calibration.
        name: &'static str,
        /// What it would be.
        value: f64,
        /// Bound.
        limit: f64,
    },
}
