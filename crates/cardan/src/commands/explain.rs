//! `compare --explain`: what a node is, for people who meet it in a table, and the same as documents.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use cardan_bench::App;
use cardan_bench::app::Configuration;
use cardan_datapath::NodeInfo;
use cardan_numerics::tape::{Edge, Flow};
use cardan_page::flow::{self, STANDALONE};
use cardan_page::format::number;
use cardan_page::text::{Style, prose};
use cardan_page::unit::{Reading, reading};
use cardan_spec::ThirdTilt;
use serde::Serialize;

use crate::failure::{Done, Failure};
use crate::files::write_into;
use crate::judge::operations_of;
use crate::output::Output;
use crate::run_options::RunOptions;

/// What marks a way that values take only where a third tilt axis is measured.
const MEASURED_AXIS: &str = "measured axis";

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
    #[serde(skip)]
    from: Vec<Link>,
    #[serde(skip)]
    to: Vec<Link>,
    limit: String,
    limit_reason: String,
    /// What must be set for the node to be computed; none if it is in any case.
    only_with: Option<&'static str>,
}

/// Another node that enters a node, or is made of it.
#[derive(Debug)]
struct Link {
    node: String,
    /// By its value of the solution before.
    earlier: bool,
    /// Only where a third axis is measured, unlike the node itself.
    measured: bool,
}

/// The data flow with these settings, and with a measured third axis, which has nodes of its own.
struct Flows {
    own: Flow,
    measured: Flow,
    /// Nodes that hold what is followed along the chain.
    outputs: Vec<String>,
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
    let members = app.outputs(&own).group.map(|group| group.members);
    let outputs = members.into_iter().flatten().map(|member| member.node);
    let flows = Flows {
        own: flow(&own)?,
        measured: flow(&measured)?,
        outputs: outputs.collect(),
    };
    Ok((app, nodes, flows))
}

impl Flows {
    /// The nodes at the other end of edges: of those in these settings, and of those that only a
    /// measured third axis adds. Either end of an edge says so.
    fn links(&self, nodes: &[NodeInfo], other_end: impl Fn(&Edge) -> Option<usize>) -> Vec<Link> {
        let added = self.measured.edges.iter();
        let added = added.filter(|edge| !self.own.edges.contains(edge));
        let all = self.own.edges.iter().map(|edge| (edge, false));
        let all = all.chain(added.map(|edge| (edge, true)));
        let link = |(edge, measured): (&Edge, bool)| {
            Some(Link {
                node: nodes.get(other_end(edge)?)?.name.to_owned(),
                earlier: edge.earlier,
                measured,
            })
        };
        all.filter_map(link).collect()
    }
}

fn named(links: &[Link], earlier: bool) -> Vec<String> {
    let some = links.iter().filter(|link| link.earlier == earlier);
    some.map(|link| link.node.clone()).collect()
}

fn explained(app: &dyn App, nodes: &[NodeInfo], index: usize, flows: &Flows) -> Explained {
    let info = &nodes[index];
    let is_own = flows.own.position(index).is_some();
    let flow = if is_own { &flows.own } else { &flows.measured };
    let Reading { long, scale, .. } = reading(info.unit);
    let mut from = flows.links(nodes, |edge| (edge.to == index).then_some(edge.from));
    let mut to = flows.links(nodes, |edge| (edge.from == index).then_some(edge.to));
    for link in from.iter_mut().chain(&mut to) {
        link.measured &= is_own;
    }
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
        inputs: named(&from, false),
        earlier_inputs: named(&from, true),
        users: named(&to, false),
        later_users: named(&to, true),
        from,
        to,
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

/// The links' nodes, those by earlier values, which `when` tells, last.
fn list(links: &[Link], when: &str) -> String {
    let shown = |link: &Link| match (link.earlier, link.measured) {
        (false, false) => link.node.clone(),
        (true, false) => format!("{} ({when})", link.node),
        (false, true) => format!("{} ({MEASURED_AXIS})", link.node),
        (true, true) => format!("{} ({when}, {MEASURED_AXIS})", link.node),
    };
    let (earlier, own): (Vec<&Link>, Vec<&Link>) = links.iter().partition(|link| link.earlier);
    let all: Vec<String> = own.into_iter().chain(earlier).map(shown).collect();
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
    let unit = match node.unit.as_str() {
        "1" => String::new(),
        _ => format!(" {}", node.shown_in),
    };
    line(
        "range",
        &format!("{} to {}{unit}", number(node.least), number(node.most)),
    );
    line("resolution", &format!("{}{unit}", number(node.resolution)));
    line("made by", &node.made_by.join(", "));
    line("from", &list(&node.from, "of the solution before"));
    line("used by", &list(&node.to, "of the next solution"));
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
        drawing(&nodes, &flows),
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
         where a third tilt axis is measured, and \"(measured axis)\" marks what another node has of it then. \
         \"(before)\" marks a value of the solution before, \"(next)\" one that the next solution takes.\n\n\
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
            list(&node.from, "before"),
            list(&node.to, "next"),
        );
    }
    out
}

fn drawing(nodes: &[NodeInfo], flows: &Flows) -> String {
    let Flows { own, outputs, .. } = flows;
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
                    () if outputs.iter().any(|output| output == info.name) => "output",
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
