//! `ranges`: what values the nodes take, simulated next to derived.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use cardan_page::text::{Style, Tone, column, grid};
use cardan_page::unit::reading;
use cardan_tune::{NodeRange, ranges, ranges_page};
use clap::Args;
use serde::Serialize;

use crate::failure::{Done, Failure};
use crate::files::write_into;
use crate::output::Output;
use crate::recording;
use crate::run_options::RunOptions;

/// What values each node takes, simulated and derived, and the integer bits it needs.
///
/// Simulated: the algorithm on real numbers over the run's conversions. Derived: interval and affine
/// arithmetic over the same algorithm, for any conversions at all; affine arithmetic knows what values
/// have in common and is never wider. A node whose derived range fits its format is proven; for the
/// others an input that makes them overflow is searched.
#[derive(Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    run: RunOptions,
    /// Bits above the simulated range, where the derived range does not prove fewer
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=16))]
    guard_bits: u32,
    /// Further scenario to simulate; may be given several times
    #[arg(long, value_name = "NAME|FILE")]
    also: Vec<String>,
    /// Random solutions in which overflows are searched
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u64).range(0..=10_000_000))]
    search: u64,
    /// Write ranges.html into this folder
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
}

/// File of the report.
const PAGE: &str = "ranges.html";

#[derive(Serialize)]
struct Document<'a> {
    app: &'a str,
    scenario: &'a str,
    seed: u64,
    guard_bits: u32,
    solutions: u64,
    proven: usize,
    nodes: &'a [NodeRange],
}

/// Runs the command.
pub(crate) fn execute(arguments: &Arguments, output: Output) -> Done {
    let report = arguments.report.as_deref();
    let plan = arguments.run.inputs().folder("--report", report, &[PAGE]);
    plan.check()?;
    let setup = arguments.run.resolve()?;
    setup.announce(output)?;
    output.note("simulating");
    let mut problem = recording::problem(&setup, 1, &arguments.also, &[])?;
    if let Some(formats) = &setup.formats {
        for (node, format) in problem.nodes.iter_mut().zip(formats) {
            node.format = *format;
        }
    }
    let search = arguments.search as usize;
    let found = ranges(&problem, arguments.guard_bits, search, setup.seed);
    for node in found.nodes.iter().filter(|node| node.unexcited) {
        output.note(&format!(
            "warning: node '{}' took one value only; this scenario does not excite it, and its range \
             means nothing",
            node.name
        ));
    }
    let proven = found.nodes.iter().filter(|node| node.proven).count();
    if output.is_json() {
        output.document(&Document {
            app: setup.app.name(),
            scenario: &setup.scenario.name,
            seed: setup.seed,
            guard_bits: arguments.guard_bits,
            solutions: found.steps,
            proven,
            nodes: &found.nodes,
        })?;
    }
    if let Some(folder) = &arguments.report {
        let title = format!("{}: ranges", setup.app.name());
        write_report(
            folder,
            &ranges_page(&found, &title, &command_line(arguments)),
            output,
        )?;
    }
    output.result(&table(&found.nodes, proven, output.style()))?;
    Ok(ExitCode::SUCCESS)
}

fn write_report(folder: &Path, page: &str, output: Output) -> Result<(), Failure> {
    let file = write_into("--report", folder, PAGE, page)?;
    output.note(&format!("written: {}", file.display()));
    Ok(())
}

/// The command that finds the same again: every option that the result depends on.
fn command_line(arguments: &Arguments) -> String {
    let mut line = format!("cardan ranges{}", arguments.run.arguments().typed());
    for scenario in &arguments.also {
        let _ = write!(line, " --also {scenario}");
    }
    let (guard_bits, search) = (arguments.guard_bits, arguments.search);
    let _ = write!(line, " --guard-bits {guard_bits} --search {search}");
    line
}

fn table(nodes: &[NodeRange], proven: usize, style: Style) -> String {
    let style = style.legible();
    let columns = [
        column("node", false, 0),
        column("unit", false, 3),
        column("format", true, 2),
        column("simulated", true, 0),
        column("interval", true, 4),
        column("affine", true, 1),
        column("bits", true, 0),
        column("overflow", false, 0),
    ];
    let rows: Vec<Vec<String>> = nodes
        .iter()
        .map(|node| {
            let reading = reading(&node.unit);
            let span = |lo: Option<f64>, hi: Option<f64>| {
                let shown = |value: Option<f64>| value.map(|value| reading.scale * value);
                span(shown(lo), shown(hi))
            };
            vec![
                node.name.clone(),
                reading.short.to_owned(),
                format!(
                    "{}.{}",
                    i64::from(node.word) - i64::from(node.frac),
                    node.frac
                ),
                span(node.min, node.max),
                span(node.derived.lo, node.derived.hi),
                span(node.derived_affine.lo, node.derived_affine.hi),
                node.integer.to_string(),
                node.verdict(),
            ]
        })
        .collect();
    let tones: Vec<Tone> = nodes
        .iter()
        .map(|node| match () {
            () if node.proven || node.wraps_by_design => Tone::Good,
            () if node.overflows > 0 || node.beyond.is_some() => Tone::Bad,
            () => Tone::Plain,
        })
        .collect();
    let mut out = String::new();
    grid(&mut out, &columns, &rows, Some((7, &tones)), style);
    let _ = write!(
        out,
        "{proven} of {} nodes proven never to overflow",
        nodes.len()
    );
    out
}

/// From one end to the other; a dash where an end is not known.
fn span(lo: Option<f64>, hi: Option<f64>) -> String {
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.4}"));
    format!("{}..{}", number(lo), number(hi))
}
