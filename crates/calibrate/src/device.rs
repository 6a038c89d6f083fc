//! From the fits of two channels to what the device computes with.

use cardan_spec::calibration::{Calibration, FRAC, WORDS};
use nalgebra::{Matrix2, Vector2, Vector4};

use crate::error::Error;
use crate::fit::{Design, Fit, OFFSET, variance};
use crate::{AlongZ, AxisFit, Earth, Estimate, PairFit, Residuals, Working};

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

/// Offset and gain of a channel that stands alone, along body z, with their standard errors.
pub(crate) struct Alone {
    offset: f64,
    offset_error: f64,
    gain: f64,
    gain_error: f64,
    quality: AxisFit,
}

/// Inverts the sensitivity along z.
pub(crate) fn axis(design: &Design, fit: &Fit, working: Working) -> Result<Alone, Error> {
    let [to_x, to_y, to_z] = [0, 1, Z].map(|axis| fit.parameters[axis]);
    let cross = to_x.hypot(to_y);
    // As for two channels: what it feels along its own axis must not drown in the others.
    let ratio = cross / to_z.abs();
    if ratio.is_nan() || ratio >= SENSITIVITY_CONDITION {
        return Err(Error::InsensitiveToZ {
            sensitivity: [to_x, to_y, to_z],
        });
    }
    let standard =
        |gradient: Vector4<f64>| (fit.variance * gradient.dot(&(design.inverse * gradient))).sqrt();
    let z_standard_error = standard(Vector4::new(0.0, 0.0, 1.0, 0.0));
    let gain = 1.0 / to_z;
    let largest = |values: &[f64]| values.iter().fold(0.0, |most: f64, r| most.max(r.abs()));
    let rms = fit.variance.sqrt();
    let max = largest(&fit.residuals);
    Ok(Alone {
        offset: fit.parameters[OFFSET],
        offset_error: standard(Vector4::new(0.0, 0.0, 0.0, 1.0)),
        gain,
        gain_error: gain * gain * z_standard_error,
        quality: AxisFit {
            sensitivity: [to_x, to_y, to_z],
            z_standard_error,
            cross_left_rms: gain.abs() * cross * working.gravity_x_square().sqrt(),
            residuals: Residuals {
                rms,
                max,
                reading_rms: gain.abs() * rms,
                reading_max: gain.abs() * max,
                each: fit.residuals.clone(),
            },
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

/// Both pairs together, and the third axis; its values are nominal where it is not measured.
pub(crate) fn whole(
    tilt: Pair,
    field: Pair,
    third: Option<Alone>,
    earth: Earth,
) -> Result<Estimate, Error> {
    let nominal = Calibration::nominal(1.0, earth.horizontal, earth.vertical);
    let values = |third: &Alone| [third.offset, third.gain];
    let [tilt_z_offset, tilt_z_gain] = third
        .as_ref()
        .map_or([nominal.tilt_z_offset, nominal.tilt_z_gain], values);
    let errors = |third: &Alone| [third.offset_error, third.gain_error];
    let [offset_error, gain_error] = third.as_ref().map_or([0.0; 2], errors);
    let calibration = Calibration {
        tilt_offset: tilt.offset,
        tilt_matrix: tilt.matrix,
        field_offset: field.offset,
        field_matrix: field.matrix,
        horizontal: earth.horizontal,
        vertical: earth.vertical,
        inverse_horizontal: 1.0 / earth.horizontal,
        tilt_z_offset,
        tilt_z_gain,
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
        tilt_z_offset: offset_error,
        tilt_z_gain: gain_error,
    };
    Ok(Estimate {
        calibration,
        standard_errors,
        tilt: tilt.quality,
        field: field.quality,
        tilt_z: third.map(|third| third.quality),
    })
}
