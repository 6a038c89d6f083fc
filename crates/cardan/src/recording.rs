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
fn run(
    setup: &Setup,
    scenario: &Scenario,
    seed: u64,
    seconds: f64,
) -> Result<RecordedRun, Failure> {
    let (configuration, mut engine) = setup
        .app
        .emulated(scenario, seed, seconds, &setup.firmware)
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

/// The application's problem: on the run's scenario and seed and on the scenarios `also`, to be
/// verified with the next seed and on the scenarios `held_out`. Scenarios by name run to their own
/// ends at least: what makes them special may come late.
pub(crate) fn problem(
    setup: &Setup,
    also: &[String],
    held_out: &[String],
) -> Result<Problem, Failure> {
    let own = |seed: u64| run(setup, &setup.scenario, seed, setup.seconds);
    let named = |names: &[String], into: &mut Vec<RecordedRun>| {
        for name in names {
            let scenario = Scenario::load(name).map_err(Failure::input)?;
            if scenario.name != setup.scenario.name {
                let seconds = scenario.seconds.max(setup.seconds);
                into.push(run(setup, &scenario, setup.seed, seconds)?);
            }
        }
        Ok::<_, Failure>(())
    };
    let mut tuning = vec![own(setup.seed)?];
    named(also, &mut tuning)?;
    let mut others = Vec::new();
    if !held_out.is_empty() {
        others.push(own(setup.seed.wrapping_add(1))?);
    }
    named(held_out, &mut others)?;
    setup.app.problem(&tuning, &others).map_err(Failure::input)
}
