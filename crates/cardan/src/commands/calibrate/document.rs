//! The result of a calibration as a document.

use std::path::Path;

use cardan_bench::calibration::{Accuracy, Calibrated};
use cardan_calibrate::{AxisFit, NAMES, PairFit};
use cardan_spec::calibration::{FRAC, WORDS};
use serde::Serialize;

use super::send::Sent;
use crate::run_options::Setup;

/// Steps of the converter per full scale.
const STEPS: f64 = cardan_units::AdcCode::CENTRE as f64;

/// Units of the calibration's values, in the order of the image.
const UNITS: [&str; WORDS] = [
    "fs", "fs", "g/fs", "g/fs", "g/fs", "g/fs", "fs", "fs", "B/fs", "B/fs", "B/fs", "B/fs", "B",
    "B", "1", "fs", "g/fs",
];

#[derive(Serialize)]
pub(super) struct Document {
    pub(super) app: &'static str,
    pub(super) scenario: String,
    pub(super) seed: u64,
    /// "attitudes" or "recording".
    pub(super) source: &'static str,
    pub(super) attitudes: Attitudes,
    pub(super) parameters: Vec<Parameter>,
    pub(super) channels: Vec<Channel>,
    pub(super) pairs: [Pair; 2],
    /// Error of the third tilt axis, rms over the working attitudes, that its sensitivities to body x and y
    /// leave; none where it is not measured.
    pub(super) cross_left_rms_mg: Option<f64>,
    pub(super) visits: Vec<Visit>,
    pub(super) held_out: HeldOut,
    pub(super) eeprom: Eeprom,
    /// None if it was sent nowhere.
    pub(super) sent: Option<Sent>,
    pub(super) remarks: Vec<String>,
}

#[derive(Serialize)]
pub(super) struct Attitudes {
    pub(super) used: usize,
    pub(super) left_out: usize,
    pub(super) solutions_used: usize,
    pub(super) solutions_saturated: usize,
}

#[derive(Serialize)]
pub(super) struct Parameter {
    pub(super) name: &'static str,
    pub(super) unit: &'static str,
    pub(super) value: f64,
    /// None for values that are given, not estimated.
    pub(super) standard_error: Option<f64>,
    pub(super) before: f64,
}

#[derive(Clone, Serialize)]
pub(super) struct Channel {
    pub(super) name: &'static str,
    /// To body x, y, z: steps of the converter per g or per |B|.
    pub(super) sensitivity_lsb: [f64; 3],
    pub(super) z_standard_error_lsb: f64,
    pub(super) residual_rms_lsb: f64,
    pub(super) residual_max_lsb: f64,
    /// Of the calibrated reading, in `unit`.
    pub(super) residual_rms: f64,
    pub(super) residual_max: f64,
    pub(super) unit: &'static str,
}

#[derive(Serialize)]
pub(super) struct Pair {
    pub(super) name: &'static str,
    pub(super) condition: f64,
    /// Error of the reading, in `unit`, that the sensitivity to body z leaves over the working
    /// attitudes.
    pub(super) z_left_rms: f64,
    pub(super) unit: &'static str,
}

#[derive(Serialize)]
pub(super) struct Visit {
    gravity_g: [f64; 3],
    field_b: [f64; 3],
    /// In channel order; a third tilt axis last, where it is measured.
    averages_fs: Vec<f64>,
    residuals_lsb: Vec<f64>,
    solutions: usize,
}

#[derive(Serialize)]
pub(super) struct HeldOut {
    pub(super) seed: u64,
    pub(super) attitudes: usize,
    pub(super) tilt_deg: f64,
    pub(super) before: Accuracy,
    pub(super) after: Accuracy,
}

#[derive(Serialize)]
pub(super) struct Eeprom {
    pub(super) file: Option<String>,
    pub(super) form: Option<&'static str>,
    pub(super) bytes: usize,
    /// The content, two digits per byte.
    pub(super) hex: String,
}

impl Document {
    pub(super) fn new(
        setup: &Setup,
        recorded: bool,
        out: Option<&Path>,
        calibrated: &Calibrated,
        sent: Option<Sent>,
    ) -> Self {
        let estimate = &calibrated.estimate;
        let held_out = calibrated.held_out;
        Self {
            app: setup.app.name(),
            scenario: setup.scenario.name.clone(),
            seed: setup.seed,
            source: if recorded { "recording" } else { "attitudes" },
            attitudes: Attitudes {
                used: calibrated.visits.len(),
                left_out: calibrated.left_out,
                solutions_used: calibrated.visits.iter().map(|visit| visit.solutions).sum(),
                solutions_saturated: calibrated.saturated,
            },
            parameters: parameters(calibrated),
            channels: [
                channels(["tilt_x", "tilt_y"], &estimate.tilt, 1e3, "mg"),
                channels(
                    ["field_x", "field_y"],
                    &estimate.field,
                    calibrated.total_ut,
                    "uT",
                ),
                estimate.tilt_z.iter().map(third).collect(),
            ]
            .concat(),
            cross_left_rms_mg: estimate.tilt_z.as_ref().map(|fit| 1e3 * fit.cross_left_rms),
            pairs: [
                pair("tilt", &estimate.tilt, 1e3, "mg"),
                pair("field", &estimate.field, calibrated.total_ut, "uT"),
            ],
            visits: visits(calibrated),
            held_out: HeldOut {
                seed: held_out.seed,
                attitudes: held_out.attitudes,
                tilt_deg: held_out.tilt_deg,
                before: held_out.before,
                after: held_out.after,
            },
            eeprom: Eeprom {
                file: out.map(|file| file.display().to_string()),
                form: out.map(crate::eeprom_file::form_name),
                bytes: calibrated.image.len(),
                hex: calibrated
                    .image
                    .iter()
                    .map(|byte| format!("{byte:02x}"))
                    .collect(),
            },
            sent,
            remarks: calibrated.remarks.clone(),
        }
    }
}

/// The image's values, as its words hold them.
fn parameters(calibrated: &Calibrated) -> Vec<Parameter> {
    let scale = f64::from(1_u32 << FRAC);
    let values = calibrated.estimate.calibration.to_values();
    let errors = calibrated.estimate.standard_errors.to_values();
    let before = calibrated.before.to_values();
    (0..WORDS)
        .map(|index| Parameter {
            name: NAMES[index],
            unit: UNITS[index],
            value: (values[index] * scale).round_ties_even() / scale,
            standard_error: (errors[index] > 0.0).then_some(errors[index]),
            before: before[index],
        })
        .collect()
}

fn channels(
    names: [&'static str; 2],
    fit: &PairFit,
    scale: f64,
    unit: &'static str,
) -> Vec<Channel> {
    let channel = |index: usize| {
        let residuals = &fit.residuals[index];
        Channel {
            name: names[index],
            sensitivity_lsb: fit.sensitivity[index].map(|s| STEPS * s),
            z_standard_error_lsb: STEPS * fit.z_standard_errors[index],
            residual_rms_lsb: STEPS * residuals.rms,
            residual_max_lsb: STEPS * residuals.max,
            residual_rms: scale * residuals.reading_rms,
            residual_max: scale * residuals.reading_max,
            unit,
        }
    };
    vec![channel(0), channel(1)]
}

fn third(fit: &AxisFit) -> Channel {
    let residuals = &fit.residuals;
    Channel {
        name: "tilt_z",
        sensitivity_lsb: fit.sensitivity.map(|s| STEPS * s),
        z_standard_error_lsb: STEPS * fit.z_standard_error,
        residual_rms_lsb: STEPS * residuals.rms,
        residual_max_lsb: STEPS * residuals.max,
        residual_rms: 1e3 * residuals.reading_rms,
        residual_max: 1e3 * residuals.reading_max,
        unit: "mg",
    }
}

fn pair(name: &'static str, fit: &PairFit, scale: f64, unit: &'static str) -> Pair {
    Pair {
        name,
        condition: fit.condition,
        z_left_rms: scale * fit.z_left_rms,
        unit,
    }
}

fn visits(calibrated: &Calibrated) -> Vec<Visit> {
    let (tilt, field) = (&calibrated.estimate.tilt, &calibrated.estimate.field);
    let third = calibrated.estimate.tilt_z.as_ref();
    let all = calibrated.visits.iter().enumerate();
    all.map(|(index, visit)| Visit {
        gravity_g: visit.observation.gravity,
        field_b: visit.observation.field,
        averages_fs: visit
            .observation
            .averages
            .into_iter()
            .chain(visit.observation.tilt_z)
            .collect(),
        residuals_lsb: tilt
            .residuals
            .iter()
            .chain(&field.residuals)
            .chain(third.map(|fit| &fit.residuals))
            .map(|residuals| STEPS * residuals.each[index])
            .collect(),
        solutions: visit.solutions,
    })
    .collect()
}
