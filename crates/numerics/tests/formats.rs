//! Formats: from tables, files and mixtures; what is refused and what the refusal tells.

use cardan_datapath::{Format, NodeInfo, Overflow, Rounding, table_hash};
use cardan_firmware::FORMATS_HASH;
use cardan_firmware::nodes::{NODE_COUNT, NODES};
use cardan_numerics::Formats;

const DEPLOYED_FILE: &str = include_str!("../../../firmware/wordlengths.toml");

fn nodes(formats: [(u32, u32); 2]) -> [NodeInfo; 2] {
    let node = |name, (word, frac)| NodeInfo {
        name,
        unit: "1",
        meaning: "",
        format: Format {
            word,
            frac,
            rounding: Rounding::Floor,
            overflow: Overflow::Wrap,
        },
    };
    [node("first", formats[0]), node("second", formats[1])]
}

fn refusal(formats: [(u32, u32); 2]) -> String {
    Formats::deployed(&nodes(formats)).unwrap_err().to_string()
}

#[test]
fn the_deployed_file_gives_the_deployed_formats_and_their_hash() {
    let deployed = Formats::deployed(&NODES).unwrap();
    let file = Formats::from_wordlengths(DEPLOYED_FILE, "wordlengths.toml", &NODES).unwrap();
    assert_eq!(file, deployed);
    assert_eq!(table_hash(&file.table(&NODES).unwrap()), FORMATS_HASH);
}

#[test]
fn the_hash_follows_every_format_of_the_file() {
    let mut seen = std::collections::BTreeSet::from([FORMATS_HASH]);
    let tables = DEPLOYED_FILE.matches("[[node]]").count();
    assert_eq!(tables, NODE_COUNT);
    for index in 0..NODE_COUNT {
        let mut formats: Vec<Option<Format>> = NODES.iter().map(|node| Some(node.format)).collect();
        let format = formats[index].as_mut().unwrap();
        format.word -= 1;
        let changed = Formats::new(&NODES, formats)
            .unwrap()
            .table(&NODES)
            .unwrap();
        assert!(seen.insert(table_hash(&changed)), "node {index}");
    }
}

#[test]
fn a_prefix_keeps_the_first_formats_only() {
    let deployed = Formats::deployed(&NODES).unwrap();
    assert_eq!(deployed.prefix(0), Formats::real(NODE_COUNT));
    assert_eq!(deployed.prefix(NODE_COUNT), deployed);
    let some = deployed.prefix(5);
    for (index, node) in NODES.iter().enumerate() {
        assert_eq!(some.as_slice()[index], (index < 5).then_some(node.format));
    }
    assert!(some.table(&NODES).is_none());
    assert_eq!(some.len(), NODE_COUNT);
}

#[test]
fn words_beyond_64_bits_are_refused_with_the_node() {
    for (formats, part) in [
        ([(16, 3), (65, 0)], "'second': word = 65"),
        ([(0, 0), (16, 3)], "'first': word = 0"),
        ([(16, 65), (16, 3)], "frac = 65"),
    ] {
        let message = refusal(formats);
        assert!(
            message.contains(part) && message.contains("1 to 64"),
            "{message}"
        );
    }
}

#[test]
fn formats_whose_sum_exceeds_128_bits_are_refused_with_both_nodes() {
    assert!(Formats::deployed(&nodes([(64, 0), (64, 62)])).is_ok());
    let message = refusal([(64, 0), (64, 63)]);
    for part in [
        "'first' (64 integer bits)",
        "'second' (63 fractional bits)",
        "129 bits",
        "128",
    ] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn formats_for_another_number_of_nodes_are_refused() {
    let message = Formats::new(&NODES, vec![None]).unwrap_err().to_string();
    assert!(message.contains("1 formats for") && message.contains(&NODE_COUNT.to_string()));
}

#[test]
fn a_file_of_another_algorithm_is_refused_with_file_and_node() {
    let other = DEPLOYED_FILE.replace("\"tilt_x\"", "\"tilt\"");
    let message = Formats::from_wordlengths(&other, "mine.toml", &NODES)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("mine.toml") && message.contains("'tilt'"),
        "{message}"
    );
}
