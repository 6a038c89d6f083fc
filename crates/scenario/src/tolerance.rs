//! Limits of the verdict, as a scenario file states them.

use std::collections::BTreeMap;

use serde::Deserialize;

/// Limits of the verdict.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tolerance {
    /// Largest difference between golden and native per node, in the node's unit, in place of what
    /// rounding explains.
    pub nodes: BTreeMap<String, f64>,
    /// Limits of the error against truth; absent: reported, not judged.
    pub truth: TruthTolerance,
    /// Limits of the error that single stages bring; absent: reported, not judged.
    pub stages: StageTolerance,
    /// Limits of the mean by which a channel's voltage may be off ideal sensors.
    pub channels: ChannelTolerance,
    /// Limits of the share of solutions with status bits.
    pub status: StatusTolerance,
}

/// Limits of the rotation angle between output and true attitude.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TruthTolerance {
    /// Root mean square in degrees.
    pub rms_deg: Option<f64>,
    /// 99th percentile in degrees.
    pub p99_deg: Option<f64>,
    /// Maximum in degrees.
    pub max_deg: Option<f64>,
    /// Why these limits.
    pub reason: String,
}

/// Limits of the rms rotation that a stage of the chain brings, in degrees.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StageTolerance {
    /// Latency and channel skew.
    pub latency_deg: Option<f64>,
    /// Acceleration and disturbed field.
    pub motion_deg: Option<f64>,
    /// Sensors and front end.
    pub sensor_frontend_deg: Option<f64>,
    /// Converter.
    pub adc_deg: Option<f64>,
    /// Why these limits.
    pub reason: String,
}

/// Limits of the difference between a channel's held voltage and ideal sensors. To those of gain and delay comes
/// what the run's own noise leaves open.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ChannelTolerance {
    /// Size of its mean, in steps of the converter.
    pub bias_lsb: Option<f64>,
    /// By which part of the ideal sensors' signal the held one may be too large or too small.
    pub gain: Option<f64>,
    /// By how many milliseconds it may be late, or early, beside the nominal group delay.
    pub delay_ms: Option<f64>,
    /// Largest mean over a solution, in root mean squares of all such means.
    pub peak: Option<f64>,
    /// Why this limit.
    pub reason: String,
}

/// Limits of the share of solutions with status bits.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StatusTolerance {
    /// Largest share, 0 to 1.
    pub most_flagged: Option<f64>,
    /// Least time with solutions without status bits, in seconds of a run of the scenario's length or
    /// longer: where the half-space may be lost for good, the share depends on how long the run is.
    pub least_unflagged_s: Option<f64>,
    /// Why this limit.
    pub reason: String,
}

/// It is a time, not a limit that grows.
const LEAST_UNFLAGGED: &str = "tolerance.status.least_unflagged_s";
/// Limits that hold for whole runs of the scenario only.
const WHOLE_RUN: [&str; 3] = [
    "tolerance.channels.gain",
    "tolerance.channels.delay_ms",
    "tolerance.channels.peak",
];

impl Tolerance {
    /// Every limit by its key, with its admissible range and its unit.
    fn limits(&mut self) -> [(&'static str, &mut Option<f64>, f64, &'static str); 13] {
        let degrees = "0 to 180 deg";
        [
            (
                "tolerance.truth.rms_deg",
                &mut self.truth.rms_deg,
                180.0,
                degrees,
            ),
            (
                "tolerance.truth.p99_deg",
                &mut self.truth.p99_deg,
                180.0,
                degrees,
            ),
            (
                "tolerance.truth.max_deg",
                &mut self.truth.max_deg,
                180.0,
                degrees,
            ),
            (
                "tolerance.stages.latency_deg",
                &mut self.stages.latency_deg,
                180.0,
                degrees,
            ),
            (
                "tolerance.stages.motion_deg",
                &mut self.stages.motion_deg,
                180.0,
                degrees,
            ),
            (
                "tolerance.stages.sensor_frontend_deg",
                &mut self.stages.sensor_frontend_deg,
                180.0,
                degrees,
            ),
            (
                "tolerance.stages.adc_deg",
                &mut self.stages.adc_deg,
                180.0,
                degrees,
            ),
            (
                "tolerance.channels.bias_lsb",
                &mut self.channels.bias_lsb,
                1024.0,
                "0 to 1024 LSB",
            ),
            (
                "tolerance.channels.gain",
                &mut self.channels.gain,
                2.0,
                "a part of the signal, 0 to 2",
            ),
            (
                "tolerance.channels.delay_ms",
                &mut self.channels.delay_ms,
                1e6,
                "0 to 1e6 ms",
            ),
            (
                "tolerance.channels.peak",
                &mut self.channels.peak,
                1e6,
                "root mean squares, 0 to 1e6",
            ),
            (
                "tolerance.status.most_flagged",
                &mut self.status.most_flagged,
                1.0,
                "a share, 0 to 1",
            ),
            (
                "tolerance.status.least_unflagged_s",
                &mut self.status.least_unflagged_s,
                1e6,
                "0 to 1e6 s",
            ),
        ]
    }

    /// Every limit that is set or not, with its key, largest admissible value and unit.
    pub(crate) fn checked(&self) -> Vec<(&'static str, Option<f64>, f64, &'static str)> {
        let mut all = self.clone();
        let limits = all.limits().into_iter();
        limits
            .map(|(key, limit, most, unit)| (key, *limit, most, unit))
            .collect()
    }

    /// All limits wider by `factor` but those with the full keys `exact`; `seconds` is the length for which
    /// the least unflagged time is stated.
    #[must_use]
    pub(crate) fn widened(&self, factor: f64, seconds: f64, exact: &[&str]) -> Self {
        let mut tolerance = self.clone();
        for (key, limit, most, _) in tolerance.limits() {
            if exact.contains(&key) || key == LEAST_UNFLAGGED {
                continue;
            }
            // Gain, delay and peak of a part of the scenario (a step, say) are others than those of all of it.
            let holds = !WHOLE_RUN.contains(&key) || factor <= 1.0;
            *limit = limit
                .filter(|_| holds)
                .map(|limit| (factor * limit).min(most));
        }
        if let Some(least_s) = tolerance.status.least_unflagged_s {
            let share = 1.0 - least_s / seconds / factor;
            let most = tolerance.status.most_flagged.unwrap_or(1.0);
            tolerance.status.most_flagged = Some(most.min(share.max(0.0)));
        }
        tolerance
    }

    /// Sets the limit of that full key; false if there is none.
    pub(crate) fn set(&mut self, key: &str, value: f64) -> bool {
        if let Some(node) = key.strip_prefix("tolerance.nodes.") {
            self.nodes.insert(node.to_owned(), value);
            return true;
        }
        let mut limits = self.limits().into_iter();
        let found = limits.find(|(name, ..)| *name == key);
        if let Some((_, limit, ..)) = found {
            *limit = Some(value);
            return true;
        }
        false
    }
}
