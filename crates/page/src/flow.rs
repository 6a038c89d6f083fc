//! A data-flow graph drawn in layers: what enters a node lies above it. Values of earlier steps are dashed.

use std::collections::BTreeMap;

use maud::{Markup, html};

/// A node of the drawing.
#[derive(Clone, Debug, Default)]
pub struct Node {
    /// First line.
    pub name: String,
    /// Second line.
    pub detail: String,
    /// Shown when pointed at.
    pub meaning: String,
    /// `input`, `setting`, `output`, `bad` or nothing.
    pub class: &'static str,
}

/// An arrow between two nodes by their indices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Where from.
    pub from: usize,
    /// Where to.
    pub to: usize,
    /// It carries an earlier step's value.
    pub earlier: bool,
}

const BOX: (f64, f64) = (128.0, 34.0);
const GAP: (f64, f64) = (14.0, 30.0);
/// Sweeps down and up that order the nodes of a layer by their neighbours.
const SWEEPS: usize = 6;

/// Where every node lies.
struct Layout {
    place: Vec<(f64, f64)>,
    size: (f64, f64),
}

/// Characters that have room in the second line.
const DETAIL: usize = 25;

/// The second line of a node: what writes it, shortened where that has no room, and its format. Constants are
/// left out beside other operations: they are what a node begins with.
#[must_use]
pub fn detail(operations: &[&str], format: &str) -> String {
    let mut shown: Vec<&str> = operations.to_vec();
    if shown.len() > 1 {
        shown.retain(|operation| *operation != "constant");
    }
    let whole = format!("{} · {format}", shown.join(", "));
    if whole.chars().count() <= DETAIL || shown.len() < 2 {
        return whole;
    }
    format!("{} … · {format}", shown[0])
}

/// The drawing of nodes in the order of their first writes: an arrow from a later to an earlier node is
/// drawn as one that leads back.
#[must_use]
pub fn svg(nodes: &[Node], edges: &[Edge], style: Option<&str>) -> Markup {
    let forward = |edge: &&Edge| !edge.earlier && edge.from < edge.to;
    let ahead: Vec<Edge> = edges.iter().filter(forward).copied().collect();
    let layout = layout(nodes.len(), &ahead);
    let (width, height) = layout.size;
    html! {
        svg.flow xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 {width:.0} {height:.0}"))
            width=(format!("{width:.0}")) height=(format!("{height:.0}")) role="img"
            aria-label="data flow of the algorithm" {
            @if let Some(style) = style { style { (style) } }
            @for edge in edges {
                path .back[edge.earlier || edge.from >= edge.to] d=(curve(&layout, *edge)) {}
            }
            @for (index, node) in nodes.iter().enumerate() {
                @let (x, y) = layout.place[index];
                g class=(node.class) {
                    title { (node.name) ": " (node.meaning) }
                    rect x=(format!("{x:.1}")) y=(format!("{y:.1}")) width=(BOX.0) height=(BOX.1) rx="5" {}
                    text x=(format!("{:.1}", x + BOX.0 / 2.0)) y=(format!("{:.1}", y + 14.0)) { (node.name) }
                    text.detail x=(format!("{:.1}", x + BOX.0 / 2.0)) y=(format!("{:.1}", y + 27.0)) {
                        (node.detail)
                    }
                }
            }
        }
    }
}

/// The style of a drawing that stands alone.
pub const STANDALONE: &str = "svg{background:#fff}rect{fill:#fff;stroke:#616a75}text{font:11px sans-serif;\
text-anchor:middle;fill:#1c2127}.detail{font-size:9.5px;fill:#616a75}path{fill:none;stroke:#1d5fc4;\
stroke-opacity:.45}.back{stroke:#b3261e;stroke-dasharray:4 3}.input rect{fill:#e3eefc}.setting \
rect{fill:#f1efe8}.output rect{fill:#e3f2e9;stroke-width:2}";

fn curve(layout: &Layout, edge: Edge) -> String {
    let (from, to) = (layout.place[edge.from], layout.place[edge.to]);
    let (x0, y0) = (from.0 + BOX.0 / 2.0, from.1 + BOX.1);
    let (x1, y1) = (to.0 + BOX.0 / 2.0, to.1);
    if edge.from == edge.to {
        let (x, y) = (from.0 + BOX.0, from.1);
        return format!(
            "M{x:.1} {:.1}C{:.1} {:.1} {:.1} {:.1} {x:.1} {:.1}",
            y + 24.0,
            x + 16.0,
            y + 24.0,
            x + 16.0,
            y + 8.0,
            y + 8.0
        );
    }
    let bend = ((y1 - y0).abs() / 2.0).clamp(18.0, 60.0);
    format!(
        "M{x0:.1} {y0:.1}C{x0:.1} {:.1} {x1:.1} {:.1} {x1:.1} {y1:.1}",
        y0 + bend,
        y1 - bend
    )
}

fn layout(count: usize, edges: &[Edge]) -> Layout {
    let mut layer = vec![0usize; count];
    // Edges lead to later nodes, so one pass in order finds the longest ways.
    let mut by_target: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    let mut by_source: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for edge in edges {
        by_target.entry(edge.to).or_default().push(edge.from);
        by_source.entry(edge.from).or_default().push(edge.to);
    }
    for node in 0..count {
        let above = by_target.get(&node).into_iter().flatten();
        layer[node] = above.map(|&from| layer[from] + 1).max().unwrap_or(0);
    }
    // Settings and constants lie right above the first node that takes them.
    for node in (0..count).filter(|node| !by_target.contains_key(node)) {
        let below = by_source.get(&node).into_iter().flatten();
        if let Some(first) = below.map(|&to| layer[to]).min() {
            layer[node] = first.saturating_sub(1);
        }
    }
    let depth = layer.iter().max().map_or(0, |most| most + 1);
    let mut layers: Vec<Vec<usize>> = vec![Vec::new(); depth];
    for (node, &at) in layer.iter().enumerate() {
        layers[at].push(node);
    }
    order(&mut layers, &by_target, &by_source, count);
    let widest = layers.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let width = widest * (BOX.0 + GAP.0) + GAP.0;
    let mut place = vec![(0.0, 0.0); count];
    for (row, nodes) in layers.iter().enumerate() {
        let own = nodes.len() as f64 * (BOX.0 + GAP.0) - GAP.0;
        for (at, &node) in nodes.iter().enumerate() {
            let x = (width - own) / 2.0 + at as f64 * (BOX.0 + GAP.0);
            place[node] = (x, GAP.1 / 2.0 + row as f64 * (BOX.1 + GAP.1));
        }
    }
    let height = depth as f64 * (BOX.1 + GAP.1);
    Layout {
        place,
        size: (width, height),
    }
}

/// Orders the nodes of each layer by the mean place of their neighbours above, then below.
fn order(
    layers: &mut [Vec<usize>],
    by_target: &BTreeMap<usize, Vec<usize>>,
    by_source: &BTreeMap<usize, Vec<usize>>,
    count: usize,
) {
    let mut place = vec![0.5; count];
    let settle = |layer: &[usize], place: &mut [f64]| {
        for (at, &node) in layer.iter().enumerate() {
            place[node] = (at as f64 + 0.5) / layer.len() as f64;
        }
    };
    for layer in layers.iter() {
        settle(layer, &mut place);
    }
    for sweep in 0..SWEEPS {
        let neighbours = if sweep % 2 == 0 { by_target } else { by_source };
        let rows: Vec<usize> = match sweep % 2 {
            0 => (0..layers.len()).collect(),
            _ => (0..layers.len()).rev().collect(),
        };
        for row in rows {
            let mean = |node: usize| match neighbours.get(&node) {
                Some(all) => all.iter().map(|&other| place[other]).sum::<f64>() / all.len() as f64,
                None => place[node],
            };
            let mut keyed: Vec<(f64, usize)> =
                layers[row].iter().map(|&node| (mean(node), node)).collect();
            keyed.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            layers[row] = keyed.into_iter().map(|(_, node)| node).collect();
            settle(&layers[row], &mut place);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edge(from: usize, to: usize, earlier: bool) -> Edge {
        Edge { from, to, earlier }
    }

    #[test]
    fn what_enters_a_node_lies_above_it_and_no_two_nodes_share_a_place() {
        let edges = [
            edge(0, 2, false),
            edge(1, 2, false),
            edge(2, 3, false),
            edge(0, 3, false),
        ];
        let layout = layout(5, &edges);
        let mut rows: Vec<f64> = layout.place.iter().map(|place| place.1).collect();
        rows.sort_by(f64::total_cmp);
        rows.dedup();
        assert_eq!(rows.len(), 3);
        for edge in edges {
            assert!(
                layout.place[edge.from].1 < layout.place[edge.to].1,
                "{edge:?}"
            );
        }
        for a in 0..5 {
            assert!((0..a).all(|b| layout.place[a] != layout.place[b]));
        }
    }

    #[test]
    fn a_second_line_keeps_its_room() {
        assert_eq!(detail(&["constant"], "1.15"), "constant · 1.15");
        assert_eq!(detail(&["sum", "constant"], "1.15"), "sum · 1.15");
        assert_eq!(
            detail(&["square root", "negation"], "2.14"),
            "square root … · 2.14"
        );
    }

    #[test]
    fn earlier_values_and_ways_back_are_dashed() {
        let node = |name: &str| Node {
            name: name.into(),
            ..Node::default()
        };
        let nodes = [node("a<b"), node("c")];
        let text = svg(
            &nodes,
            &[edge(0, 1, false), edge(1, 1, true), edge(1, 0, false)],
            None,
        )
        .into_string();
        assert_eq!(text.matches("class=\"back\"").count(), 2);
        assert!(text.contains("a&lt;b") && !text.contains("a<b"));
    }
}
