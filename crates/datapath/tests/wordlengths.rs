//! Word-length files: what is read, and what each refusal tells.

use cardan_datapath::codegen::generate;
use cardan_datapath::wordlengths::{DeclaredNode, align, container_bits, parse, parse_all};
use cardan_datapath::{Format, NodeInfo, Overflow, Rounding};
use proptest::prelude::*;

const FILE: &str = "some/wordlengths.toml";

/// A node table with one key replaced, or dropped if `value` is empty.
fn node_with(key: &str, value: &str) -> String {
    let keys = [
        ("name", "\"tilt_x\""),
        ("unit", "\"g\""),
        ("word", "16"),
        ("frac", "14"),
        ("rounding", "\"nearest_up\""),
        ("overflow", "\"saturate\""),
    ];
    let mut text = String::from("[[node]]\n");
    for (known, usual) in keys {
        let value = if known == key { value } else { usual };
        if !value.is_empty() {
            text += &format!("{known} = {value}\n");
        }
    }
    text
}

/// The refusal names the file and has all of `parts`.
fn assert_refused(text: &str, parts: &[&str]) {
    let message = parse(text, FILE).expect_err(text).to_string();
    for part in [FILE].iter().chain(parts) {
        assert!(message.contains(part), "no '{part}' in: {message}");
    }
}

#[test]
fn a_format_out_of_range_is_refused_with_node_and_range() {
    assert_refused(
        &node_with("word", "0"),
        &["'tilt_x'", "word = 0", "1 to 64"],
    );
    assert_refused(
        &node_with("word", "65"),
        &["'tilt_x'", "word = 65", "1 to 64"],
    );
    assert_refused(
        &node_with("frac", "17"),
        &["'tilt_x'", "frac = 17", "0 to 16"],
    );
}

#[test]
fn an_unknown_mode_is_refused_with_the_known_ones() {
    assert_refused(
        &node_with("rounding", "\"nearest\""),
        &[
            "'tilt_x'",
            "\"nearest\"",
            "floor, ceil, zero, nearest_up, nearest_away, nearest_even",
        ],
    );
    assert_refused(
        &node_with("overflow", "\"clip\""),
        &["'tilt_x'", "\"clip\"", "wrap, saturate, trap"],
    );
}

#[test]
fn broken_toml_and_wrong_keys_are_refused_with_the_line() {
    assert_refused("[[node]\n", &["line 1"]);
    assert_refused(&node_with("word", "-3"), &["line 4", "-3"]);
    assert_refused(&node_with("word", "\"16\""), &["line 4", "string"]);
    assert_refused(&node_with("unit", ""), &["missing field `unit`"]);
    assert_refused(&(node_with("", "") + "bits = 3\n"), &["line 8", "bits"]);
    assert_refused("", &["missing field `node`"]);
    assert_refused("node = []", &["no nodes", "[[node]]"]);
}

#[test]
fn names_that_make_no_type_are_refused() {
    for name in [
        "Tilt", "1st", "tilt-x", "tilt__x", "tilt_", "_tilt", "tilt x", "",
    ] {
        assert_refused(
            &node_with("name", &format!("{name:?}")),
            &[&format!("'{name}'"), "lower case"],
        );
    }
    assert_refused(&node_with("name", "\"self\""), &["'self'", "reserves"]);
    let twice = node_with("", "") + &node_with("", "");
    assert_refused(&twice, &["'tilt_x'", "declared twice"]);
    let alike = node_with("name", "\"cos_1\"") + &node_with("name", "\"cos1\"");
    assert_refused(&alike, &["'cos1'", "'cos_1'", "rename"]);
}

#[test]
fn a_unit_is_one_line_of_text() {
    assert_refused(&node_with("unit", "\"\""), &["'tilt_x'", "unit"]);
    assert_refused(&node_with("unit", "\"g\\npub\""), &["'tilt_x'", "unit"]);
}

fn deployed() -> [NodeInfo; 2] {
    let format = Format::new(16, 14, Rounding::Floor, Overflow::Wrap);
    let node = |name, unit| NodeInfo {
        name,
        unit,
        meaning: "",
        format,
    };
    [node("tilt_x", "g"), node("angle", "half_turn")]
}

fn refusal_of(given: &str) -> String {
    align(&parse(given, FILE).unwrap(), &deployed(), FILE)
        .unwrap_err()
        .to_string()
}

#[test]
fn a_file_for_another_algorithm_is_refused_with_the_node() {
    let tilt = node_with("", "");
    let angle = node_with("name", "\"angle\"").replace("\"g\"", "\"half_turn\"");

    let missing = refusal_of(&tilt);
    assert!(
        missing.contains(FILE) && missing.contains("'angle' is missing"),
        "{missing}"
    );

    let unknown = refusal_of(&(tilt.clone() + &angle + &node_with("name", "\"gyro\"")));
    assert!(
        unknown.contains("'gyro'") && unknown.contains("tilt_x, angle"),
        "{unknown}"
    );

    let unit = refusal_of(&(tilt + &node_with("name", "\"angle\"")));
    assert!(unit.contains("'angle'") && unit.contains("\"g\"") && unit.contains("\"half_turn\""));
}

#[test]
fn formats_come_in_the_order_of_the_algorithm() {
    let angle = node_with("name", "\"angle\"").replace("\"g\"", "\"half_turn\"");
    let given = angle.replace("16", "24") + &node_with("", "");
    let formats = align(&parse(&given, FILE).unwrap(), &deployed(), FILE).unwrap();
    assert_eq!([formats[0].word, formats[1].word], [16, 24]);
}

fn any_node() -> impl Strategy<Value = DeclaredNode> {
    (
        "[a-z][a-z0-9]{0,6}(_[a-z0-9]{1,4}){0,2}",
        1u32..=64,
        0usize..6,
        0usize..3,
    )
        .prop_filter("reserved", |(name, ..)| name != "self")
        .prop_flat_map(|(name, word, rounding, overflow)| {
            (0..=container_bits(word)).prop_map(move |frac| DeclaredNode {
                name: name.clone(),
                unit: "m/s\u{b2} \"q\"".to_string(),
                meaning: "it's \"so\" \\ so".to_string(),
                format: Format::new(
                    word,
                    frac,
                    Rounding::ALL[rounding].0,
                    Overflow::ALL[overflow].0,
                ),
            })
        })
}

proptest! {
    #[test]
    fn what_a_file_declares_is_read_and_generated(node in any_node()) {
        let f = node.format;
        let text = format!(
            "[[node]]\nname = {:?}\nunit = {:?}\nmeaning = {:?}\nword = {}\nfrac = {}\nrounding = {:?}\noverflow = {:?}\n",
            node.name, node.unit, node.meaning, f.word, f.frac, f.rounding.name(), f.overflow.name()
        );
        prop_assert_eq!(&parse(&text, FILE).unwrap(), std::slice::from_ref(&node));
        let source = generate(std::slice::from_ref(&node));
        let format = format!(
            "Format::new({}, {}, ::cardan_datapath::Rounding::{:?}, ::cardan_datapath::Overflow::{:?})",
            f.word, f.frac, f.rounding, f.overflow
        );
        prop_assert!(source.contains(&format), "{}", source);
        let word = format!("FixedI{}<::cardan_datapath::fixed::types::extra::U{}>", container_bits(f.word), f.frac);
        prop_assert!(source.contains(&word), "{}", source);
        prop_assert!(source.contains(&format!("meaning: {:?}", node.meaning)), "{}", source);
    }
}

const NODE: &str = "[[node]]\nname = \"y\"\nunit = \"1\"\nword = 16\nfrac = 15\nrounding = \"floor\"\noverflow = \"saturate\"\n";

#[test]
fn what_formats_were_tuned_to_is_kept() {
    let table = "[tuned]\ncommand = \"cardan tune\"\nbudget = [\"y.rms<=0.02\", \"flags<=0.01\"]\n\
                 reached = [0.019, nan]\ntuned_on = [\"tumble, seed 1\"]\nverified_on = [\"tumble, seed 4\"]\n\
                 verified = true\nconfidence = 0.95\ncontent = 0.9\nassumptions = [\"port 0: -512 to 511\"]\n\
                 [[tuned.tolerance]]\nnode = \"y\"\nmax = 0.5\nrms = 0.25\nbias = 0.0\n";
    let read = parse_all(&format!("{table}{NODE}"), "t.toml").expect("is accepted");
    assert_eq!(read.nodes, parse(NODE, "t.toml").expect("is accepted"));
    let tuned = read.tuned.expect("is kept");
    assert_eq!(tuned.budget, ["y.rms<=0.02", "flags<=0.01"]);
    assert!(tuned.reached[0] == 0.019 && tuned.reached[1].is_nan());
    assert!(tuned.verified);
    assert_eq!((tuned.confidence, tuned.content), (0.95, 0.9));
    assert_eq!(tuned.tuned_on, ["tumble, seed 1"]);
    assert_eq!(tuned.verified_on, ["tumble, seed 4"]);
    assert_eq!(tuned.assumptions, ["port 0: -512 to 511"]);
    let tolerance = &tuned.tolerance[0];
    assert_eq!(
        (tolerance.node.as_str(), tolerance.max, tolerance.rms),
        ("y", 0.5, 0.25)
    );
    assert_eq!(parse_all(NODE, "t.toml").expect("is accepted").tuned, None);
}

#[test]
fn a_table_of_tuning_that_does_not_agree_is_refused() {
    let told = |table: &str| {
        let text = format!("[tuned]\n{table}\n{NODE}");
        parse_all(&text, "t.toml")
            .expect_err("is refused")
            .to_string()
    };
    assert!(told("verified = true").contains("missing field `budget`"));
    assert!(told("verified = true\nbudget = []").contains("t.toml: [tuned]: budget"));
    let good = "verified = true\nbudget = [\"y.rms<=1\"]\n";
    assert!(told(&format!("{good}colour = 1")).contains("unknown field `colour`"));
    assert!(told(&format!("{good}reached = [1.0, 2.0]")).contains("2 values for 1"));
    assert!(told(&format!("{good}confidence = 1.0")).contains("confidence = 1"));
    assert!(told(&format!("{good}content = nan")).contains("content = NaN"));
    let tolerance = |node: &str, max: &str| {
        told(&format!(
            "{good}[[tuned.tolerance]]\nnode = \"{node}\"\nmax = {max}\nrms = 0.0\nbias = 0.0"
        ))
    };
    assert!(tolerance("z", "1.0").contains("node 'z' is not in this file"));
    assert!(tolerance("y", "inf").contains("max = inf"));
    assert!(tolerance("y", "-1.0").contains("max = -1"));
}
