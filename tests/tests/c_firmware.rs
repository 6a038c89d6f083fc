//! Firmware in C (`firmware/c`), built as its README says, against the native firmware.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use cardan_tests::program::{folder, text};
use cardan_tests::{root, run, stderr};
use serde_json::Value;
use tempfile::TempDir;

const SOURCES: &str = "firmware/c";
/// Voltages of an attitude of the bundled tumble: its tilt is 46 degrees.
const VOLTAGES: [(u8, f64); 4] = [(0, 2.0), (1, 3.92), (2, 2.35), (3, 1.87)];
/// The warm-up and 30 solutions.
const CYCLES: &str = "5376000";

/// A copy of the sources, in which `change` may alter a file.
fn copy(change: impl Fn(&str, String) -> String) -> TempDir {
    let folder = folder();
    for entry in fs::read_dir(root().join(SOURCES)).expect("the folder is there") {
        let path = entry.expect("readable").path();
        if path.extension().is_some_and(|end| end == "elf") {
            continue;
        }
        let name = path
            .file_name()
            .expect("a file")
            .to_string_lossy()
            .into_owned();
        let content = fs::read_to_string(&path).expect("sources are text");
        fs::write(folder.path().join(&name), change(&name, content)).expect("the folder is ours");
    }
    folder
}

fn unchanged() -> TempDir {
    copy(|_, content| content)
}

/// The hash in `nodes.h`, and another.
fn hashes() -> (String, String) {
    let nodes = fs::read_to_string(root().join(SOURCES).join("nodes.h")).expect("the header");
    let start = nodes.find("_HASH 0x").expect("a hash") + "_HASH 0x".len();
    let hash = nodes[start..start + 16].to_owned();
    let last = if hash.ends_with('0') { '1' } else { '0' };
    let other = format!("{}{last}", &hash[..15]);
    (hash, other)
}

/// Runs the README's command that makes `image`, warnings being errors.
fn build(folder: &TempDir, image: &str) -> Output {
    let readme = fs::read_to_string(folder.path().join("README.md")).expect("the README is there");
    let made = format!("-o {image} ");
    let line = readme
        .lines()
        .find(|line| line.starts_with("avr-gcc ") && line.contains(&made))
        .unwrap_or_else(|| panic!("the README does not say how {image} is made"));
    Command::new("sh")
        .current_dir(folder.path())
        .args(["-c", &line.replacen("avr-gcc ", "avr-gcc -Werror ", 1)])
        .output()
        .expect("a shell starts")
}

fn built(folder: &TempDir, image: &str) -> PathBuf {
    let output = build(folder, image);
    assert!(
        output.status.success(),
        "{} (avr-gcc missing? apt-get install gcc-avr binutils-avr avr-libc)",
        stderr(&output)
    );
    folder.path().join(image)
}

/// Compares 25 solutions; the exit code and the document.
fn compare(elf: &Path) -> (Option<i32>, Value) {
    compare_with(elf, &["--seconds", "0.3"])
}

fn compare_with(elf: &Path, more: &[&str]) -> (Option<i32>, Value) {
    let arguments = ["compare", "--json", "--quiet", "--firmware", text(elf)];
    let output = run(&[&arguments[..], more].concat());
    let document = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", stderr(&output)));
    (output.status.code(), document)
}

fn mismatches(document: &Value) -> Vec<String> {
    let nodes = document["nodes"].as_array().expect("an array");
    assert!(nodes.len() > 60, "{} nodes", nodes.len());
    nodes
        .iter()
        .filter(|node| node["native_vs_emulated"]["mismatches"] != 0)
        .map(|node| node["name"].as_str().expect("a name").to_owned())
        .collect()
}

#[test]
fn the_attitude_in_c_is_bit_for_bit_the_native_firmware_on_its_schedule() {
    let folder = unchanged();
    let (code, document) = compare(&built(&folder, "attitude.elf"));
    assert_eq!(code, Some(0), "{document:#}");
    assert_eq!(document["verdict"], "pass");
    let nodes = document["nodes"].as_array().expect("an array");
    assert!(nodes.len() > 60, "{} nodes", nodes.len());
    for node in nodes {
        let bits = &node["native_vs_emulated"];
        assert_eq!(bits["mismatches"], 0, "{}", node["name"]);
        assert!(bits["compared"].as_u64() >= Some(20), "{}", node["name"]);
    }
    assert_eq!(document["emulator"]["late_conversions"], 0);
    assert_eq!(document["error_budget"]["compiled"], 0.0);
}

#[test]
fn the_attitude_in_c_has_every_bit_and_flag_also_upside_down_and_beside_a_magnet() {
    let folder = unchanged();
    let elf = built(&folder, "attitude.elf");
    let tumble = ["motion.tumble.tilt_deg=180", "motion.tumble.tilt_hz=2"];
    let over = ["--set", tumble[0], "--set", tumble[1], "--seconds", "1"];
    let fitted = [&over[..], &["--set", "sensors.third_tilt=true"]].concat();
    let magnet = ["--scenario", "magnet", "--seconds", "6"];
    for more in [&over[..], &fitted, &magnet] {
        let (code, document) = compare_with(&elf, more);
        assert_eq!(code, Some(0), "{more:?}");
        let count = |key: &str| document[key].as_u64().expect("a count");
        assert!(
            count("unflagged_solutions") < count("solutions"),
            "{more:?}"
        );
        assert_eq!(document["frames"]["mismatches"], 0, "{more:?}");
        assert!(mismatches(&document).is_empty(), "{more:?}");
    }
}

#[test]
fn a_changed_coefficient_fails_and_the_first_nodes_it_reaches_are_named() {
    let folder = copy(|name, content| match name {
        "attitude.c" => {
            let changed = content.replace("FIXED(0.3182367", "FIXED(0.3183367");
            assert_ne!(changed, content);
            changed
        }
        _ => content,
    });
    let (code, document) = compare(&built(&folder, "attitude.elf"));
    assert_eq!(code, Some(1));
    assert_eq!(document["verdict"], "fail");
    let wrong = mismatches(&document);
    for name in ["asin_sum", "octant", "pitch"] {
        assert!(wrong.iter().any(|wrong| wrong == name), "{name}: {wrong:?}");
    }
    for name in ["accumulator", "tilt_x", "asin_square", "asin_term"] {
        assert!(
            !wrong.iter().any(|wrong| wrong == name),
            "{name}: {wrong:?}"
        );
    }
}

#[test]
fn a_third_axis_that_is_never_read_counts_as_lost_conversions() {
    let folder = copy(|name, content| match name {
        "device.c" => {
            let changed = content.replace("ACSR & _BV(ACO) ? -1 : 1", "1");
            assert_ne!(changed, content);
            changed
        }
        _ => content,
    });
    let more = ["--seconds", "0.3", "--set", "sensors.third_tilt=true"];
    let (code, document) = compare_with(&built(&folder, "attitude.elf"), &more);
    assert_eq!(code, Some(1));
    let solutions = document["solutions"].as_u64().expect("a count");
    assert!(solutions > 20, "{solutions}");
    assert_eq!(document["emulator"]["lost_conversions"], solutions);
    assert!(mismatches(&document).is_empty(), "the device is upright");
}

#[test]
fn a_node_that_is_not_published_fails() {
    let folder = copy(|name, content| match name {
        "attitude.c" => {
            let changed = content.replace("publish(NODE_PITCH, ", "(");
            assert_ne!(changed, content);
            changed
        }
        _ => content,
    });
    let (code, document) = compare(&built(&folder, "attitude.elf"));
    assert_eq!(code, Some(1));
    let solutions = document["solutions"].as_u64().expect("a count");
    assert!(solutions > 20, "{solutions}");
    assert_eq!(
        document["reasons"][0],
        format!("node pitch: lengths differ, native {solutions}, emulated 0")
    );
    assert_eq!(mismatches(&document), ["pitch"]);
}

#[test]
fn without_taps_frames_alone_are_compared_and_the_report_says_so() {
    let folder = unchanged();
    let plain = built(&folder, "plain.elf");
    let (code, document) = compare(&plain);
    assert_eq!(code, Some(0), "{document:#}");
    assert_eq!(document["taps"], false);
    assert!(document["frames"]["compared"].as_u64() >= Some(20));
    let nodes = document["nodes"].as_array().expect("an array");
    assert!(nodes.len() > 60, "{} nodes", nodes.len());
    for node in nodes {
        assert!(node["native_vs_emulated"].is_null(), "{}", node["name"]);
    }
    let output = run(&["compare", "--seconds", "0.3", "--firmware", text(&plain)]);
    let table = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(table.contains("no taps"), "{table}");
}

#[test]
fn other_formats_do_not_compile_before_the_code_is_adapted() {
    let (hash, other) = hashes();
    let folder = copy(|name, content| match name {
        "nodes.h" => content.replace(&hash, &other),
        _ => content,
    });
    let output = build(&folder, "attitude.elf");
    assert!(!output.status.success());
    assert!(
        stderr(&output).contains("other formats"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn an_image_in_other_formats_than_the_native_firmware_is_refused_with_both_sides() {
    let (hash, other) = hashes();
    let folder = copy(|name, content| match name {
        "nodes.h" | "attitude.c" => content
            .replace(&hash, &other)
            .replace("X(TILT_X, 16, 14,", "X(TILT_X, 16, 13,"),
        _ => content,
    });
    let elf = built(&folder, "attitude.elf");
    let output = run(&["compare", "--quiet", "--firmware", text(&elf)]);
    assert_eq!(output.status.code(), Some(2));
    for part in ["tilt_x", "13 fractional", "14 fractional"] {
        assert!(stderr(&output).contains(part), "{}", stderr(&output));
    }
}

#[test]
fn floating_point_takes_more_than_four_times_the_cycles_of_the_reference_image() {
    let folder = unchanged();
    let float = cycles_per_solution(&built(&folder, "attitude_float.elf"), &folder);
    let reference = root().join("firmware/boards/atmega328p/images/plain.elf");
    let reference = cycles_per_solution(&reference, &folder);
    assert!(
        float > 4.0 * reference,
        "{float} cycles against {reference} per solution"
    );
}

/// The mean time for which PB5 is high.
fn cycles_per_solution(elf: &Path, folder: &TempDir) -> f64 {
    const PS_PER_CYCLE: u64 = 62_500;
    let dump = folder.path().join("solving.vcd");
    let volts = VOLTAGES.map(|(channel, volts)| format!("--adc={channel}={volts}"));
    let arguments = [
        "run",
        text(elf),
        "--quiet",
        "--uart",
        "none",
        "--cycles",
        CYCLES,
        "--vcd",
        text(&dump),
        "--vcd-signal",
        "PB5",
    ];
    let output = run(&[&arguments[..], &volts.each_ref().map(String::as_str)[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let dump = fs::read(dump).expect("the dump is there");
    let (mut now, mut risen, mut spans) = (0, None, Vec::new());
    for command in vcd::Parser::new(&dump[..]) {
        match command.expect("a sound dump") {
            vcd::Command::Timestamp(time) => now = time,
            vcd::Command::ChangeScalar(_, vcd::Value::V1) => risen = Some(now),
            vcd::Command::ChangeScalar(_, vcd::Value::V0) => {
                spans.extend(risen.take().map(|risen| now - risen));
            }
            _ => {}
        }
    }
    assert!(spans.len() >= 20, "{} solutions", spans.len());
    spans.iter().sum::<u64>() as f64 / (spans.len() as u64 * PS_PER_CYCLE) as f64
}
