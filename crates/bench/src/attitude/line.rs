//! The device's serial line as a production bench reads it: what it tells, and when it was true.

use std::sync::Arc;

use cardan_firmware::calibration::Settings;
use cardan_frontend::AdcErrors;
use cardan_golden::frame::Frame;
use cardan_scenario::{Scenario, Trajectory};
use cardan_spec::CHANNELS;

use super::emulated::EmulatedDevice;
use super::{configuration_of, frames};
use crate::calibration::CalibrateError;
use crate::engine::{Device, Sink, SinkError, Truth};
use crate::image::Firmware;

/// A unit: its hardware and what it is programmed with.
pub(super) struct Unit<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) firmware: &'a Firmware,
    /// Seed of what is the unit's own: where its converter's steps lie.
    pub(super) seed: u64,
}

/// A solution as its frame tells it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Told {
    /// The instant whose attitude it tells, seconds after reset.
    pub(super) time_s: f64,
    /// Averages over full scale.
    pub(super) averages: [f64; CHANNELS],
    /// The same of the third tilt axis, where it is measured.
    pub(super) tilt_z: Option<f64>,
    /// Yaw, pitch, roll in half turns.
    pub(super) angles: [f64; 3],
    /// Status bits.
    pub(super) flags: u16,
}

/// Keeps frames and output instants, in order.
#[derive(Default)]
struct Line {
    frames: Vec<Frame>,
    times_s: Vec<f64>,
}

impl Sink for Line {
    fn truth(&mut self, truth: &Truth) -> Result<(), SinkError> {
        self.times_s.push(truth.time_s);
        Ok(())
    }

    fn frame(&mut self, cycle: u64, bytes: &[u8]) -> Result<(), SinkError> {
        let frame = frames::decode_frame(bytes).map_err(|why| {
            format!(
                "what left the serial line before cycle {cycle} is no binary frame: {why} ({:?})",
                String::from_utf8_lossy(bytes)
            )
        })?;
        self.frames.push(frame);
        Ok(())
    }
}

impl Unit<'_> {
    /// Runs the unit for `seconds` with `settings`; `seed` is the noise's.
    pub(super) fn run(
        &self,
        trajectory: &Arc<Trajectory>,
        seconds: f64,
        settings: &Settings,
        seed: u64,
    ) -> Result<(Vec<Told>, Vec<String>), CalibrateError> {
        let configuration = configuration_of(settings, seconds).map_err(CalibrateError::Input)?;
        let converter = AdcErrors::new(self.scenario, self.seed).with_noise_of(seed);
        let mut engine = EmulatedDevice::new(
            self.scenario,
            seed,
            Arc::clone(trajectory),
            &configuration,
            self.firmware,
        )
        .map_err(CalibrateError::Input)?
        .with_converter(converter);
        let mut line = Line::default();
        let summary = engine
            .run(&mut line)
            .map_err(|error| CalibrateError::Input(format!("{}: {error}", self.firmware.name)))?;
        if let Some(crash) = summary.crash {
            return Err(CalibrateError::Crash(crash));
        }
        let mut remarks = summary.remarks;
        if summary.late_conversions + summary.missed_deadlines > 0 {
            remarks.push(format!(
                "{} late conversions, {} missed deadlines",
                summary.late_conversions, summary.missed_deadlines
            ));
        }
        Ok((self.told(&line, configuration.solutions)?, remarks))
    }

    /// Frames with their instants; the sequence numbers say that none is missing.
    fn told(&self, line: &Line, solutions: u64) -> Result<Vec<Told>, CalibrateError> {
        let numbered = line
            .frames
            .iter()
            .zip(0_u16..=u16::MAX)
            .all(|(frame, index)| frame.sequence == index);
        if !numbered || line.frames.len() as u64 != solutions {
            return Err(CalibrateError::Input(format!(
                "{}: sent {} frames for {solutions} solutions, or not in sequence; give firmware that \
                 sends a frame for each",
                self.firmware.name,
                line.frames.len()
            )));
        }
        let told = line.frames.iter().zip(&line.times_s);
        Ok(told
            .map(|(frame, &time_s)| Told::new(frame, time_s))
            .collect())
    }
}

impl Told {
    fn new(frame: &Frame, time_s: f64) -> Self {
        Self {
            time_s,
            averages: frame.averages,
            tilt_z: frame.tilt_z,
            angles: frame.angles,
            flags: frame.status,
        }
    }
}
