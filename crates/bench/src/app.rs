//! An application: one algorithm with its golden model, board, sensors and nodes.

use std::collections::BTreeMap;

use cardan_datapath::{Format, NodeInfo};
use cardan_numerics::tape::Flow;
use cardan_outputs::{Check, Message, Outputs, Stage};
use cardan_scenario::Scenario;
use cardan_spec::ThirdTilt;
use cardan_spec::timing::Averaging;
use cardan_tune::Problem;

use crate::attitude::Attitude;
use crate::calibration::{CalibrateError, Calibrated, Request};
use crate::engine::{Conversion, Device, Engine, Summary, Truth};
use crate::image::{EepromImage, Firmware};

/// What a run is made of, as the emulated participant decides it and the others are told.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Configuration {
    /// Words of the calibration in the device's EEPROM.
    pub calibration: Vec<i32>,
    /// Solutions of the run.
    pub solutions: u64,
    /// log2 of the conversions averaged per channel.
    pub averaging_log2: u8,
    /// log2 of the conversions per channel from one solution to the next.
    pub period_log2: u8,
    /// The third tilt axis, as in the options of the EEPROM image.
    pub third_tilt: u8,
    /// Whether each node's share of the rounding is wanted.
    #[serde(default)]
    pub shares: bool,
    /// What the emulated participant was asked to run, by option: whoever judges was asked the same.
    #[serde(default)]
    pub request: BTreeMap<String, String>,
}

/// A participant that computes stages of the chain besides what it publishes as nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Party {
    /// The one with the emulated device, which knows what its sensors experience.
    Emulated,
    /// The one with the golden model.
    Golden,
}

/// Places of stages in [`App::stages`], each with the engine whose values of the group's nodes are the stage's.
pub type Models = Vec<(usize, Box<dyn Engine>)>;

impl Configuration {
    /// The third tilt axis; none where the field says nothing admissible.
    #[must_use]
    pub fn third_tilt(&self) -> ThirdTilt {
        ThirdTilt::from_options(self.third_tilt).unwrap_or_default()
    }

    /// How conversions are averaged; the default where the fields say nothing admissible.
    #[must_use]
    pub fn averaging(&self) -> Averaging {
        Averaging::new(self.averaging_log2, self.period_log2)
            .unwrap_or(Averaging::DEFAULT)
            .with(self.third_tilt())
    }
}

/// A run of the emulated device, kept for tuning.
#[derive(Clone, Debug)]
pub struct RecordedRun {
    /// Name in reports.
    pub name: String,
    /// What it was made of.
    pub configuration: Configuration,
    /// Its conversions, the warm-up included.
    pub conversions: Vec<Conversion>,
    /// The true attitude of each solution.
    pub truths: Vec<Truth>,
}

/// What the golden engine is fed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Feed {
    /// The converter's codes.
    Codes,
    /// The voltages at the hold instants.
    IdealVolts,
    /// The readings of memoryless ideal sensors of the true specific force and field.
    Experienced,
    /// The readings of memoryless ideal sensors at rest in the true attitude.
    Direct,
}

/// Looks at what a run shows of the stages before the firmware, event by event.
pub trait Checker {
    /// The next conversion, the warm-up included.
    fn conversion(&mut self, conversion: &Conversion);
    /// The output instant of the next solution in seconds after reset, and the cycle at which its inputs were
    /// complete.
    fn instant(&mut self, time_s: f64, complete: u64);
    /// The next message of the device: its bytes, the last of which ended at `cycle`.
    fn message(&mut self, bytes: &[u8], cycle: u64);
    /// What was found, with what the emulated engine counted.
    fn finish(&self, summary: &Summary) -> Vec<Check>;
}

/// How closely a node must agree, and why that is the measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Node.
    pub node: &'static str,
    /// Largest absolute difference in the node's unit.
    pub max_abs: f64,
    /// Reason.
    pub reason: &'static str,
}

/// An application.
pub trait App: Sync {
    /// Name, as in `--app`.
    fn name(&self) -> &'static str;
    /// Nodes with their deployed formats.
    fn nodes(&self) -> &'static [NodeInfo];
    /// Hash of the deployed formats.
    fn formats_hash(&self) -> u64;
    /// Index of each golden node among [`App::nodes`].
    fn golden_nodes(&self) -> Vec<usize>;
    /// How many values each node takes in a solution with these settings; 0 for nodes that take none.
    ///
    /// # Errors
    /// An algorithm that cannot be recorded.
    fn values_per_solution(&self, configuration: &Configuration) -> Result<Vec<usize>, String>;
    /// By how much golden's nodes may differ beside rounding.
    fn tolerances(&self) -> Vec<Tolerance>;
    /// Seconds from one solution to the next.
    fn solution_seconds(&self, configuration: &Configuration) -> f64;
    /// The bundled image, with taps or without.
    fn bundled(&self, tapped: bool) -> Option<&'static [u8]>;
    /// The emulated device in its scenario.
    ///
    /// # Errors
    /// A scenario or image that cannot run.
    fn emulated(
        &self,
        scenario: &Scenario,
        seed: u64,
        seconds: f64,
        firmware: &Firmware,
    ) -> Result<(Configuration, Box<dyn Device>), String>;
    /// The firmware on the host: deployed, or in other formats on the tunable arithmetic.
    ///
    /// # Errors
    /// Formats that cannot be computed in.
    fn native(
        &self,
        configuration: &Configuration,
        formats: Option<&[Format]>,
    ) -> Result<Box<dyn Engine>, String>;
    /// The same algorithm where only nodes below `quantised` are rounded: 0 is the real
    /// interpretation, all nodes the deployed one.
    ///
    /// # Errors
    /// Formats that cannot be computed in.
    fn real(
        &self,
        configuration: &Configuration,
        quantised: usize,
        formats: Option<&[Format]>,
    ) -> Result<Box<dyn Engine>, String>;
    /// The group's values on the same codes where more and more nodes are rounded: a step behind the last
    /// stage for each node.
    ///
    /// # Errors
    /// Formats that cannot be computed in.
    fn rounding_steps(
        &self,
        configuration: &Configuration,
        formats: Option<&[Format]>,
    ) -> Result<Box<dyn Engine>, String>;
    /// The golden model.
    fn golden(&self, configuration: &Configuration, feed: Feed) -> Box<dyn Engine>;
    /// Calibrates a unit by what it sends in known attitudes.
    ///
    /// # Errors
    /// A scenario or image that cannot run, attitudes that do not determine the calibration, a
    /// crash.
    fn calibrate(&self, request: &Request<'_>) -> Result<Calibrated, CalibrateError>;
    /// The algorithm as a problem for tuning: on some runs, to be verified on others.
    ///
    /// # Errors
    /// Runs without a whole solution.
    fn problem(&self, tuning: &[RecordedRun], held_out: &[RecordedRun]) -> Result<Problem, String>;
    /// Which nodes' values enter which, in the algorithm with these settings.
    ///
    /// # Errors
    /// An algorithm that cannot be recorded.
    fn flow(&self, configuration: &Configuration) -> Result<Flow, String>;
    /// The device's settings in the content of an EEPROM, checked, as they go over the serial line.
    ///
    /// # Errors
    /// Content that the device would not accept.
    fn settings_image(&self, content: &EepromImage) -> Result<Vec<u8>, String>;
    /// The real interpretation with what rounding in `formats` is expected to make of it.
    ///
    /// # Errors
    /// Formats that cannot be computed in.
    fn expectation(
        &self,
        configuration: &Configuration,
        formats: Option<&[Format]>,
    ) -> Result<Box<dyn Engine>, String>;
    /// Each stage before the firmware by what that stage alone must do.
    ///
    /// # Errors
    /// A scenario that cannot run.
    fn checker(
        &self,
        scenario: &Scenario,
        configuration: &Configuration,
    ) -> Result<Box<dyn Checker>, String>;
    /// The stages that a participant computes with the golden model on inputs better than the device's own.
    fn models(&self, configuration: &Configuration, party: Party) -> Models;
    /// From the truth to the device: neighbouring stages are the parts of the error budget.
    fn stages(&self) -> &'static [Stage];
    /// What a message carries.
    fn outputs(&self, configuration: &Configuration) -> Outputs;
    /// A message as the golden side reads it.
    ///
    /// # Errors
    /// Bytes that are no message, and why.
    fn decode(&self, bytes: &[u8]) -> Result<Message, String>;
}

/// All applications.
pub const APPS: [&dyn App; 1] = [&Attitude];

/// The application of that name.
///
/// # Errors
/// An unknown name; the message lists the known ones.
pub fn by_name(name: &str) -> Result<&'static dyn App, String> {
    APPS.into_iter()
        .find(|app| app.name() == name)
        .ok_or_else(|| {
            let names: Vec<&str> = APPS.iter().map(|app| app.name()).collect();
            format!(
                "--app {name}: no such application; expected one of: {}",
                names.join(", ")
            )
        })
}
