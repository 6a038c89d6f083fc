//! Which reason is named first: the cause, whatever the order of the table.

use cardan_compare::table::{Style, render};
use cardan_compare::{
    Comparison, Format, Frames, Node, NodeInput, NodeStatus, Reason, Tolerance, Verdict, compare,
};

const LSB: f64 = 1.0 / 1024.0;
const SOLUTIONS: usize = 8;

/// A node without a golden model, in the format 1.10.
fn node(name: &str, position: usize, inputs: &[(&str, bool)]) -> Node {
    let native: Vec<i64> = (0..SOLUTIONS as i64).map(|k| 50 * k - 200).collect();
    Node {
        name: name.into(),
        unit: "1".into(),
        per_solution: 1,
        format: Some(Format {
            word: 11,
            frac: 10,
            rounding: "floor".into(),
            overflow: "saturate".into(),
        }),
        lsb: LSB,
        emulated: Some(native.clone()),
        real: Some(native.iter().map(|&raw| raw as f64 * LSB).collect()),
        native,
        inputs: inputs
            .iter()
            .map(|&(node, earlier)| NodeInput {
                node: node.into(),
                earlier,
            })
            .collect(),
        position: Some(position),
        tolerance: Some(Tolerance {
            max_abs: 0.5 * LSB,
            reason: "one rounding".into(),
        }),
        ..Node::default()
    }
}

/// a -> b -> c -> b of the next solution; the table lists them the other way round.
fn run() -> Comparison {
    let frames: Vec<Vec<u8>> = (0..SOLUTIONS as u8).map(|index| vec![index, 0]).collect();
    Comparison {
        nodes: vec![
            node("c", 2, &[("b", false)]),
            node("b", 1, &[("a", false), ("c", true)]),
            node("a", 0, &[]),
        ],
        frames: Frames {
            native: frames.clone(),
            emulated: frames,
        },
        flags: vec![0; SOLUTIONS],
        ..Comparison::default()
    }
}

/// Moves the real interpretation of a node away from native from a solution on.
fn spoil(comparison: &mut Comparison, name: &str, from: usize) {
    let node = comparison
        .nodes
        .iter_mut()
        .find(|node| node.name == name)
        .unwrap();
    for value in &mut node.real.as_mut().unwrap()[from..] {
        *value += 3.0 * LSB;
    }
}

fn first(comparison: &Comparison) -> String {
    let report = compare(comparison);
    assert_eq!(report.verdict, Verdict::Fail);
    report.reasons[0].to_string()
}

#[test]
fn of_nodes_that_fail_in_one_solution_the_one_that_the_others_are_made_of_comes_first() {
    let mut comparison = run();
    for name in ["c", "b", "a"] {
        spoil(&mut comparison, name, 3);
    }
    assert!(
        first(&comparison).starts_with("node a: "),
        "{}",
        first(&comparison)
    );
}

#[test]
fn a_node_that_is_used_again_fails_where_its_write_is_and_not_where_it_is_used_first() {
    // a is written before and after b: its first write is right, its second is made of b.
    let mut comparison = run();
    comparison.nodes[2].inputs = vec![NodeInput {
        node: "b".into(),
        earlier: false,
    }];
    let a = &mut comparison.nodes[2];
    a.per_solution = 2;
    a.writes = vec![0, 5];
    a.native = (0..2 * SOLUTIONS as i64).collect();
    a.emulated = Some(a.native.clone());
    a.real = Some(a.native.iter().map(|&raw| raw as f64 * LSB).collect());
    a.real.as_mut().unwrap()[1] += 3.0 * LSB;
    comparison.nodes[1].writes = vec![2];
    spoil(&mut comparison, "b", 0);
    assert!(
        first(&comparison).starts_with("node b: "),
        "{}",
        first(&comparison)
    );
    comparison.nodes[2].real.as_mut().unwrap()[0] += 3.0 * LSB;
    assert!(
        first(&comparison).starts_with("node a: "),
        "{}",
        first(&comparison)
    );
}

#[test]
fn a_node_that_fails_earlier_is_not_explained_by_one_that_fails_later() {
    let mut comparison = run();
    spoil(&mut comparison, "a", 5);
    spoil(&mut comparison, "c", 2);
    assert!(
        first(&comparison).starts_with("node c: "),
        "{}",
        first(&comparison)
    );
    // Through the solution before, c explains b.
    let mut comparison = run();
    spoil(&mut comparison, "c", 2);
    spoil(&mut comparison, "b", 3);
    assert!(
        first(&comparison).starts_with("node c: "),
        "{}",
        first(&comparison)
    );
}

#[test]
fn differing_bits_are_named_by_the_first_in_time_then_in_the_data_flow() {
    let mut comparison = run();
    comparison.nodes[0].emulated.as_mut().unwrap()[1] ^= 1;
    comparison.nodes[2].emulated.as_mut().unwrap()[1] ^= 1;
    assert!(
        first(&comparison).starts_with("node a: native and emulated"),
        "{}",
        first(&comparison)
    );
    comparison.nodes[1].emulated.as_mut().unwrap()[0] ^= 1;
    assert!(
        first(&comparison).starts_with("node b: native and emulated"),
        "{}",
        first(&comparison)
    );
}

/// Makes a node saturate from a solution on, as a word that is too short would.
fn saturate(comparison: &mut Comparison, name: &str, from: usize) {
    let node = comparison
        .nodes
        .iter_mut()
        .find(|node| node.name == name)
        .unwrap();
    node.overflows = (SOLUTIONS - from) as u64;
    for at in from..SOLUTIONS {
        node.native[at] = 1023;
        node.emulated.as_mut().unwrap()[at] = 1023;
        node.real.as_mut().unwrap()[at] = 1.5;
    }
}

#[test]
fn a_node_that_saturates_says_so_first_and_explains_what_is_made_of_it() {
    let mut comparison = run();
    saturate(&mut comparison, "b", 2);
    spoil(&mut comparison, "c", 2);
    let report = compare(&comparison);
    assert!(matches!(&report.reasons[0], Reason::Overflows { node, count: 6, .. } if node == "b"));
    let text = report.reasons[0].to_string();
    assert!(
        text.contains("saturates 6 times") && text.contains("solution 2"),
        "{text}"
    );
    assert_eq!(report.nodes[1].status, NodeStatus::Fail);
}

#[test]
fn a_node_that_saturates_is_never_ok_even_where_its_limit_allows_it() {
    let mut comparison = run();
    saturate(&mut comparison, "b", 2);
    comparison.nodes[1].tolerance.as_mut().unwrap().max_abs = 1.0;
    let report = compare(&comparison);
    assert_eq!(report.verdict, Verdict::Pass);
    assert_eq!(report.nodes[1].status, NodeStatus::Saturates);
    let wide = render(
        &report,
        Style {
            color: false,
            width: 200,
        },
    );
    let row = wide.lines().find(|line| line.starts_with("b*")).unwrap();
    assert!(row.ends_with("sat") && row.contains('6'), "{row}");
    // Where their column has no room, overflows stand below the table.
    let narrow = render(
        &report,
        Style {
            color: false,
            width: 48,
        },
    );
    assert!(
        narrow.contains("overflows: b 6 (saturates)") && narrow.contains("left out: "),
        "{narrow}"
    );
}

#[test]
fn an_unjudged_node_that_saturates_is_named_where_the_run_fails_otherwise() {
    let mut comparison = run();
    saturate(&mut comparison, "b", 2);
    comparison.nodes[1].tolerance = None;
    assert_eq!(compare(&comparison).verdict, Verdict::Pass);
    spoil(&mut comparison, "c", 2);
    assert!(
        first(&comparison).starts_with("node b: saturates"),
        "{}",
        first(&comparison)
    );
}

#[test]
fn angles_wrap_and_other_units_do_not() {
    let mut comparison = run();
    for node in &mut comparison.nodes {
        node.overflows = 5;
        node.format.as_mut().unwrap().overflow = "wrap".into();
    }
    comparison.nodes[0].unit = "half_turn".into();
    let report = compare(&comparison);
    assert_eq!(report.nodes[0].status, NodeStatus::Ok);
    assert_eq!(report.nodes[1].status, NodeStatus::Wraps);
    // An angle whose word is less than a turn does not come back where it should.
    comparison.nodes[0].format.as_mut().unwrap().word = 10;
    assert_eq!(compare(&comparison).nodes[0].status, NodeStatus::Wraps);
}

#[test]
fn a_stale_image_is_the_first_reason_of_a_run_that_fails_and_a_note_on_one_that_passes() {
    let mut comparison = run();
    comparison.stale = Some("made of other sources".into());
    let report = compare(&comparison);
    assert_eq!(report.verdict, Verdict::Pass);
    let text = render(
        &report,
        Style {
            color: false,
            width: 100,
        },
    );
    assert!(text.contains("note: made of other sources"), "{text}");
    spoil(&mut comparison, "a", 0);
    assert_eq!(first(&comparison), "image: made of other sources");
}
