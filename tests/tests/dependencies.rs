//! Dependencies point one way: the edges that would let a mistake hide are forbidden.

use std::collections::{BTreeMap, BTreeSet};

use cargo_metadata::{DependencyKind, MetadataCommand};

/// Direct dependencies among the workspace's packages, without development and build ones.
fn edges() -> BTreeMap<String, BTreeSet<String>> {
    let manifest = cardan_tests::root().join("Cargo.toml");
    let metadata = MetadataCommand::new()
        .manifest_path(manifest)
        .exec()
        .expect("cargo metadata");
    let members: BTreeSet<String> = metadata
        .workspace_packages()
        .iter()
        .map(|package| package.name.to_string())
        .collect();
    let mut edges = BTreeMap::new();
    for package in metadata.workspace_packages() {
        let direct = package
            .dependencies
            .iter()
            .filter(|dependency| dependency.kind == DependencyKind::Normal)
            .map(|dependency| dependency.name.clone())
            .filter(|name| members.contains(name))
            .collect();
        edges.insert(package.name.to_string(), direct);
    }
    edges
}

/// Everything that `from` reaches.
fn reached(edges: &BTreeMap<String, BTreeSet<String>>, from: &str) -> BTreeSet<String> {
    assert!(
        edges.contains_key(from),
        "{from} is not a package of the workspace"
    );
    let mut seen = BTreeSet::new();
    let mut next = vec![from.to_owned()];
    while let Some(package) = next.pop() {
        for dependency in &edges[&package] {
            if seen.insert(dependency.clone()) {
                next.push(dependency.clone());
            }
        }
    }
    seen
}

/// Asserts that `from` reaches no package outside `allowed`; a name that does not exist is an error,
/// so that a misspelt rule cannot pass.
fn reaches_only(from: &str, allowed: &[&str]) {
    let edges = edges();
    for name in allowed {
        assert!(
            edges.contains_key(*name),
            "{name} is not a package of the workspace"
        );
    }
    for package in reached(&edges, from) {
        assert!(
            allowed.contains(&package.as_str()),
            "{from} must not reach {package}"
        );
    }
}

#[test]
fn the_firmware_uses_only_units_spec_and_datapath() {
    reaches_only(
        "cardan-firmware",
        &["cardan-units", "cardan-spec", "cardan-datapath"],
    );
}

#[test]
fn the_emulator_knows_nothing_of_the_product() {
    reaches_only("cardan-emulator", &[]);
    reaches_only("cardan-translator", &["cardan-emulator"]);
}

#[test]
fn golden_and_firmware_meet_only_in_units_and_spec() {
    reaches_only("cardan-golden", &["cardan-units", "cardan-spec"]);
    reaches_only("cardan-calibrate", &["cardan-units", "cardan-spec"]);
    let edges = edges();
    let golden = reached(&edges, "cardan-golden");
    let firmware = reached(&edges, "cardan-firmware");
    let common: Vec<_> = golden.intersection(&firmware).collect();
    assert_eq!(common, ["cardan-spec", "cardan-units"]);
}

#[test]
fn the_analog_side_knows_neither_firmware_nor_emulator() {
    let upstream = [
        "cardan-units",
        "cardan-spec",
        "cardan-scenario",
        "cardan-sensors",
    ];
    reaches_only("cardan-scenario", &upstream[..2]);
    reaches_only("cardan-sensors", &upstream[..3]);
    reaches_only("cardan-frontend", &upstream);
}

#[test]
fn leaves_are_leaves_and_link_knows_no_product() {
    reaches_only("cardan-units", &[]);
    reaches_only("cardan-spec", &["cardan-units"]);
    reaches_only("cardan-datapath", &[]);
    reaches_only("cardan-link", &[]);
    reaches_only("cardan-page", &[]);
    reaches_only("cardan-outputs", &[]);
}

#[test]
fn what_judges_knows_neither_models_nor_firmware_nor_product() {
    reaches_only("cardan-compare", &["cardan-outputs", "cardan-page"]);
    let tune = ["cardan-datapath", "cardan-numerics", "cardan-page"];
    reaches_only("cardan-numerics", &tune[..1]);
    reaches_only("cardan-tune", &tune);
}

/// Words of our product: its angles, channels and flags. A tool crate that names one is wired to it.
const PRODUCT: [&str; 12] = [
    "attitude",
    "attitudes",
    "yaw",
    "pitch",
    "roll",
    "tilt",
    "tilt_x",
    "field_x",
    "third_tilt",
    "magnetometer",
    "half_space",
    "disturbed",
];

/// Lines of a crate's sources, without comments and tests, that name a word of the product.
fn naming(folder: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut open = vec![cardan_tests::root().join(folder)];
    while let Some(path) = open.pop() {
        if path.is_dir() {
            let entries = std::fs::read_dir(&path).expect("a folder of sources");
            open.extend(entries.map(|entry| entry.expect("readable").path()));
            continue;
        }
        if path.extension().is_none_or(|end| end != "rs") {
            continue;
        }
        let text = std::fs::read_to_string(&path).expect("sources are text");
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for line in code
            .lines()
            .filter(|line| !line.trim_start().starts_with("//"))
        {
            let words = line.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
            if words
                .map(str::to_ascii_lowercase)
                .any(|word| PRODUCT.contains(&word.as_str()))
            {
                found.push(format!("{}: {}", path.display(), line.trim()));
            }
        }
    }
    found
}

#[test]
fn the_tool_names_no_angle_channel_or_flag_of_the_product() {
    // The one key that every document has, whatever the product (`crates/compare/src/report.rs`).
    let is_contract = |line: &String| line.ends_with("const ALWAYS: &str = \"attitude\";");
    for tool in [
        "compare", "link", "outputs", "page", "numerics", "tune", "datapath", "units",
    ] {
        let named = naming(&format!("crates/{tool}/src"));
        let named: Vec<String> = named
            .into_iter()
            .filter(|line| !is_contract(line))
            .collect();
        assert!(
            named.is_empty(),
            "{tool} names words of the product:\n{}",
            named.join("\n")
        );
    }
    // The rule sees such words where they are.
    assert!(naming("golden/src").len() > 20);
    assert!(naming("crates/bench/src/attitude").len() > 20);
}

#[test]
fn nothing_depends_on_the_command_line_and_only_link_names_iceoryx2() {
    let edges = edges();
    for (package, direct) in &edges {
        assert!(
            !direct.contains("cardan"),
            "{package} depends on the command line"
        );
    }
    let manifest = cardan_tests::root().join("Cargo.toml");
    let metadata = MetadataCommand::new()
        .manifest_path(manifest)
        .exec()
        .expect("cargo metadata");
    let users: Vec<String> = metadata
        .workspace_packages()
        .iter()
        .filter(|package| {
            package
                .dependencies
                .iter()
                .any(|d| d.name.starts_with("iceoryx2"))
        })
        .map(|package| package.name.to_string())
        .collect();
    assert_eq!(users, ["cardan-link"]);
}

#[test]
fn the_rule_itself_would_notice_a_forbidden_edge() {
    let edges = edges();
    // Positive control: the bench does reach both sides, so the search finds edges where they are.
    let bench = reached(&edges, "cardan-bench");
    for package in [
        "cardan-golden",
        "cardan-firmware",
        "cardan-emulator",
        "cardan-sensors",
    ] {
        assert!(
            bench.contains(package),
            "{package} should be reached from the bench"
        );
    }
}
