//! Runs of the emulated device, kept in memory for ranges and tuning.

use std::ops::Range;
use std::thread;

use cardan_bench::app::RecordedRun;
use cardan_bench::{Conversion, EngineError, Sink, SinkError, Truth};
use cardan_scenario::Scenario;
use cardan_tune::{Case, Problem};

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
        self.truths.push(truth.clone());
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
    let summary = engine.run(&mut kept).map_err(|error| match error {
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

/// A run to record: scenario, seed, seconds.
struct Wanted(Scenario, u64, f64);

/// The application's problem: on the run's scenario with `seeds` seeds from its own up and on the
/// scenarios `also`, to be verified with the next seed and on the scenarios `held_out`. Scenarios by
/// name run to their own ends at least: what makes them special may come late.
pub(crate) fn problem(
    setup: &Setup,
    seeds: u64,
    also: &[String],
    held_out: &[String],
) -> Result<Problem, Failure> {
    let own = |offset: u64| {
        let seed = setup.seed.wrapping_add(offset);
        Wanted(setup.scenario.clone(), seed, setup.seconds)
    };
    let named = |names: &[String], into: &mut Vec<Wanted>| {
        for name in names {
            let scenario = Scenario::load(name).map_err(Failure::input)?;
            if scenario.name != setup.scenario.name {
                let seconds = scenario.seconds.max(setup.seconds);
                into.push(Wanted(scenario, setup.seed, seconds));
            }
        }
        Ok::<_, Failure>(())
    };
    let mut wanted: Vec<Wanted> = (0..seeds).map(own).collect();
    named(also, &mut wanted)?;
    let tuning = wanted.len();
    if !held_out.is_empty() {
        wanted.push(own(seeds));
    }
    named(held_out, &mut wanted)?;
    let runs = recorded(setup, &wanted)?;
    setup
        .app
        .problem(&runs[..tuning], &runs[tuning..])
        .map_err(Failure::input)
}

/// Runs of the scenario with the seeds that many after its own.
pub(crate) fn cases(setup: &Setup, seeds: Range<u64>) -> Result<Vec<Case>, Failure> {
    let own = |offset: u64| {
        let seed = setup.seed.wrapping_add(offset);
        Wanted(setup.scenario.clone(), seed, setup.seconds)
    };
    let wanted: Vec<Wanted> = seeds.map(own).collect();
    let runs = recorded(setup, &wanted)?;
    let problem = setup.app.problem(&runs, &[]).map_err(Failure::input)?;
    Ok(problem.tuning)
}

/// Records all runs, as many at a time as there are cores.
fn recorded(setup: &Setup, wanted: &[Wanted]) -> Result<Vec<RecordedRun>, Failure> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let mut runs = Vec::new();
    for some in wanted.chunks(cores) {
        let recorded: Vec<_> = thread::scope(|scope| {
            let start = |Wanted(scenario, seed, seconds): &Wanted| {
                let (scenario, seed, seconds) = (scenario.clone(), *seed, *seconds);
                scope.spawn(move || run(setup, &scenario, seed, seconds))
            };
            let handles: Vec<_> = some.iter().map(start).collect();
            let joined = handles.into_iter().map(|handle| match handle.join() {
                Ok(run) => run,
                Err(panic) => std::panic::resume_unwind(panic),
            });
            joined.collect()
        });
        for run in recorded {
            runs.push(run?);
        }
    }
    Ok(runs)
}
