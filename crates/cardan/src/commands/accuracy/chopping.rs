//! The tilt channels' noise by chopping frequency.

use std::fmt::Write as _;

use cardan_bench::accuracy::FIELD_UT;
use cardan_frontend::chopping::{chopped, unchopped};
use cardan_scenario::Scenario;
use serde::Serialize;

use crate::failure::Failure;

/// Windows of the averages: a single conversion, and 16 and 64 of the reference board, in seconds.
const WINDOWS_S: [f64; 3] = [0.0, 0.008, 0.032];

/// How long an unchopped bridge keeps its zero: 1/f noise has no variance without an end.
const OBSERVED_S: f64 = 100.0;

/// Tangent of the inclination at the reference's site: a tilt turns the plane in which yaw is measured.
const YAW_PER_TILT: f64 = FIELD_UT[1] / FIELD_UT[0];

#[derive(Serialize)]
pub(super) struct Document {
    scenario: String,
    windows_s: [f64; 3],
    unchopped_observed_s: f64,
    rows: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    /// None: not chopped.
    chopping_hz: Option<f64>,
    turn_ms: Option<f64>,
    group_delay_ms: Option<f64>,
    residue_lsb: Option<f64>,
    /// Of bridge and amplifier, in averages over the windows.
    electronics_mg: Vec<f64>,
    /// With the sensor's own white noise.
    all_mg: Option<Vec<f64>>,
    /// What the electronics' noise of the longest average does to the level device.
    tilt_deg: f64,
    yaw_deg: f64,
}

/// Computes a row per frequency, and one without chopping.
pub(super) fn document(scenario: &Scenario, frequencies: &[f64]) -> Result<Document, Failure> {
    let mut quiet = scenario.clone();
    quiet.sensors.accelerometer.noise_mg_per_rthz = 0.0;
    let in_mg = |noise: Vec<f64>| noise.iter().map(|g| 1e3 * g).collect::<Vec<f64>>();
    let mut rows = vec![Row::new(in_mg(unchopped(&quiet, OBSERVED_S, &WINDOWS_S)))];
    for &frequency in frequencies {
        let at = |scenario| {
            chopped(scenario, frequency, &WINDOWS_S)
                .map_err(|error| Failure::input(format!("--chopping {frequency}: {error}")))
        };
        let (all, electronics) = (at(scenario)?, at(&quiet)?);
        rows.push(Row {
            chopping_hz: Some(frequency),
            turn_ms: Some(1e3 * all.turn_s),
            group_delay_ms: Some(1e3 * all.design.group_delay_s),
            residue_lsb: Some(all.design.residue_lsb),
            all_mg: Some(in_mg(all.noise_g)),
            ..Row::new(in_mg(electronics.noise_g))
        });
    }
    Ok(Document {
        scenario: scenario.name.clone(),
        windows_s: WINDOWS_S,
        unchopped_observed_s: OBSERVED_S,
        rows,
    })
}

impl Row {
    fn new(electronics_mg: Vec<f64>) -> Self {
        let longest = electronics_mg.last().copied().unwrap_or(0.0);
        let tilt_deg = (1e-3 * longest).to_degrees();
        Self {
            chopping_hz: None,
            turn_ms: None,
            group_delay_ms: None,
            residue_lsb: None,
            electronics_mg,
            all_mg: None,
            tilt_deg,
            yaw_deg: YAW_PER_TILT * tilt_deg,
        }
    }
}

impl Document {
    pub(super) fn table(&self) -> String {
        let mut out = format!(
            "Tilt noise in mg rms of a conversion / average over 8 ms / over 32 ms; level device, \
             rms degrees from the last of the electronics' ({})\n\n\
             | chopping | turn | group delay | residue | electronics | with the sensor's white noise | tilt | yaw |\n\
             |---|---|---|---|---|---|---|---|\n",
            self.scenario
        );
        let cell = |value: Option<f64>, unit: &str| match value {
            Some(value) => format!("{value:.3} {unit}"),
            None => "-".to_owned(),
        };
        let noise = |mg: &Vec<f64>| {
            let parts: Vec<String> = mg.iter().map(|mg| format!("{mg:.3}")).collect();
            parts.join(" / ")
        };
        for row in &self.rows {
            let frequency = row.chopping_hz.map(|hz| 1e-3 * hz);
            let chopping = match frequency {
                None => format!("none, zero {} s old", self.unchopped_observed_s),
                Some(khz) => format!("{khz} kHz"),
            };
            let _ = writeln!(
                out,
                "| {chopping} | {} | {} | {} | {} | {} | {:.4} | {:.4} |",
                cell(row.turn_ms, "ms"),
                cell(row.group_delay_ms, "ms"),
                cell(row.residue_lsb, "LSB"),
                noise(&row.electronics_mg),
                row.all_mg.as_ref().map_or("-".to_owned(), noise),
                row.tilt_deg,
                row.yaw_deg,
            );
        }
        out
    }
}
