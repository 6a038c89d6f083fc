//! `compare --corners`: the comparison over named corners and random units, several at a time: yield,
//! worst corner, and the command that runs it again.

mod page;
mod report;

use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use cardan_link::supervise;
use cardan_scenario::Scenario;
use cardan_scenario::corners::{Corners, Variant};
use clap::Args;
use serde_json::Value;

use self::report::{Report, Run};
use crate::failure::{Done, Failure, code};
use crate::output::Output;
use crate::run_options::{RunOptions, Setup};
use crate::verdict;

/// Most random units of one run.
const MOST_UNITS: u64 = 100_000;

/// Which variants of the scenario are compared.
#[derive(Args, Clone, Debug)]
pub(crate) struct CornerOptions {
    /// Compare in every corner of this file (TOML: `[[corner]]` with name and set, `[spread]` with
    /// sigma or range per key) as well as in the scenario itself: yield and worst corner
    #[arg(long, value_name = "FILE",
        conflicts_with_all = ["session", "dump", "print_scenario", "junit", "baseline", "annotations"])]
    pub(crate) corners: Option<PathBuf>,
    /// Random units drawn from the file's `[spread]`, unit k with seed + k
    #[arg(long, value_name = "N", default_value_t = 0, requires = "corners",
        allow_negative_numbers = true,
        value_parser = clap::value_parser!(u64).range(0..=MOST_UNITS))]
    mc: u64,
    /// Comparisons at a time [default: one per processor]
    #[arg(long, value_name = "J", requires = "corners", allow_negative_numbers = true,
        value_parser = clap::value_parser!(u64).range(1..=256))]
    jobs: Option<u64>,
}

impl CornerOptions {
    /// Whether random units are asked for.
    pub(crate) const fn has_units(&self) -> bool {
        self.mc > 0
    }

    /// Whether the number of comparisons at a time is given.
    pub(crate) const fn has_jobs(&self) -> bool {
        self.jobs.is_some()
    }
}

/// One comparison to make.
struct Job {
    variant: Variant,
    /// Drawn at random, so that it counts in the yield.
    is_unit: bool,
    run: RunOptions,
}

/// Compares in all variants.
pub(crate) fn execute(
    options: &CornerOptions,
    file: &std::path::Path,
    run: &RunOptions,
    setup: &Setup,
    (folder, output): (Option<&std::path::Path>, Output),
) -> Done {
    let corners = Corners::load(file, &setup.scenario).map_err(Failure::input)?;
    let run = &with_limits(run)?;
    let jobs = jobs(options, &corners, run, setup)?;
    let threads = options.jobs.map_or_else(
        || thread::available_parallelism().map_or(1, usize::from),
        |jobs| jobs as usize,
    );
    let runs = compare_all(&jobs, threads.min(jobs.len()), output)?;
    let report = Report::new(setup, file, run.seed, runs);
    if output.is_json() {
        output.document(&report)?;
    }
    if let Some(folder) = folder {
        let file = page::write(&report, folder)?;
        output.note(&format!("report: {}", file.display()));
    }
    output.result(&report.table(output.style()))?;
    Ok(report.exit_code())
}

/// The scenario's limits of truth and flagged share hold in its corners too: that is what a yield counts.
/// Its limits of single stages and channels are those of its own parameters, and do not.
fn with_limits(run: &RunOptions) -> Result<RunOptions, Failure> {
    let mut run = run.clone();
    if run.recording.is_some() {
        return Ok(run);
    }
    let scenario = Scenario::load(&run.scenario).map_err(Failure::input)?;
    let seconds = run.seconds.unwrap_or(scenario.seconds);
    // The command that runs a corner again states them, and then they are taken as they are.
    let tolerance = scenario.limits_of(seconds, &[]);
    let (truth, status) = (&tolerance.truth, &tolerance.status);
    for (key, limit) in [
        ("tolerance.truth.rms_deg", truth.rms_deg),
        ("tolerance.truth.p99_deg", truth.p99_deg),
        ("tolerance.truth.max_deg", truth.max_deg),
        ("tolerance.status.most_flagged", status.most_flagged),
    ] {
        let is_given = run.set.iter().any(|(given, _)| given == key);
        if let (Some(limit), false) = (limit, is_given) {
            run.set.push((key.to_owned(), limit));
        }
    }
    Ok(run)
}

/// The scenario itself, the named corners, the random units. Named corners in which the design
/// cannot work are bad input; such units are units that fail.
fn jobs(
    options: &CornerOptions,
    corners: &Corners,
    run: &RunOptions,
    setup: &Setup,
) -> Result<Vec<Job>, Failure> {
    let nominal = Variant {
        name: "nominal".to_owned(),
        set: Vec::new(),
    };
    let mut jobs = Vec::new();
    for variant in std::iter::once(nominal).chain(corners.named()) {
        check(&variant, setup)?;
        jobs.push(job(variant, false, run, run.seed));
    }
    for index in 0..options.mc {
        let unit = corners
            .unit(&setup.scenario, run.seed, index)
            .map_err(Failure::input)?;
        let seed = run.seed.wrapping_add(index + 1);
        jobs.push(job(unit, true, run, seed));
    }
    Ok(jobs)
}

fn check(variant: &Variant, setup: &Setup) -> Result<(), Failure> {
    let in_corner = |error: &dyn std::fmt::Display| {
        Failure::input(format!("corner `{}`: {error}", variant.name))
    };
    let scenario: Scenario = variant
        .apply(&setup.scenario)
        .map_err(|error| in_corner(&error))?;
    setup
        .app
        .emulated(&scenario, setup.seed, setup.seconds, &setup.firmware)
        .map(|_| ())
        .map_err(|error| in_corner(&error))
}

fn job(variant: Variant, is_unit: bool, run: &RunOptions, seed: u64) -> Job {
    let mut run = RunOptions {
        seed,
        ..run.clone()
    };
    run.set.extend(variant.set.iter().cloned());
    Job {
        variant,
        is_unit,
        run,
    }
}

/// Makes the comparisons, `threads` at a time, each in a process of its own; results in the order
/// of the jobs.
fn compare_all(jobs: &[Job], threads: usize, output: Output) -> Result<Vec<Run>, Failure> {
    let program = std::env::current_exe()
        .map_err(|error| Failure::participant(format!("this program cannot be found: {error}")))?;
    let begin = Instant::now();
    let next = AtomicUsize::new(0);
    let done = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<Result<Run, Failure>>>> =
        jobs.iter().map(|_| Mutex::new(None)).collect();
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let result = compare(&program, job);
                    if result.is_err() {
                        // What is wrong with one comparison is wrong with all.
                        next.store(jobs.len(), Ordering::Relaxed);
                    }
                    let at = jobs.iter().position(|other| std::ptr::eq(other, job));
                    if let Some(Ok(mut slot)) = at.map(|at| results[at].lock()) {
                        *slot = Some(result);
                    }
                    let count = done.fetch_add(1, Ordering::Relaxed) + 1;
                    let left = time_left(begin.elapsed(), count, jobs.len());
                    output.progress(&format!("{count} of {} comparisons{left}", jobs.len()));
                }
            });
        }
    });
    output.progress("");
    let finished = results
        .into_iter()
        .filter_map(|slot| slot.into_inner().ok().flatten());
    finished.collect()
}

/// How long the rest takes if it takes as long as what is done.
fn time_left(elapsed: Duration, done: usize, all: usize) -> String {
    let left = elapsed.as_secs_f64() / done.max(1) as f64 * all.saturating_sub(done) as f64;
    match left {
        left if left < 1.0 => String::new(),
        left if left < 90.0 => format!(", about {left:.0} s left"),
        left if left < 5400.0 => format!(", about {:.0} min left", left / 60.0),
        left => format!(", about {:.1} h left", left / 3600.0),
    }
}

/// One comparison as a child process. A verdict, pass or fail, is a result; so is a crash of the
/// emulated program, and a unit in which the design cannot work.
fn compare(program: &std::path::Path, job: &Job) -> Result<Run, Failure> {
    let name = &job.variant.name;
    let failed = |error: std::io::Error| {
        Failure::participant(format!("`{name}` cannot be started: {error}"))
    };
    let mut command = Command::new(program);
    command
        .args(["compare", "--in-process", "--json", "--quiet"])
        .args(job.run.arguments_here())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    supervise(&mut command);
    let mut child = command.spawn().map_err(failed)?;
    // Held open until the child has ended: it ends, too, when this process does.
    let held = child.stdin.take();
    let child = child.wait_with_output().map_err(failed)?;
    drop(held);
    let said = String::from_utf8_lossy(&child.stderr).trim().to_owned();
    let status = child.status.code().and_then(|code| u8::try_from(code).ok());
    let command = verdict::command_line(&job.run);
    match status {
        Some(code::PASS | code::FAIL | code::CRASH) => {
            let document: Value = serde_json::from_slice(&child.stdout).map_err(|error| {
                Failure::participant(format!("`{name}` gave no result: {error}; {said}"))
            })?;
            Ok(Run::new(job, command, &document))
        }
        Some(code::INPUT) if job.is_unit => Ok(Run::refused(job, command, said)),
        _ => Err(Failure::participant(format!(
            "`{name}` ended with {}: {said}\nrun again: {command}",
            child.status
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_follows_from_what_is_done() {
        let left = |seconds, done| time_left(Duration::from_secs(seconds), done, 100);
        assert_eq!(left(10, 25), ", about 30 s left");
        assert_eq!(left(100, 25), ", about 5 min left");
        assert_eq!(left(10_000, 25), ", about 8.3 h left");
        assert_eq!(left(10, 100), "");
    }
}
