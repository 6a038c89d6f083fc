//! Runs of the emulated device, kept in memory for ranges and tuning.

use cardan_bench::app::RecordedRun;
use cardan_bench::{Conversion, EngineError, Sink, SinkError, Truth};
use cardan_scenario::Scenario;
use cardan_tune::Problem;

use crate::failure::Failure;
use crate::run_options::Setup;

/// Keeps conversions and truths.
#[derive(Default)]
struct Kept {
    conversions: Vec<Conversion>,
    truths: Vec<Truth>,
}

impl Sink for Kept {
    fn conversion(&mut self, conversion: &Conversion) -> Result<(), SinkError> {
        self.conversions.push(*conversion);
        Ok(())
    }

    fn truth(&mut self, truth: &Truth) -> Result<(), SinkError> {
        self.truths.push(*truth);
        Ok(())
    }
}

/// Runs the emulated device once.
fn run(setup: &Setup, scenario: &Scenario, seed: u64) -> Result<RecordedRun, Failure> {
    let (configuration, mut engine) = setup
        .app
        .emulated(scenario, seed, setup.seconds, &setup.firmware)
        .map_err(Failure::input)?;
    let mut kept = Kept::default();
    let summary = engine
        .run(&mut std::iter::empty(), &mut kept)
        .map_err(|error| match error {
            EngineError::Input(message) => Failure::input(message),
            EngineError::Link(error) => Failure::participant(error),
        })?;
    if let Some(crash) = summary.crash {
        return Err(Failure::input(format!(
            "{}: the emulated program crashed: {crash}; give a working image",
            setup.firmware.name
        )));
    }
    Ok(RecordedRun {
        name: format!("{}, seed {seed}", scenario.name),
        configuration,
        conversions: kept.conversions,
        truths: kept.truths,
    })
}

/// The application's problem: on the run's scenario and seed, to be verified with the next seed and
/// on the scenarios `held_out`.
pub(crate) fn problem(setup: &Setup, held_out: &[String]) -> Result<Problem, Failure> {
    let tuning = vec![run(setup, &setup.scenario, setup.seed)?];
    let mut others = Vec::new();
    if !held_out.is_empty() {
        others.push(run(setup, &setup.scenario, setup.seed.wrapping_add(1))?);
    }
    for name in held_out {
        let scenario = Scenario::load(name).map_err(Failure::input)?;
        if scenario.name != setup.scenario.name {
            others.push(run(setup, &scenario, setup.seed)?);
        }
    }
    setup.app.problem(&tuning, &others).map_err(Failure::input)
}
