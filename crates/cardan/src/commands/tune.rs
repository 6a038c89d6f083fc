//! `tune`: the word lengths that meet a budget at the least cost.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use cardan_tune::cost::Coefficients;
use cardan_tune::{
    Cost, Method, Options, Outcome, Progress, TuneError, output as written, page, rewritten,
    tune_with,
};
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::failure::{Done, Failure, code};
use crate::files::{read_text, write_into, write_whole};
use crate::output::Output;
use crate::recording;
use crate::run_options::{RunOptions, Setup};
use crate::toolchain::Checkout;

mod again;
mod table;
mod target;

use again::command_line;

/// Finds the word lengths that meet a budget at the least cost.
///
/// Budgets: attitude.rms<=0.05 (also yaw, pitch, roll; rms, p99, max; degrees against the golden
/// model on the same codes), truth.yaw.rms<=1.5 (against the truth), sqnr(NODE)>=60dB, lsb(NODE)<=2,
/// overflow==0, flags<=0.01 (share of solutions with other status bits), cycles<=N, flash<=N. All
/// that are given must hold. If none can: exit code 1, with the closest point.
///
/// The result is verified on fresh seeds that nothing was tuned on: the limits must hold for 95 % of
/// such runs with 95 % confidence. If they do not, the runs that miss are tuned on too, and the result is
/// verified on other seeds. What is not verified ends with exit code 1.
#[derive(Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    run: RunOptions,
    /// What must be met; may be given several times
    #[arg(long, value_name = "EXPR", required = true, num_args = 1..)]
    budget: Vec<String>,
    /// What is to be small
    #[arg(long, value_enum, default_value_t = CostName::Bits)]
    cost: CostName,
    /// Coefficients of the area and cycle estimates instead of the bundled ones (TOML)
    #[arg(long, value_name = "FILE")]
    coefficients: Option<PathBuf>,
    /// How to search
    #[arg(long, value_enum, default_value_t = MethodName::Sensitivity)]
    method: MethodName,
    /// Node that keeps its deployed format; may be given several times
    #[arg(long, value_name = "NODE")]
    lock: Vec<String>,
    /// Nodes that share a word length, separated by commas; may be given several times
    #[arg(long, value_name = "NODE,NODE...")]
    couple: Vec<String>,
    /// Allowed word lengths, separated by commas [default: all up to 32; 8,16,32 for cycles]
    #[arg(long, value_name = "N,N...", value_delimiter = ',')]
    widths: Vec<u32>,
    /// Bits above what values take in simulation, where the derived range does not prove fewer.
    /// Without any, values beyond it saturate; words that may wrap are proven anyway
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=16))]
    guard_bits: u32,
    /// Most candidates to simulate in the search; ranges, baselines and the last checks come on top
    #[arg(long, value_name = "N")]
    evaluations: Option<u64>,
    /// Most seconds to search; the result then depends on the machine's speed
    #[arg(long, value_name = "S")]
    time: Option<f64>,
    /// Most candidates without a better one
    #[arg(long, value_name = "N")]
    patience: Option<u64>,
    /// Threads [default: all cores]; the result does not depend on them
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// File that keeps every evaluation; an interrupted search goes on from it
    #[arg(long, value_name = "FILE")]
    journal: Option<PathBuf>,
    /// Runs of the scenario to tune on, with seeds from --seed up; one more verifies. On a single one
    /// the search learns its noise by heart
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=1000))]
    runs: u64,
    /// Further scenario to tune on [default: magnet]; may be given several times. What raises a
    /// status bit is held to its limit only by a scenario that raises it
    #[arg(long, value_name = "NAME|FILE")]
    also: Vec<String>,
    /// Further scenario to verify on [default: static]; may be given several times
    #[arg(long, value_name = "NAME|FILE")]
    held_out: Vec<String>,
    /// Fresh seeds of the scenario that verify the result, per round; 0 for none: then only --held-out and
    /// one more seed do. Fewer than 94 need a model of how runs scatter (normal tolerance limit)
    #[arg(long, value_name = "N", default_value_t = 94, value_parser = fresh_runs)]
    fresh: u64,
    /// Write the word lengths there
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write front.csv, tune.json and tune.html into this folder
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Write the word lengths into the firmware of the checkout that this is run in (comments and order of its
    /// wordlengths.toml stay), rebuild it and compare it in the emulator
    #[arg(long)]
    apply: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum CostName {
    /// Sum of the word lengths
    Bits,
    /// Estimated silicon area
    Area,
    /// Controller cycles: estimated in the search, measured for the result
    Cycles,
}

#[derive(Clone, Copy, ValueEnum)]
enum MethodName {
    /// Noise model, repaired by simulation, then descent and exchanges
    Sensitivity,
    /// Greedy from the best uniform width down
    #[value(name = "max-1")]
    MaxMinusOne,
    /// Greedy from each node's least width up
    #[value(name = "min+1")]
    MinPlusOne,
    /// Every combination
    Exhaustive,
    /// One width for all nodes
    Uniform,
}

/// Files of the report.
const REPORT: [&str; 3] = ["front.csv", "tune.json", "tune.html"];

#[derive(Serialize)]
struct Document<'a> {
    app: &'a str,
    scenario: &'a str,
    seed: u64,
    budget: &'a [String],
    #[serde(flatten)]
    outcome: &'a Outcome,
    /// The verdict of the rebuilt firmware, with `--apply`.
    applied: Option<cardan_compare::Verdict>,
}

/// Runs the command.
pub(crate) fn execute(arguments: &Arguments, output: Output) -> Done {
    let files = arguments.run.inputs();
    files
        .input("--coefficients", arguments.coefficients.as_deref())
        .output("--out", arguments.out.as_deref())
        .output("--journal", arguments.journal.as_deref())
        .folder("--report", arguments.report.as_deref(), &REPORT)
        .check()?;
    let setup = arguments.run.resolve()?;
    if setup.formats.is_some() {
        return Err(Failure::input(
            "--wordlengths: tune starts from the firmware's own formats; leave the option out",
        ));
    }
    let options = options(arguments, &setup)?;
    let own = arguments
        .apply
        .then(|| target::to_apply_to(&arguments.run, setup.app))
        .transpose()?;
    if let Some(checkout) = &own {
        output.note(&format!(
            "--apply will write {} in {checkout}",
            checkout.wordlengths().display()
        ));
    }
    let sources = Checkout::to_read(arguments.run.checkout.as_deref());
    setup.announce(output)?;
    output.note("recording the scenario and those to verify on");
    let given = |names: &[String], default: &str| match names {
        [] => vec![default.to_owned()],
        names => names.to_vec(),
    };
    let also = given(&arguments.also, "magnet");
    let held_out = given(&arguments.held_out, "static");
    let problem = recording::problem(&setup, arguments.runs, &also, &held_out)?;
    let mut shown = Shown::new(output);
    let app = setup.app;
    let measure = move |formats: &[cardan_datapath::Format]| match &sources {
        Ok(sources) => target::on_target(sources, app, formats, output),
        Err(failure) => Err(TuneError::Target(failure.to_string())),
    };
    // Fresh seeds follow those tuned on and the one that is held out.
    let first = arguments.runs + 1;
    let record = |runs: std::ops::Range<u64>| {
        output.note("recording fresh runs");
        recording::cases(&setup, first + runs.start..first + runs.end)
            .map_err(|failure| TuneError::NoCase(failure.to_string()))
    };
    let fresh: Option<&cardan_tune::FreshFn<'_>> = (arguments.fresh > 0).then_some(&record);
    let helpers = (Some(&measure as _), fresh);
    let outcome = tune_with(&problem, &options, helpers, &mut |progress| {
        shown.show(progress);
    })
    .map_err(|error| failure(&error))?;
    shown.end();
    for warning in &outcome.warnings {
        output.note(&format!("warning: {warning}"));
    }
    let mut document = Document {
        app: setup.app.name(),
        scenario: &setup.scenario.name,
        seed: setup.seed,
        budget: &arguments.budget,
        outcome: &outcome,
        applied: None,
    };
    write(arguments, &document, &problem.nodes, output)?;
    let mut passes = outcome.feasible && outcome.verified;
    if let (Some(checkout), true) = (&own, passes) {
        let command = command_line(arguments);
        let with_result =
            |text: &str, file: &str| rewritten(text, file, &outcome, &problem.nodes, &command);
        let report = target::apply(checkout, &arguments.run, with_result, output)?;
        // Bundled tolerances are those of the formats before; what must hold is that the compiled
        // code does the same as the tuned model.
        passes = target::is_bit_equal(&report);
        document.applied = Some(report.verdict);
        output.note(&target::told(&report));
    } else if own.is_some() {
        output.note(
            "--apply: nothing was written, since the result is not verified to meet the budget",
        );
    }
    if output.is_json() {
        output.document(&document)?;
    }
    output.result(&table::render(&outcome, output.style()))?;
    if let (Some(what), Some(file)) = (&outcome.journal_lost, &arguments.journal) {
        return Err(Failure::input(format!(
            "--journal {}: cannot be written: {what}; the result above is whole, but the search cannot be \
             resumed from this file: make room, or give a file on another disk",
            file.display()
        )));
    }
    Ok(ExitCode::from(if passes { code::PASS } else { code::FAIL }))
}

/// None, or enough for a distribution.
fn fresh_runs(text: &str) -> Result<u64, String> {
    let count: u64 = text.parse().map_err(|_| "expected a number".to_owned())?;
    if count == 0 || (3..=1000).contains(&count) {
        Ok(count)
    } else {
        Err("expected 0, or 3 to 1000: fewer runs say nothing of a distribution".to_owned())
    }
}

fn failure(error: &TuneError) -> Failure {
    Failure::input(error)
}

fn options(arguments: &Arguments, setup: &Setup) -> Result<Options, Failure> {
    let coefficients = || -> Result<Box<Coefficients>, Failure> {
        let read = match &arguments.coefficients {
            None => Coefficients::bundled(),
            Some(file) => Coefficients::parse(&read_text(file)?, &file.display().to_string()),
        };
        read.map(Box::new).map_err(Failure::input)
    };
    if let (CostName::Bits, Some(file)) = (arguments.cost, &arguments.coefficients) {
        return Err(Failure::input(format!(
            "--coefficients {}: bits are counted, not priced; add --cost area or --cost cycles, or leave it out",
            file.display()
        )));
    }
    if let Some(seconds) = arguments.time
        && !(seconds.is_finite() && seconds > 0.0)
    {
        return Err(Failure::input(format!(
            "--time {seconds}: expected a number of seconds above 0"
        )));
    }
    let couple = |list: &String| -> Vec<String> {
        list.split(',').map(|name| name.trim().to_owned()).collect()
    };
    for list in &arguments.couple {
        let names: BTreeSet<String> = couple(list).into_iter().collect();
        if names.len() < 2 {
            return Err(Failure::input(format!(
                "--couple {list}: expected at least two nodes, as in --couple cos_1,cos_2"
            )));
        }
        if let Some(name) = arguments.lock.iter().find(|name| names.contains(*name)) {
            return Err(Failure::input(format!(
                "--couple {list}: {name} is locked (--lock); give one of the two"
            )));
        }
    }
    let default = Options::new(arguments.budget.iter().cloned());
    Ok(Options {
        cost: match arguments.cost {
            CostName::Bits => Cost::Bits,
            CostName::Area => Cost::Area(coefficients()?),
            CostName::Cycles => Cost::Cycles(coefficients()?),
        },
        method: match arguments.method {
            MethodName::Sensitivity => Method::Sensitivity,
            MethodName::MaxMinusOne => Method::MaxMinusOne,
            MethodName::MinPlusOne => Method::MinPlusOne,
            MethodName::Exhaustive => Method::Exhaustive,
            MethodName::Uniform => Method::Uniform,
        },
        seed: setup.seed,
        threads: arguments.threads.map_or(default.threads, usize::from),
        guard_bits: arguments.guard_bits,
        locked: arguments.lock.clone(),
        coupled: arguments.couple.iter().map(couple).collect(),
        widths: arguments.widths.clone(),
        evaluations: arguments.evaluations,
        seconds: arguments.time,
        patience: arguments.patience,
        journal: arguments.journal.clone(),
        fresh: arguments.fresh,
        ..default
    })
}

/// Shows progress a few times a second.
struct Shown {
    output: Output,
    next: std::time::Instant,
}

impl Shown {
    const EVERY: std::time::Duration = std::time::Duration::from_millis(200);

    fn new(output: Output) -> Self {
        Self {
            output,
            next: std::time::Instant::now(),
        }
    }

    fn show(&mut self, progress: Progress) {
        let now = std::time::Instant::now();
        if now < self.next {
            return;
        }
        self.next = now + Self::EVERY;
        let best = progress
            .best
            .map_or("-".to_owned(), |best| format!("{best:.0}"));
        let (stage, count) = (progress.stage, progress.evaluations);
        self.output
            .progress(&format!("{stage}: {count} candidates, best {best}"));
    }

    fn end(&self) {
        self.output.progress("");
    }
}

fn write(
    arguments: &Arguments,
    document: &Document<'_>,
    nodes: &[cardan_datapath::NodeInfo],
    output: Output,
) -> Result<(), Failure> {
    let written_to = |file: &Path| output.note(&format!("written: {}", file.display()));
    let command = command_line(arguments);
    if let Some(file) = &arguments.out {
        let text = written::wordlengths(document.outcome, nodes, &command);
        write_whole("--out", file, text)?;
        written_to(file);
    }
    if let Some(folder) = &arguments.report {
        let title = format!("{}: word lengths", document.app);
        let json = serde_json::to_string_pretty(document).map_err(Failure::participant)?;
        let texts = [
            written::front_csv(document.outcome),
            json,
            page(document.outcome, &title, &command),
        ];
        for (name, text) in REPORT.into_iter().zip(texts) {
            written_to(&write_into("--report", folder, name, text)?);
        }
    }
    Ok(())
}
