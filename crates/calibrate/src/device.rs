//! From the fits of two channels to what the device computes with.

use cardan_spec::calibration::{Calibration, FRAC, WORDS};
use nalgebra::{Matrix2, Vector2, Vector4};

use crate::error::Error;
use crate::fit::{Design, Fit, variance};
use crate::{AlongZ, Earth, Estimate, PairFit, Residuals};

/// Index of body z among a channel's parameters.
const Z: usize = 2;

/// Largest condition number of the sensitivities along x and y: a unit whose axes are 10 degrees off
/// a right angle, with 30 % of cross-sensitivity and sensitivities that differ by half, has 4.
const SENSITIVITY_CONDITION: f64 = 100.0;

/// Names of the calibration's values, in the order of the image.
pub const NAMES: [&str; WORDS] = [
    "tilt_offset x",
    "tilt_offset y",
    "tilt_matrix xx",
    "tilt_matrix xy",
    "tilt_matrix yx",
    "tilt_matrix yy",
    "field_offset x",
    "field_offset y",
    "field_matrix xx",
    "field_matrix xy",
    "field_matrix yx",
    "field_matrix yy",
    "horizontal",
    "vertical",
    "inverse_horizontal",
    "tilt_z_offset",
    "tilt_z_gain",
];

/// Offset and matrix of two channels with their standard errors.
pub(crate) struct Pair {
    offset: [f64; 2],
    offset_errors: [f64; 2],
    matrix: [[f64; 2]; 2],
    matrix_errors: [[f64; 2]; 2],
    quality: PairFit,
}

/// Inverts the sensitivities along x and y, and folds z's mean effect into the offset.
pub(crate) fn pair(design: &Design, fits: [&Fit; 2], along_z: AlongZ) -> Result<Pair, Error> {
    let row = |fit: &Fit| [fit.parameters[0], fit.parameters[1]];
    let rows = fits.map(row);
    let sensitivity = Matrix2::new(rows[0][0], rows[0][1], rows[1][0], rows[1][1]);
    let inverse = sensitivity
        .try_inverse()
        .filter(|inverse| inverse.norm() * sensitivity.norm() <= SENSITIVITY_CONDITION)
        .ok_or(Error::Insensitive {
            vector: design.vector,
            sensitivity: rows,
        })?;
    // Gradient of the offset in the parameters: the constant, and z's mean effect.
    let fold = Vector4::new(0.0, 0.0, along_z.mean, 1.0);
    let standard = |fit: &Fit, gradient: &Vector4<f64>| {
        (fit.variance * gradient.dot(&(design.inverse * gradient))).sqrt()
    };
    let to_z = Vector2::new(fits[0].parameters[Z], fits[1].parameters[Z]);
    let z_gradient = Vector4::new(0.0, 0.0, 1.0, 0.0);
    Ok(Pair {
        offset: fits.map(|fit| fold.dot(&fit.parameters)),
        offset_errors: fits.map(|fit| standard(fit, &fold)),
        matrix: [0, 1].map(|k| [0, 1].map(|l| inverse[(k, l)])),
        matrix_errors: matrix_errors(design, fits, &inverse),
        quality: PairFit {
            condition: design.condition,
            sensitivity: fits.map(|fit| [0, 1, 2].map(|axis| fit.parameters[axis])),
            z_standard_errors: fits.map(|fit| standard(fit, &z_gradient)),
            z_left_rms: (inverse * to_z).norm() * along_z.deviation,
            residuals: residuals(fits, &inverse),
        },
    })
}

/// What the fits leave, of the averages and, through the matrix, of the readings.
fn residuals(fits: [&Fit; 2], matrix: &Matrix2<f64>) -> [Residuals; 2] {
    let largest = |values: &[f64]| values.iter().fold(0.0, |most: f64, r| most.max(r.abs()));
    [0, 1].map(|k| {
        let each = fits[k].residuals.clone();
        let readings: Vec<f64> = fits[0]
            .residuals
            .iter()
            .zip(&fits[1].residuals)
            .map(|(x, y)| matrix[(k, 0)] * x + matrix[(k, 1)] * y)
            .collect();
        Residuals {
            rms: fits[k].variance.sqrt(),
            max: largest(&each),
            reading_rms: variance(&readings).sqrt(),
            reading_max: largest(&readings),
            each,
        }
    })
}

/// Standard errors of the inverse M of the sensitivities S, to first order: dM = -M dS M, so that
/// dM_kl = - sum_ij M_ki dS_ij M_jl. The channels' errors are independent of each other.
fn matrix_errors(design: &Design, fits: [&Fit; 2], m: &Matrix2<f64>) -> [[f64; 2]; 2] {
    [0, 1].map(|k| {
        [0, 1].map(|l| {
            let gradient = Vector4::new(m[(0, l)], m[(1, l)], 0.0, 0.0);
            let spread = gradient.dot(&(design.inverse * gradient));
            let own = |i: usize| m[(k, i)] * m[(k, i)] * fits[i].variance;
            ((own(0) + own(1)) * spread).sqrt()
        })
    })
}

/// Both pairs together.
pub(crate) fn whole(tilt: Pair, field: Pair, earth: Earth) -> Result<Estimate, Error> {
    let calibration = Calibration {
        tilt_offset: tilt.offset,
        tilt_matrix: tilt.matrix,
        field_offset: field.offset,
        field_matrix: field.matrix,
        horizontal: earth.horizontal,
        vertical: earth.vertical,
        inverse_horizontal: 1.0 / earth.horizontal,
        ..Calibration::nominal(1.0, earth.horizontal, earth.vertical)
    };
    let limit = f64::from(1_u32 << (31 - FRAC));
    let beyond = calibration
        .to_values()
        .into_iter()
        .zip(NAMES)
        .find(|(value, _)| value.is_nan() || value.abs() >= limit);
    if let Some((value, name)) = beyond {
        return Err(Error::OutOfRange { name, value, limit });
    }
    let standard_errors = Calibration {
        tilt_offset: tilt.offset_errors,
        tilt_matrix: tilt.matrix_errors,
        field_offset: field.offset_errors,
        field_matrix: field.matrix_errors,
        horizontal: 0.0,
        vertical: 0.0,
        inverse_horizontal: 0.0,
        tilt_z_offset: 0.0,
        tilt_z_gain: 0.0,
    };
    Ok(Estimate {
        calibration,
        standard_errors,
        tilt: tilt.quality,
        field: field.quality,
    })
}
