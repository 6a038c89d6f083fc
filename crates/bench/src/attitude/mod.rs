//! The attitude sensor: two tilt and two field channels, both Cardan solutions.

mod board;
mod calibrate;
mod checks;
mod datapath;
mod eeprom;
mod emulated;
mod expectation;
mod frames;
mod golden;
mod line;
mod mixed;
mod native;
mod rounding;
mod schedule;
mod tolerances;
mod tuning;

pub use datapath::AttitudeDatapath;
pub use eeprom::nominal_eeprom;

use std::collections::BTreeMap;
use std::sync::Arc;

use cardan_datapath::{Format, NodeInfo};
use cardan_firmware::FORMATS_HASH;
use cardan_firmware::calibration::Settings;
use cardan_firmware::nodes::NODES;
use cardan_numerics::Formats;
use cardan_numerics::tape::Flow;
use cardan_outputs::{Is, Message, Outputs, Stage};
use cardan_scenario::{Scenario, Trajectory};
use cardan_spec::calibration::{Calibration, FRAC, WORDS};
use cardan_spec::nodes::SHARED;
use cardan_spec::timing::{Averaging, CPU_HZ};
use cardan_tune::Problem;

use crate::app::{App, Checker, Configuration, Feed, Models, Party, RecordedRun, Tolerance};
use crate::calibration::{CalibrateError, Calibrated, Request};
use crate::engine::{Conversion, Device, Engine, ThirdTilt};
use crate::image::{EepromImage, Firmware};

/// The reference application.
#[derive(Clone, Copy, Debug)]
pub struct Attitude;

/// From the true attitude to the device's.
pub(crate) static STAGES: [Stage; 8] = [
    Stage::new(Is::Truth, "truth", "", "Truth", ""),
    Stage::new(
        Is::Model,
        "golden on ideal readings",
        "latency",
        "Latency and skew",
        "sampling instants and delay",
    ),
    Stage::new(
        Is::Model,
        "golden on the true experience",
        "motion",
        "Motion and environment",
        "acceleration, disturbed field: the method's own error",
    ),
    Stage::new(
        Is::Model,
        "golden on ideal voltages",
        "sensor_frontend",
        "Sensor and front end",
        "physics, noise, filters",
    ),
    Stage::new(
        Is::Golden,
        "golden on codes",
        "adc",
        "ADC quantisation",
        "ten bits",
    ),
    Stage::new(
        Is::Real,
        "real",
        "algorithm",
        "Algorithm",
        "series and iterations, in f64",
    ),
    Stage::new(Is::Native, "native", "rounding", "Rounding", "word lengths"),
    Stage::new(
        Is::Emulated,
        "emulated",
        "compiled",
        "Compiled code",
        "must be zero",
    ),
];

/// Images of the reference board, built from `firmware/boards/atmega328p`.
const TAPPED: &[u8] = include_bytes!("../../../../firmware/boards/atmega328p/images/tapped.elf");
const PLAIN: &[u8] = include_bytes!("../../../../firmware/boards/atmega328p/images/plain.elf");

impl Attitude {
    /// Attitude in half turns (yaw, pitch, roll) and status bits of a frame, if it is whole.
    #[must_use]
    pub fn decode_frame(&self, bytes: &[u8]) -> Option<([f64; 3], u16)> {
        let frame = frames::decode_frame(bytes).ok()?;
        Some((frame.angles, frame.status))
    }
}

/// Calibration values rounded to the words of the EEPROM image.
#[must_use]
pub fn calibration_words(calibration: &Calibration) -> [i32; WORDS] {
    let scale = f64::from(1_u32 << FRAC);
    calibration
        .to_values()
        .map(|value| (value * scale).round_ties_even() as i32)
}

/// The calibration that the words hold.
#[must_use]
pub fn calibration_of(words: &[i32; WORDS]) -> Calibration {
    let scale = f64::from(1_u32 << FRAC);
    Calibration::from_values(&words.map(|word| f64::from(word) / scale))
}

fn words_of(configuration: &Configuration) -> [i32; WORDS] {
    let mut words = [0; WORDS];
    for (word, given) in words.iter_mut().zip(&configuration.calibration) {
        *word = *given;
    }
    words
}

fn settings_of(configuration: &Configuration) -> Settings {
    Settings {
        words: words_of(configuration),
        averaging: configuration.averaging(),
        third_tilt: configuration.third_tilt(),
        uncalibrated: false,
    }
}

/// A run of `seconds` with these settings.
fn configuration_of(settings: &Settings, seconds: f64) -> Result<Configuration, String> {
    Ok(Configuration {
        calibration: settings.words.to_vec(),
        solutions: solutions_in(seconds, settings.averaging)?,
        averaging_log2: settings.averaging.log2(),
        period_log2: settings.averaging.period_log2(),
        third_tilt: settings.third_tilt as u8,
        shares: false,
        request: BTreeMap::new(),
    })
}

/// Whole solutions in `seconds`, the warm-up taken off.
fn solutions_in(seconds: f64, averaging: Averaging) -> Result<u64, String> {
    let cycles = seconds * CPU_HZ as f64;
    let warm_up = averaging.warm_up_cycles();
    let solutions = ((cycles - warm_up as f64) / averaging.cycles() as f64).floor();
    if solutions < 1.0 {
        let period = averaging.cycles() as f64 / CPU_HZ as f64;
        let settling = warm_up as f64 / CPU_HZ as f64;
        return Err(format!(
            "{seconds} seconds hold no solution: the device settles for {settling} s first, and a \
             solution takes {period} s; give at least {} s",
            settling + period
        ));
    }
    Ok(solutions as u64)
}

impl App for Attitude {
    fn name(&self) -> &'static str {
        "attitude"
    }

    fn nodes(&self) -> &'static [NodeInfo] {
        &NODES
    }

    fn formats_hash(&self) -> u64 {
        FORMATS_HASH
    }

    fn golden_nodes(&self) -> Vec<usize> {
        let index = |name| {
            NODES
                .iter()
                .position(|node| node.name == name)
                .unwrap_or(usize::MAX)
        };
        SHARED.iter().map(|shared| index(shared.name)).collect()
    }

    fn values_per_solution(&self, configuration: &Configuration) -> Result<Vec<usize>, String> {
        let flow = datapath::flow(configuration)?;
        let averaging = configuration.averaging();
        let count = |(index, node): (usize, &NodeInfo)| {
            let written = flow.position(index).map_or(0, |at| flow.writes[at].len());
            let shared = SHARED.iter().find(|shared| shared.name == node.name);
            match shared {
                Some(shared) if written > 0 => shared.per_solution(averaging),
                _ => written,
            }
        };
        Ok(NODES.iter().enumerate().map(count).collect())
    }

    fn tolerances(&self) -> Vec<Tolerance> {
        tolerances::all()
    }

    fn solution_seconds(&self, configuration: &Configuration) -> f64 {
        configuration.averaging().cycles() as f64 / CPU_HZ as f64
    }

    fn bundled(&self, tapped: bool) -> Option<&'static [u8]> {
        Some(if tapped { TAPPED } else { PLAIN })
    }

    fn emulated(
        &self,
        scenario: &Scenario,
        seed: u64,
        seconds: f64,
        firmware: &Firmware,
    ) -> Result<(Configuration, Box<dyn Device>), String> {
        let trajectory = Trajectory::new(scenario, seed).map_err(|error| error.to_string())?;
        let seconds = trajectory
            .duration_s()
            .map_or(seconds, |end| seconds.min(end));
        let settings = eeprom::settings_for(scenario, &trajectory, firmware)?;
        let configuration = configuration_of(&settings, seconds)?;
        let engine = emulated::EmulatedDevice::new(
            scenario,
            seed,
            Arc::new(trajectory),
            &configuration,
            firmware,
        )?;
        Ok((configuration, Box::new(engine)))
    }

    fn native(
        &self,
        configuration: &Configuration,
        formats: Option<&[Format]>,
    ) -> Result<Box<dyn Engine>, String> {
        let settings = settings_of(configuration);
        let Some(formats) = formats else {
            return Ok(Box::new(native::NativeEngine::new(&settings)));
        };
        let formats = formats_of(Some(formats))?;
        Ok(Box::new(mixed::MixedEngine::words(&formats, &settings)?))
    }

    fn real(
        &self,
        configuration: &Configuration,
        quantised: usize,
        formats: Option<&[Format]>,
    ) -> Result<Box<dyn Engine>, String> {
        let formats = formats_of(formats)?.prefix(quantised);
        Ok(Box::new(mixed::MixedEngine::values(
            &formats,
            &settings_of(configuration),
        )))
    }

    fn rounding_steps(
        &self,
        configuration: &Configuration,
        formats: Option<&[Format]>,
    ) -> Result<Box<dyn Engine>, String> {
        let (formats, settings) = (formats_of(formats)?, settings_of(configuration));
        Ok(Box::new(rounding::Steps::new(&formats, &settings)))
    }

    fn golden(&self, configuration: &Configuration, feed: Feed) -> Box<dyn Engine> {
        Box::new(golden::GoldenEngine::new(configuration, feed))
    }

    fn calibrate(&self, request: &Request<'_>) -> Result<Calibrated, CalibrateError> {
        calibrate::calibrate(request)
    }

    fn flow(&self, configuration: &Configuration) -> Result<Flow, String> {
        datapath::flow(configuration)
    }

    fn settings_image(&self, content: &EepromImage) -> Result<Vec<u8>, String> {
        Ok(eeprom::settings(content)?.image().to_vec())
    }

    fn expectation(
        &self,
        configuration: &Configuration,
        formats: Option<&[Format]>,
    ) -> Result<Box<dyn Engine>, String> {
        let deployed = || NODES.iter().map(|node| node.format).collect();
        let formats = formats.map_or_else(deployed, <[Format]>::to_vec);
        Ok(Box::new(expectation::ExpectationEngine::new(
            formats,
            configuration,
        )?))
    }

    fn checker(
        &self,
        scenario: &Scenario,
        configuration: &Configuration,
    ) -> Result<Box<dyn Checker>, String> {
        Ok(Box::new(checks::Checks::new(scenario, configuration)?))
    }

    fn models(&self, configuration: &Configuration, party: Party) -> Models {
        let feeds: &[(usize, Feed)] = match party {
            Party::Emulated => &[(1, Feed::Direct), (2, Feed::Experienced)],
            Party::Golden => &[(3, Feed::IdealVolts)],
        };
        let model = |&(stage, feed): &(usize, Feed)| (stage, self.golden(configuration, feed));
        feeds.iter().map(model).collect()
    }

    fn stages(&self) -> &'static [Stage] {
        &STAGES
    }

    fn outputs(&self, configuration: &Configuration) -> Outputs {
        frames::outputs(configuration.averaging())
    }

    fn decode(&self, bytes: &[u8]) -> Result<Message, String> {
        frames::decode(bytes)
    }

    fn problem(&self, tuning: &[RecordedRun], held_out: &[RecordedRun]) -> Result<Problem, String> {
        tuning::problem(tuning, held_out)
    }
}

/// The sign of gravity along body z that the comparator tells with the conversion that completes a solution.
fn sign(conversion: &Conversion) -> i8 {
    let sign = |third: ThirdTilt| if third.upside_down { -1 } else { 1 };
    conversion.third_tilt.map_or(0, sign)
}

/// What a step of the datapath takes of one solution's conversions: their codes, and the third axis.
fn step_inputs(solution: &[Conversion]) -> Vec<i32> {
    let third = solution.last().map_or(0, sign);
    let codes = solution.iter().map(|c| i32::from(c.code));
    codes.chain([i32::from(third)]).collect()
}

fn formats_of(formats: Option<&[Format]>) -> Result<Formats, String> {
    match formats {
        None => Formats::deployed(&NODES),
        Some(formats) => Formats::new(&NODES, formats.iter().copied().map(Some).collect()),
    }
    .map_err(|error| error.to_string())
}
