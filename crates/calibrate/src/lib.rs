//! Estimates a unit's calibration from what it read in known attitudes, by linear least squares.
//!
//! Each channel's average a (a fraction of full scale) is fitted as a = c + s . v, where v is the
//! true gravity in g, or the field over |B|, along body x, y, z: the noise is in the averages, so
//! they stand on the left. Two channels give the 2 x 2 block S of sensitivities along x and y; the
//! device computes v = S^-1 (a - offset) (`cardan_spec::calibration`).
//!
//! A third tilt axis, where it is measured, stands alone: offset and gain, whatever it feels along x and y
//! is left and reported ([`AxisFit::cross_left_rms`]).
//!
//! The model of two channels has no z. A sensitivity to z is estimated all the same, or it would falsify the rest;
//! its mean effect over the attitudes in which the device works ([`Working`]) goes into the offset,
//! and what is left is reported ([`PairFit::z_left_rms`]).

mod device;
mod error;
mod fit;

use cardan_spec::CHANNELS;
use cardan_spec::calibration::Calibration;
use serde::Serialize;

pub use device::NAMES;
pub use error::Error;

/// What a unit read at rest in one attitude, and what it should have read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Averages over full scale, in channel order.
    pub averages: [f64; CHANNELS],
    /// The same of the third tilt axis, where it is measured.
    pub tilt_z: Option<f64>,
    /// Gravity along body x, y, z in g.
    pub gravity: [f64; 3],
    /// Field along body x, y, z over |B|.
    pub field: [f64; 3],
}

/// The Earth's field where the unit will work: its components over |B|.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Earth {
    /// Cosine of the inclination.
    pub horizontal: f64,
    /// Sine of the inclination, positive downward.
    pub vertical: f64,
}

/// The attitudes in which the unit will work: body z uniformly within a cone about down, any heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Working {
    /// Cosine of the largest tilt.
    pub cos_tilt: f64,
}

/// A calibration with what is known about its quality.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// What goes into the unit's EEPROM.
    pub calibration: Calibration,
    /// Standard error of each of its values; 0 for the field's direction, which is given.
    pub standard_errors: Calibration,
    /// Quality of the tilt channels' fit; readings in g.
    pub tilt: PairFit,
    /// Quality of the field channels' fit; readings in |B|.
    pub field: PairFit,
    /// Quality of the third tilt axis's fit, where it is measured; readings in g.
    pub tilt_z: Option<AxisFit>,
}

/// Quality of the fit of a channel that stands alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisFit {
    /// Sensitivity to body x, y, z: full scales per unit of reading.
    pub sensitivity: [f64; 3],
    /// Standard error of the sensitivity to z.
    pub z_standard_error: f64,
    /// Error of the reading (rms over the working attitudes) that the sensitivities to x and y leave.
    pub cross_left_rms: f64,
    /// What the fit leaves.
    pub residuals: Residuals,
}

/// Quality of the fit of two channels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairFit {
    /// Condition number of the attitudes as a design: 1.7 for a whole sphere.
    pub condition: f64,
    /// Sensitivity of both channels to body x, y, z: full scales per unit of reading.
    pub sensitivity: [[f64; 3]; 2],
    /// Standard errors of the sensitivities to z.
    pub z_standard_errors: [f64; 2],
    /// Error of the reading (both components together, rms over the working attitudes) that the
    /// sensitivity to z leaves.
    pub z_left_rms: f64,
    /// Residuals of both channels.
    pub residuals: [Residuals; 2],
}

/// What the fit of one channel leaves.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Residuals {
    /// Of each observation: fractions of full scale.
    #[serde(skip)]
    pub each: Vec<f64>,
    /// Estimated standard deviation (degrees of freedom taken off), fractions of full scale.
    pub rms: f64,
    /// Largest, fractions of full scale.
    pub max: f64,
    /// As `rms`, of the reading along the channel's own axis.
    pub reading_rms: f64,
    /// As `max`, of the reading along the channel's own axis.
    pub reading_max: f64,
}

/// Estimates the calibration of the unit that made `observations`.
///
/// # Errors
/// Too few observations, attitudes that do not determine the parameters, a channel that does not
/// feel its axis, values that the device's words cannot hold.
pub fn estimate(
    observations: &[Observation],
    earth: Earth,
    working: Working,
) -> Result<Estimate, Error> {
    if observations.len() < fit::LEAST {
        return Err(Error::TooFew {
            found: observations.len(),
            least: fit::LEAST,
        });
    }
    let gravity: Vec<[f64; 3]> = observations.iter().map(|o| o.gravity).collect();
    let field: Vec<[f64; 3]> = observations.iter().map(|o| o.field).collect();
    let channel = |index: usize| observations.iter().map(move |o| o.averages[index]);
    let gravity_design = fit::Design::new("gravity", &gravity)?;
    let tilt = device::pair(
        &gravity_design,
        [
            &gravity_design.fit(channel(0)),
            &gravity_design.fit(channel(1)),
        ],
        working.gravity_z(),
    )?;
    let along_z: Option<Vec<f64>> = observations.iter().map(|o| o.tilt_z).collect();
    let third = along_z
        .map(|averages| {
            device::axis(
                &gravity_design,
                &gravity_design.fit(averages.into_iter()),
                working,
            )
        })
        .transpose()?;
    let field = fit::Design::new("the field", &field)?;
    let field = device::pair(
        &field,
        [&field.fit(channel(2)), &field.fit(channel(3))],
        working.field_z(earth),
    )?;
    device::whole(tilt, field, third, earth)
}

/// Mean and standard deviation of a reading along body z.
#[derive(Clone, Copy, Debug)]
struct AlongZ {
    mean: f64,
    deviation: f64,
}

impl Working {
    /// Of gravity: the cosine of the tilt, uniform between its ends on a sphere.
    fn gravity_z(self) -> AlongZ {
        AlongZ {
            mean: (1.0 + self.cos_tilt) / 2.0,
            deviation: (1.0 - self.cos_tilt) / 12_f64.sqrt(),
        }
    }

    /// Mean square of gravity along body x, and along y.
    fn gravity_x_square(self) -> f64 {
        let down = self.gravity_z();
        (1.0 - down.mean * down.mean - down.deviation * down.deviation) / 2.0
    }

    /// Of the field over |B|: its vertical part goes with gravity's z, its horizontal part with the
    /// sine of the tilt and the cosine of the heading.
    fn field_z(self, earth: Earth) -> AlongZ {
        let down = self.gravity_z();
        let horizontal_square = earth.horizontal * earth.horizontal * self.gravity_x_square();
        let vertical = earth.vertical * down.deviation;
        AlongZ {
            mean: earth.vertical * down.mean,
            deviation: (vertical * vertical + horizontal_square).sqrt(),
        }
    }
}
