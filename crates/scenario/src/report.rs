//! What the report says about the scenario: the device's calibration and all assumptions.

use cardan_spec::calibration::Calibration;

use crate::field::EarthField;
use crate::parameter::Origin;
use crate::scenario::Scenario;
use crate::trajectory::Trajectory;

/// A value that is neither published nor given by the user.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Assumption {
    /// Key of the scenario file, or a description.
    pub key: String,
    /// Value with unit.
    pub value: String,
    /// Where it comes from.
    pub source: String,
}

/// Key of the assumption on the device's calibration.
pub const CALIBRATION: &str = "calibration";

/// The calibration that the device's EEPROM holds in this run.
///
/// Nominal sensors in the field of the run, each value replaced by the scenario's explicit one.
#[must_use]
pub fn calibration(scenario: &Scenario, trajectory: &Trajectory) -> Calibration {
    let explicit = &scenario.calibration;
    let of_run = trajectory.field();
    let field = EarthField {
        horizontal_ut: explicit.horizontal_ut.unwrap_or(of_run.horizontal_ut),
        vertical_ut: explicit.vertical_ut.unwrap_or(of_run.vertical_ut),
    };
    let (cosine, sine) = field.inclination();
    let nominal = Calibration::nominal(field.total_ut(), cosine, sine);
    Calibration {
        tilt_offset: explicit.tilt_offset.unwrap_or(nominal.tilt_offset),
        tilt_matrix: explicit.tilt_matrix.unwrap_or(nominal.tilt_matrix),
        field_offset: explicit.field_offset.unwrap_or(nominal.field_offset),
        field_matrix: explicit.field_matrix.unwrap_or(nominal.field_matrix),
        tilt_z_offset: explicit.tilt_z_offset.unwrap_or(nominal.tilt_z_offset),
        tilt_z_gain: explicit.tilt_z_gain.unwrap_or(nominal.tilt_z_gain),
        ..nominal
    }
}

/// Everything assumed in this run: estimates from the recording, the site, the calibration, and
/// every hardware parameter without a published value.
#[must_use]
pub fn assumptions(scenario: &Scenario, trajectory: &Trajectory) -> Vec<Assumption> {
    let mut all = trajectory.assumptions();
    if scenario.field.explicit().is_none() && trajectory.duration_s().is_none() {
        let EarthField {
            horizontal_ut,
            vertical_ut,
        } = trajectory.field();
        all.push(Assumption {
            key: "field.site".into(),
            value: format!(
                "{}: {horizontal_ut} and {vertical_ut} uT",
                scenario.field.site
            ),
            source: "IGRF (docs/sensors.md, section 5)".into(),
        });
    }
    all.push(calibration_assumption(scenario));
    all.extend(
        scenario
            .assumed_parameters()
            .into_iter()
            .map(|p| Assumption {
                key: format!("{}.{}", p.section, p.key),
                value: format!("{} {}", p.value, p.unit),
                source: match p.origin {
                    _ if p.value != p.default => format!("scenario; default {}", p.default),
                    Origin::Assumed(reason) | Origin::Published(reason) => reason.into(),
                    Origin::Setting => String::new(),
                },
            }),
    );
    all
}

fn calibration_assumption(scenario: &Scenario) -> Assumption {
    let c = &scenario.calibration;
    let given = [
        ("tilt_offset", c.tilt_offset.is_some()),
        ("tilt_matrix", c.tilt_matrix.is_some()),
        ("field_offset", c.field_offset.is_some()),
        ("field_matrix", c.field_matrix.is_some()),
        ("horizontal_ut", c.horizontal_ut.is_some()),
        ("vertical_ut", c.vertical_ut.is_some()),
    ];
    let names: Vec<&str> = given
        .iter()
        .filter(|(_, is)| *is)
        .map(|(name, _)| *name)
        .collect();
    Assumption {
        key: CALIBRATION.into(),
        value: if names.is_empty() {
            "nominal sensors in the field of the run".into()
        } else {
            format!("nominal but for {}", names.join(", "))
        },
        source: "the design's scale factors (spec)".into(),
    }
}
