//! What a calibration of a unit asks for, and what it gives.

use cardan_calibrate::{Error, Estimate, Observation};
use cardan_scenario::Scenario;
use cardan_spec::calibration::Calibration;

use crate::image::Firmware;

/// A unit on its bench, and how it is to be calibrated.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The unit with its surroundings; a recording as motion is calibrated from, where it is slow.
    pub scenario: &'a Scenario,
    /// Seed of the noise and of the attitudes. The check uses the next one.
    pub seed: u64,
    /// Seconds of a recording at most.
    pub seconds: f64,
    /// What the unit's chip is programmed with.
    pub firmware: &'a Firmware,
    /// Attitudes, of the calibration and of its check.
    pub attitudes: usize,
    /// Solutions averaged in each attitude.
    pub solutions: usize,
}

/// A calibration and what is known of it.
#[derive(Clone, Debug)]
pub struct Calibrated {
    /// What the device computed with before.
    pub before: Calibration,
    /// The estimate.
    pub estimate: Estimate,
    /// |B| in microtesla.
    pub total_ut: f64,
    /// Content of the EEPROM with the estimate.
    pub image: Vec<u8>,
    /// What was estimated from.
    pub visits: Vec<Visit>,
    /// Attitudes that were left out, since in most of their solutions a channel was saturated.
    pub left_out: usize,
    /// Solutions that were left out as saturated, those of attitudes left out among them.
    pub saturated: usize,
    /// The check in other attitudes.
    pub held_out: HeldOut,
    /// What is worth saying about the runs.
    pub remarks: Vec<String>,
}

/// One attitude in which the unit was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Visit {
    /// Mean averages and what they should have been.
    pub observation: Observation,
    /// Solutions that count.
    pub solutions: usize,
}

/// Attitude errors in attitudes that the estimate has not seen, under the next seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldOut {
    /// Seed of noise and attitudes.
    pub seed: u64,
    /// Attitudes.
    pub attitudes: usize,
    /// Largest tilt in degrees.
    pub tilt_deg: f64,
    /// With the calibration before.
    pub before: Accuracy,
    /// With the estimate.
    pub after: Accuracy,
}

/// Rotation angles between told and true attitudes over unflagged solutions, in degrees.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Accuracy {
    /// Root mean square; none without solutions, as all.
    pub rms_deg: Option<f64>,
    /// Largest.
    pub max_deg: Option<f64>,
    /// Scatter within the attitudes: what no calibration removes.
    pub noise_rms_deg: Option<f64>,
    /// Solutions that count.
    pub samples: usize,
    /// Solutions left out for their status bits.
    pub flagged: usize,
}

/// Why a unit could not be calibrated.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// The input is not usable.
    #[error("{0}")]
    Input(String),
    /// The attitudes or readings do not give a calibration.
    #[error(transparent)]
    Estimate(#[from] Error),
    /// The emulated program crashed.
    #[error("the emulated program crashed: {0}")]
    Crash(String),
}
