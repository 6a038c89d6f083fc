//! `ranges`: what values the nodes take, simulated next to derived.

use std::fmt::Write as _;
use std::process::ExitCode;

use cardan_tune::{NodeRange, ranges};
use clap::Args;
use serde::Serialize;

use crate::failure::Done;
use crate::output::Output;
use crate::recording;
use crate::run_options::RunOptions;

/// What values each node takes, simulated and derived, and the integer bits it needs.
///
/// Simulated: the algorithm on real numbers over the run's conversions. Derived: interval arithmetic
/// over the same algorithm, for any conversions at all. A node whose derived range fits its format
/// is proven; for the others an input that makes them overflow is searched.
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
}

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
    let setup = arguments.run.resolve()?;
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
        });
    }
    output.result(&table(&found.nodes, proven));
    Ok(ExitCode::SUCCESS)
}

fn table(nodes: &[NodeRange], proven: usize) -> String {
    let mut out = format!(
        "{:<19} {:>7} {:>11} {:>11} {:>11} {:>11} {:>5}  {}\n",
        "node", "format", "min", "max", "derived lo", "derived hi", "bits", "overflow"
    );
    for node in nodes {
        let number =
            |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.5}"));
        let overflow = if node.wraps_by_design {
            "wraps by design".to_owned()
        } else if node.overflows > 0 {
            format!("{} in simulation", node.overflows)
        } else if node.proven {
            "proven impossible".to_owned()
        } else if let Some(witness) = &node.witness {
            format!("possible: input {:?}", shortened(&witness.inputs))
        } else {
            "none found".to_owned()
        };
        let integer = i64::from(node.word) - i64::from(node.frac);
        let _ = writeln!(
            out,
            "{:<19} {:>7} {:>11} {:>11} {:>11} {:>11} {:>5}  {overflow}",
            node.name,
            format!("{integer}.{}", node.frac),
            number(node.min),
            number(node.max),
            number(node.derived.lo),
            number(node.derived.hi),
            node.integer,
        );
    }
    let _ = write!(
        out,
        "{proven} of {} nodes proven never to overflow",
        nodes.len()
    );
    out
}

/// The first inputs; the whole is in the JSON document.
fn shortened(inputs: &[i32]) -> &[i32] {
    &inputs[..inputs.len().min(4)]
}
