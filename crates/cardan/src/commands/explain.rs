//! `compare --explain`: what a node is, for people who meet it in a table, and the same as documents.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use cardan_bench::App;
use cardan_bench::app::Configuration;
use cardan_datapath::NodeInfo;
use cardan_numerics::tape::Flow;
use cardan_page::flow::{self, STANDALONE};
use cardan_page::format::number;
use cardan_page::text::{Style, prose};
use cardan_page::unit::{Reading, reading};
use cardan_spec::ThirdTilt;
use serde::Serialize;

use crate::failure::{Done, Failure};
use crate::files::write_into;
use crate::judge::{inputs_of, operations_of};
use crate::output::Output;
use crate::run_options::RunOptions;

/// All nodes, in `--explain`.
const ALL: &str = "all";

/// What is said of a node; values are in the unit that is shown.
#[derive(Debug, Serialize)]
struct Explained {
    name: String,
    meaning: String,
    unit: String,
    shown_in: String,
    word: u32,
    frac: u32,
    rounding: &'static str,
    overflow: &'static str,
    least: f64,
    most: f64,
    resolution: f64,
    made_by: Vec<String>,
    inputs: Vec<String>,
    earlier_inputs: Vec<String>,
    users: Vec<String>,
    later_users: Vec<String>,
    limit: String,
    limit_reason: String,
    /// What must be set for the node to be computed; none if it is in any case.
    only_with: Option<&'static str>,
}

/// The data flow with these settings, and with a measured third axis, which has nodes of its own.
struct Flows {
    own: Flow,
    measured: Flow,
}

pub(crate) fn execute(node: &str, run: &RunOptions, output: Output) -> Done {
    let (app, nodes, flows) = prepared(run)?;
    let known = nodes.iter().position(|info| info.name == node);
    let wanted: Vec<usize> = match known {
        Some(index) => vec![index],
        None if node == ALL => (0..nodes.len()).collect(),
        None => return Err(unknown(node, &nodes)),
    };
    let explained: Vec<Explained> = wanted
        .into_iter()
        .map(|index| explained(app, &nodes, index, &flows))
        .collect();
    if output.is_json() {
        match explained.as_slice() {
            [one] => output.document(one)?,
            all => output.document(&all)?,
        }
    }
    let style = output.style();
    let texts: Vec<String> = explained.iter().map(|node| text(node, style)).collect();
    output.result(&texts.join("\n"))?;
    Ok(ExitCode::SUCCESS)
}

fn unknown(node: &str, nodes: &[NodeInfo]) -> Failure {
    let near = nodes
        .iter()
        .map(|info| (strsim::jaro_winkler(info.name, node), info.name))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or("", |(_, name)| name);
    Failure::input(format!(
        "--explain {node}: there is no such node; did you mean '{near}'? (`--explain all` lists all)"
    ))
}

/// The application with its nodes in the formats in use, and how values flow.
fn prepared(run: &RunOptions) -> Result<(&'static dyn App, Vec<NodeInfo>, Flows), Failure> {
    let (app, formats, _) = run.app_and_formats()?;
    let mut nodes = app.nodes().to_vec();
    for (node, format) in nodes.iter_mut().zip(formats.iter().flatten()) {
        node.format = *format;
    }
    // The deployed image is enough to know what a run is made of.
    let deployed = RunOptions {
        wordlengths: None,
        firmware: None,
        build: false,
        ..run.clone()
    };
    let setup = deployed.resolve()?;
    let (own, _) = app
        .emulated(&setup.scenario, setup.seed, setup.seconds, &setup.firmware)
        .map_err(Failure::input)?;
    let measured = Configuration {
        third_tilt: ThirdTilt::Measured as u8,
        ..own.clone()
    };
    let flow = |configuration: &Configuration| app.flow(configuration).map_err(Failure::input);
    let flows = Flows {
        own: flow(&own)?,
        measured: flow(&measured)?,
    };
    Ok((app, nodes, flows))
}

fn explained(app: &dyn App, nodes: &[NodeInfo], index: usize, flows: &Flows) -> Explained {
    let info = &nodes[index];
    let is_own = flows.own.position(index).is_some();
    let flow = if is_own { &flows.own } else { &flows.measured };
    let Reading { long, scale, .. } = reading(info.unit);
    let inputs = inputs_of(flow, index, nodes);
    let named = |earlier: bool| -> Vec<String> {
        let some = inputs.iter().filter(|input| input.earlier == earlier);
        some.map(|input| input.node.clone()).collect()
    };
    let users = |earlier: bool| -> Vec<String> {
        let some = flow
            .edges
            .iter()
            .filter(|edge| edge.from == index && edge.earlier == earlier);
        some.map(|edge| nodes[edge.to].name.to_owned()).collect()
    };
    let (limit, limit_reason) = limit(app, info);
    let format = info.format;
    Explained {
        name: info.name.to_owned(),
        meaning: info.meaning.to_owned(),
        unit: info.unit.to_owned(),
        shown_in: long.to_owned(),
        word: format.word,
        frac: format.frac,
        rounding: format.rounding.name(),
        overflow: format.overflow.name(),
        least: scale * format.real(format.min_raw()),
        most: scale * format.real(format.max_raw()),
        resolution: scale * format.lsb(),
        made_by: operations_of(flow, index),
        inputs: named(false),
        earlier_inputs: named(true),
        users: users(false),
        later_users: users(true),
        limit,
        limit_reason,
        only_with: (!is_own).then_some("sensors.third_tilt = \"measured\""),
    }
}

/// What a comparison holds the node to, and why.
fn limit(app: &dyn App, info: &NodeInfo) -> (String, String) {
    const ROUNDING: &str = "what rounding in these formats explains, value by value";
    let shared = app.tolerances();
    match shared.iter().find(|shared| shared.node == info.name) {
        Some(shared) => {
            let Reading { long, scale, .. } = reading(info.unit);
            let beside = number(scale * shared.max_abs);
            let reason = format!("beside rounding: {}", shared.reason);
            let limit = format!(
                "against golden: {ROUNDING}, and {beside} {long}; against the same algorithm in f64: {ROUNDING}"
            );
            (limit, reason)
        }
        None => (
            format!("against the same algorithm in f64: {ROUNDING}"),
            "golden has no such node: only this algorithm computes it".to_owned(),
        ),
    }
}

fn list(names: &[String], earlier: &[String], when: &str) -> String {
    let own = names.iter().cloned();
    let earlier = earlier.iter().map(|name| format!("{name} ({when})"));
    let all: Vec<String> = own.chain(earlier).collect();
    if all.is_empty() {
        "none".to_owned()
    } else {
        all.join(", ")
    }
}

fn text(node: &Explained, style: Style) -> String {
    let style = style.legible();
    let mut out = String::new();
    prose(&mut out, &style.bold(&node.name), 2, "", style);
    let integer = i64::from(node.word) - i64::from(node.frac);
    let mut line =
        |title: &str, what: &str| prose(&mut out, &format!("  {title:<11}"), 13, what, style);
    line("meaning", &node.meaning);
    if let Some(only) = node.only_with {
        line("", &format!("(computed only with {only})"));
    }
    line("unit", &node.shown_in);
    line(
        "format",
        &format!(
            "{integer}.{} ({} bits, {} of them fractional), rounds {}, overflow {}",
            node.frac, node.word, node.frac, node.rounding, node.overflow
        ),
    );
    let unit = &node.shown_in;
    line(
        "range",
        &format!("{} to {} {unit}", number(node.least), number(node.most)),
    );
    line("resolution", &format!("{} {unit}", number(node.resolution)));
    line("made by", &node.made_by.join(", "));
    line(
        "from",
        &list(&node.inputs, &node.earlier_inputs, "of the solution before"),
    );
    line(
        "used by",
        &list(&node.users, &node.later_users, "of the next solution"),
    );
    line("limit", &node.limit);
    line("why", &node.limit_reason);
    out
}

/// Writes `nodes.md` and `nodes.svg`: every node as a table, and the data flow as a drawing.
pub(crate) fn write_documents(folder: &Path, run: &RunOptions, output: Output) -> Done {
    let (app, nodes, flows) = prepared(run)?;
    write_into(
        "--explain-docs",
        folder,
        "nodes.md",
        markdown(app, &nodes, &flows),
    )?;
    write_into(
        "--explain-docs",
        folder,
        "nodes.svg",
        drawing(app, &nodes, &flows.own),
    )?;
    output.note(&format!("written: {}", folder.display()));
    Ok(ExitCode::SUCCESS)
}

fn markdown(app: &dyn App, nodes: &[NodeInfo], flows: &Flows) -> String {
    let mut out = format!(
        "# Nodes of `{}`\n\nEvery intermediate value of the datapath, in the order of \
         `firmware/wordlengths.toml`. Written by `cargo xtask node-docs` from that file and from the algorithm \
         itself; a test keeps it current. `cardan compare --explain NODE` says the same of one node.\n\n\
         Format: integer bits, the sign among them, and fractional bits. A node in *italics* is computed only \
         where a third tilt axis is measured. \"(before)\" marks a value of the solution before.\n\n\
         ![Data flow](nodes.svg)\n\nBlue: inputs. Green: what is sent. Dashed: values of the solution before, \
         and nodes that are used again. Settings and constants are grey.\n\n\
         | node | meaning | unit | format | range | resolution | from | used by |\n\
         |---|---|---|---|---|---|---|---|\n",
        app.name()
    );
    for index in 0..nodes.len() {
        let node = explained(app, nodes, index, flows);
        let name = match node.only_with {
            Some(_) => format!("*{}*", node.name),
            None => node.name.clone(),
        };
        let integer = i64::from(node.word) - i64::from(node.frac);
        let cell = |text: &str| text.replace('|', "\\|");
        let _ = writeln!(
            out,
            "| {name} | {} | {} | {integer}.{}, {}, {} | {} to {} | {} | {} | {} |",
            cell(&node.meaning),
            cell(&node.shown_in),
            node.frac,
            node.rounding,
            node.overflow,
            number(node.least),
            number(node.most),
            number(node.resolution),
            list(&node.inputs, &node.earlier_inputs, "before"),
            list(&node.users, &node.later_users, "next"),
        );
    }
    out
}

fn drawing(app: &dyn App, nodes: &[NodeInfo], own: &Flow) -> String {
    let outputs = app.attitude_nodes();
    let drawn: Vec<flow::Node> = own
        .order
        .iter()
        .zip(&own.operations)
        .map(|(&index, operations)| {
            let info = &nodes[index];
            let integer = i64::from(info.format.word) - i64::from(info.format.frac);
            let only = |word: &str| operations.iter().all(|operation| *operation == word);
            flow::Node {
                name: info.name.to_owned(),
                detail: flow::detail(operations, &format!("{integer}.{}", info.format.frac)),
                meaning: info.meaning.to_owned(),
                class: match () {
                    () if outputs.contains(&index) => "output",
                    () if own.inputs.contains(&index) => "input",
                    () if only("setting") || only("constant") => "setting",
                    () => "",
                },
            }
        })
        .collect();
    let edges: Vec<flow::Edge> = own
        .edges
        .iter()
        .filter_map(|edge| {
            Some(flow::Edge {
                from: own.position(edge.from)?,
                to: own.position(edge.to)?,
                earlier: edge.earlier,
            })
        })
        .collect();
    flow::svg(&drawn, &edges, Some(STANDALONE)).into_string() + "\n"
}
