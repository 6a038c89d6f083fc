//! The scenario file: all its tables, where it comes from and what is checked.

use std::path::{Path, PathBuf};

use cardan_spec::ThirdTilt;
use serde::Deserialize;

use crate::check::range;
use crate::error::Error;
use crate::field::{self, EarthField};
use crate::grid::Grid;
use crate::hardware::{Accelerometer, Adc, Clock, Controller, Frontend, Magnetometer};
use crate::mounting::Mounting;
use crate::overlay::{Climate, Disturbance, Vibration};
use crate::parameter::{Origin, Parameter, Parameters};
use crate::source::{self, MOST_TEXT};
use crate::sweep::{Step, Sweep};
use crate::syntax;
use crate::third_tilt;
use crate::tolerance::Tolerance;
use crate::tumble::Tumble;

/// Bundled scenarios: name and text.
pub const BUNDLED: [(&str, &str); 13] = [
    ("tumble", include_str!("../scenarios/tumble.toml")),
    (
        "tumble-quiet",
        include_str!("../scenarios/tumble-quiet.toml"),
    ),
    ("somersault", include_str!("../scenarios/somersault.toml")),
    ("measured", include_str!("../scenarios/measured.toml")),
    ("static", include_str!("../scenarios/static.toml")),
    ("sweep", include_str!("../scenarios/sweep.toml")),
    ("step", include_str!("../scenarios/step.toml")),
    ("vibration", include_str!("../scenarios/vibration.toml")),
    ("heat", include_str!("../scenarios/heat.toml")),
    ("magnet", include_str!("../scenarios/magnet.toml")),
    ("published", include_str!("../scenarios/published.toml")),
    ("misaligned", include_str!("../scenarios/misaligned.toml")),
    ("rails", include_str!("../scenarios/rails.toml")),
];

/// The scenario that runs when none is named.
pub const DEFAULT: &str = "tumble";

/// Longest admissible run in simulated seconds.
pub const MOST_SECONDS: f64 = 1e6;

/// Everything that describes a run besides the seed and the firmware.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scenario {
    /// Name in reports; that of the file if the file does not say.
    pub name: String,
    /// One sentence for people.
    pub about: String,
    /// Simulated seconds after reset; a recording may end the run earlier.
    pub seconds: f64,
    /// What moves the device.
    pub motion: Motion,
    /// Vibration on top of the motion.
    pub vibration: Vibration,
    /// Ambient temperature.
    pub climate: Climate,
    /// Magnetic disturbance on top of the Earth's field.
    pub disturbance: Disturbance,
    /// The controller's clock.
    pub clock: Clock,
    /// The Earth's field.
    pub field: Field,
    /// The sensors.
    pub sensors: Sensors,
    /// The analog chain.
    pub frontend: Frontend,
    /// The converter.
    pub adc: Adc,
    /// The controller's settings.
    pub controller: Controller,
    /// Switches of the noise.
    pub noise: Noise,
    /// Recordings: the mounting of their sensors.
    pub mounting: Mounting,
    /// What the device's EEPROM says, where it is not the nominal device in the scenario's field.
    pub calibration: CalibrationOverride,
    /// Limits of the verdict.
    pub tolerance: Tolerance,
}

/// What moves the device.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Motion {
    /// Which of the motions runs.
    pub kind: MotionKind,
    /// The synthetic tumble.
    pub tumble: Tumble,
    /// The static grid.
    #[serde(rename = "static")]
    pub grid: Grid,
    /// The sweep of angles.
    pub sweep: Sweep,
    /// The step.
    pub step: Step,
    /// The recording.
    pub recording: RecordingChoice,
}

/// The motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionKind {
    /// Seeded synthetic tumble.
    #[default]
    Tumble,
    /// Rests at a grid of attitudes.
    Static,
    /// Sine sweep of the angles.
    Sweep,
    /// Step from one attitude to another.
    Step,
    /// Recorded specific force and field.
    Recording,
}

impl MotionKind {
    /// As in the scenario file.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            MotionKind::Tumble => "tumble",
            MotionKind::Static => "static",
            MotionKind::Sweep => "sweep",
            MotionKind::Step => "step",
            MotionKind::Recording => "recording",
        }
    }
}

/// Which recording runs and how it is read.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordingChoice {
    /// CSV file, plain or compressed with gzip.
    pub file: Option<PathBuf>,
    /// Local gravity in m/s^2; without it, the recording's own at rest.
    pub gravity_m_s2: Option<f64>,
    /// A longer time without a sample is a gap, in seconds; without it, five typical intervals.
    pub longest_gap_s: Option<f64>,
    /// A magnetometer that is slower than the accelerometer, with empty cells between its samples, is
    /// interpolated.
    pub interpolate_mag: bool,
    /// The acceleration columns hold gravity (down at rest) and not specific force; without it the
    /// recording is asked.
    pub acc_is_gravity: Option<bool>,
}

/// The Earth's field; for a recording only what is explicit counts.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Field {
    /// A site of the table, used where components are not explicit.
    pub site: String,
    /// Explicit horizontal component in microtesla.
    pub horizontal_ut: Option<f64>,
    /// Explicit downward component in microtesla.
    pub vertical_ut: Option<f64>,
}

impl Default for Field {
    fn default() -> Self {
        Self {
            site: "montpellier-2026".into(),
            horizontal_ut: None,
            vertical_ut: None,
        }
    }
}

impl Field {
    /// The explicit field, if both components are.
    #[must_use]
    pub fn explicit(&self) -> Option<EarthField> {
        let (horizontal_ut, vertical_ut) = (self.horizontal_ut?, self.vertical_ut?);
        Some(EarthField {
            horizontal_ut,
            vertical_ut,
        })
    }

    /// The field of a synthetic motion: explicit, else the site's.
    #[must_use]
    pub fn resolve(&self) -> Option<EarthField> {
        self.explicit().or_else(|| field::site(&self.site))
    }
}

/// The sensors.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sensors {
    /// A third accelerometer, along body z, and what reads it. It tells upright from upside down, which
    /// two tilt axes cannot.
    #[serde(deserialize_with = "third_tilt::read")]
    pub third_tilt: ThirdTilt,
    /// Convective accelerometers.
    pub accelerometer: Accelerometer,
    /// Lorentz magnetometers.
    pub magnetometer: Magnetometer,
}

/// Switches of the noise.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Noise {
    /// All noise on or off: sensors, amplifiers, switches, converter.
    pub enabled: bool,
}

impl Default for Noise {
    fn default() -> Self {
        Self { enabled: true }
    }
}

/// Explicit calibration; each key present replaces the nominal value.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CalibrationOverride {
    /// Averages at zero g, fractions of full scale.
    pub tilt_offset: Option<[f64; 2]>,
    /// Gravity along body x, y in g per full scale.
    pub tilt_matrix: Option<[[f64; 2]; 2]>,
    /// Averages at zero field, fractions of full scale.
    pub field_offset: Option<[f64; 2]>,
    /// Field along body x, y over |B| per full scale.
    pub field_matrix: Option<[[f64; 2]; 2]>,
    /// Horizontal field in microtesla, as the device believes it.
    pub horizontal_ut: Option<f64>,
    /// Downward field in microtesla, as the device believes it.
    pub vertical_ut: Option<f64>,
    /// Average of a measured third tilt axis at zero g, fractions of full scale.
    pub tilt_z_offset: Option<f64>,
    /// Gravity along body z in g per full scale of a measured third tilt axis.
    pub tilt_z_gain: Option<f64>,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            name: String::new(),
            about: String::new(),
            seconds: 12.0,
            motion: Motion::default(),
            vibration: Vibration::default(),
            climate: Climate::default(),
            disturbance: Disturbance::default(),
            clock: Clock::default(),
            field: Field::default(),
            sensors: Sensors::default(),
            frontend: Frontend::default(),
            adc: Adc::default(),
            controller: Controller::default(),
            noise: Noise::default(),
            mounting: Mounting::default(),
            calibration: CalibrationOverride::default(),
            tolerance: Tolerance::default(),
        }
    }
}

impl Scenario {
    /// The bundled scenario `name`, else the scenario file of that path.
    ///
    /// # Errors
    /// Unknown name, unreadable file, syntax, unknown key, inadmissible value.
    pub fn load(name: &str) -> Result<Self, Error> {
        if let Some((_, text)) = BUNDLED.iter().find(|(known, _)| *known == name) {
            return Self::parse(text, &format!("bundled scenario {name}"), name);
        }
        let path = Path::new(name);
        if !path.exists() {
            return Err(unknown(name));
        }
        let text = source::read_text(path, MOST_TEXT).map_err(|reason| Error::Unreadable {
            path: path.into(),
            reason,
        })?;
        let stem = path
            .file_stem()
            .map_or(name.into(), |stem| stem.to_string_lossy());
        Self::parse(&text, &path.display().to_string(), &stem)
    }

    /// The default scenario with its motion replaced by a recording; the run is as long as that.
    #[must_use]
    pub fn with_recording(mut self, file: &Path) -> Self {
        self.about = format!(
            "Recording {} on the hardware of '{}'.",
            file.display(),
            self.name
        );
        self.motion.kind = MotionKind::Recording;
        self.motion.recording.file = Some(file.into());
        self.seconds = MOST_SECONDS;
        self
    }

    /// By which factor the scenario's limits are wider in a run of `seconds`: statistics of a shorter run
    /// scatter more, by the root of how much shorter it is. A recording has the length that it has, and no
    /// limit was stated for another.
    #[must_use]
    pub fn widening(&self, seconds: f64) -> f64 {
        (self.stated_seconds(seconds) / seconds).sqrt().max(1.0)
    }

    /// The limits of a run of `seconds`; those with the full keys `exact` were stated for this very run.
    #[must_use]
    pub fn limits_of(&self, seconds: f64, exact: &[&str]) -> Tolerance {
        let longest = seconds.max(self.stated_seconds(seconds));
        self.tolerance
            .widened(self.widening(seconds), longest, exact)
    }

    /// The length that the limits are stated for.
    fn stated_seconds(&self, seconds: f64) -> f64 {
        match self.motion.kind {
            MotionKind::Recording => seconds,
            _ => self.seconds,
        }
    }

    /// Whether this is one of the bundled scenarios, whose limits belong to it as it stands.
    #[must_use]
    pub fn is_bundled(&self) -> bool {
        BUNDLED.iter().any(|(name, _)| *name == self.name)
    }

    /// Whether the limits of a bundled scenario hold with that key set to any value: it is a limit itself.
    /// (Averaging less, or converting without the noise that spreads the steps, makes errors larger.)
    #[must_use]
    pub fn keeps_limits(key: &str) -> bool {
        key.starts_with("tolerance.")
    }

    /// Reads and checks a scenario; `file` is for messages, `name` unless the text says another.
    ///
    /// # Errors
    /// Syntax, unknown key, inadmissible value: with line, column and how to mend it.
    pub fn parse(text: &str, file: &str, name: &str) -> Result<Self, Error> {
        let mut scenario: Scenario =
            toml::from_str(text).map_err(|error| syntax::explain(&error, text, file))?;
        if scenario.name.is_empty() {
            scenario.name = name.into();
        }
        scenario
            .check()
            .map_err(|error| syntax::place(error, text, file))?;
        Ok(scenario)
    }

    /// All numeric parameters with their present values, in file order.
    #[must_use]
    pub fn parameters(&self) -> Vec<Parameter> {
        let tables: [&dyn Parameters; 13] = [
            &self.motion.tumble,
            &self.motion.grid,
            &self.motion.sweep,
            &self.motion.step,
            &self.vibration,
            &self.climate,
            &self.disturbance,
            &self.clock,
            &self.sensors.accelerometer,
            &self.sensors.magnetometer,
            &self.frontend,
            &self.adc,
            &self.controller,
        ];
        tables.iter().flat_map(|table| table.list()).collect()
    }

    /// Switches, which [`Scenario::set`] takes as 0 or 1.
    fn switch_mut(&mut self, key: &str) -> Option<&mut bool> {
        match key {
            "noise.enabled" => Some(&mut self.noise.enabled),
            "motion.recording.interpolate_mag" => Some(&mut self.motion.recording.interpolate_mag),
            "motion.recording.acc_is_gravity" => {
                Some(self.motion.recording.acc_is_gravity.get_or_insert_default())
            }
            _ => None,
        }
    }

    /// The numeric parameter of that full key, such as `sensors.magnetometer.quality`.
    ///
    /// # Errors
    /// There is no such parameter.
    pub fn get(&self, key: &str) -> Result<Parameter, Error> {
        let all = self.parameters();
        let named = |p: &Parameter| format!("{}.{}", p.section, p.key);
        all.iter()
            .find(|p| named(p) == key)
            .cloned()
            .ok_or_else(|| {
                let keys: Vec<String> = all.iter().map(named).collect();
                unknown_key(key, &keys)
            })
    }

    /// Every key that [`Scenario::set`] takes; limits of single nodes (`tolerance.nodes.NODE`) beside them.
    #[must_use]
    pub fn settable(&self) -> Vec<String> {
        let mut copy = self.clone();
        let parameters = self.parameters();
        let named = parameters
            .iter()
            .map(|p| format!("{}.{}", p.section, p.key));
        let options = copy
            .options_mut()
            .into_iter()
            .map(|(key, _)| key.to_owned());
        let limits = self.tolerance.checked().into_iter();
        let fixed = [third_tilt::KEY, "noise.enabled", "seconds"];
        named
            .chain(options)
            .chain(limits.map(|(key, ..)| key.to_owned()))
            .chain(fixed.map(str::to_owned))
            .collect()
    }

    /// Numbers that are absent unless they are given.
    fn options_mut(&mut self) -> [(&'static str, &mut Option<f64>); 7] {
        let calibration = &mut self.calibration;
        [
            ("field.horizontal_ut", &mut self.field.horizontal_ut),
            ("field.vertical_ut", &mut self.field.vertical_ut),
            (
                "motion.recording.gravity_m_s2",
                &mut self.motion.recording.gravity_m_s2,
            ),
            ("calibration.horizontal_ut", &mut calibration.horizontal_ut),
            ("calibration.vertical_ut", &mut calibration.vertical_ut),
            ("calibration.tilt_z_offset", &mut calibration.tilt_z_offset),
            ("calibration.tilt_z_gain", &mut calibration.tilt_z_gain),
        ]
    }

    /// Sets the numeric parameter of that full key ([`Scenario::check`] tells if it is admissible), a number
    /// that is absent by default, a limit, or a switch: 1 is on, 0 off; `sensors.third_tilt` takes 2 as well: measured.
    ///
    /// # Errors
    /// There is no such parameter, or a switch is to be neither on nor off.
    pub fn set(&mut self, key: &str, value: f64) -> Result<(), Error> {
        if key == third_tilt::KEY {
            self.sensors.third_tilt = third_tilt::numbered(value)?;
            return Ok(());
        }
        if let Some(switch) = self.switch_mut(key) {
            if value != 0.0 && value != 1.0 {
                return Err(range(key, value, "true (1) or false (0)"));
            }
            *switch = value == 1.0;
            return Ok(());
        }
        let choice = &mut self.motion.recording;
        let optional = match key {
            "motion.recording.gravity_m_s2" => Some(&mut choice.gravity_m_s2),
            "motion.recording.longest_gap_s" => Some(&mut choice.longest_gap_s),
            "field.horizontal_ut" => Some(&mut self.field.horizontal_ut),
            "field.vertical_ut" => Some(&mut self.field.vertical_ut),
            _ => None,
        };
        if let Some(optional) = optional {
            *optional = Some(value);
            return Ok(());
        }
        if self.tolerance.set(key, value) {
            return Ok(());
        }
        if key == "seconds" {
            self.seconds = value;
            return Ok(());
        }
        if let Some((_, option)) = self
            .options_mut()
            .into_iter()
            .find(|(name, _)| *name == key)
        {
            *option = Some(value);
            return Ok(());
        }
        let found = self.get(key);
        let Parameter { section, key, .. } =
            found.map_err(|_| unknown_key(key, &self.settable()))?;
        let table: &mut dyn Parameters = match section {
            "motion.tumble" => &mut self.motion.tumble,
            "motion.static" => &mut self.motion.grid,
            "motion.sweep" => &mut self.motion.sweep,
            "motion.step" => &mut self.motion.step,
            "vibration" => &mut self.vibration,
            "climate" => &mut self.climate,
            "disturbance" => &mut self.disturbance,
            "clock" => &mut self.clock,
            "sensors.accelerometer" => &mut self.sensors.accelerometer,
            "sensors.magnetometer" => &mut self.sensors.magnetometer,
            "frontend" => &mut self.frontend,
            "controller" => &mut self.controller,
            _ => &mut self.adc,
        };
        if let Some(present) = table.value_mut(key) {
            *present = value;
        }
        Ok(())
    }

    /// True frequency of the controller's clock in hertz, for the analog side. Motions are timed by the
    /// controller's own clock, as if it were exact: only the carrier's place among the resonances shows.
    #[must_use]
    pub fn clock_hz(&self) -> f64 {
        cardan_spec::timing::CPU_HZ as f64 * (1.0 + 1e-6 * self.clock.error_ppm)
    }

    /// Parameters of the hardware whose present value is not a published one.
    #[must_use]
    pub fn assumed_parameters(&self) -> Vec<Parameter> {
        let is_assumed = |p: &Parameter| match p.origin {
            Origin::Assumed(_) => true,
            Origin::Published(_) => p.value != p.default,
            Origin::Setting => false,
        };
        self.parameters().into_iter().filter(is_assumed).collect()
    }
}

/// A key that there is not, with the nearest one that there is.
fn unknown_key(key: &str, keys: &[String]) -> Error {
    let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
    let hint = syntax::nearest_key(key, &keys)
        .map_or(".".to_owned(), |near| format!("; did you mean '{near}'?"));
    Error::UnknownKey {
        place: "scenario".to_owned(),
        key: key.to_owned(),
        hint,
    }
}

fn unknown(name: &str) -> Error {
    let names = BUNDLED.map(|(name, _)| name);
    let hint = match syntax::nearest(name, &names) {
        Some(near) => format!("did you mean '{near}'?"),
        None => "name one of them or give the path of a scenario file".into(),
    };
    Error::UnknownScenario {
        name: name.into(),
        bundled: names.join(", "),
        hint,
    }
}
