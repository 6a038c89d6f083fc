//! The document of `compare --json` and the table for people.

mod support;

use cardan_compare::table::{Style, render};
use cardan_compare::{Chain, Comparison, Format, Frames, Node, Run, Series, Tolerance, compare};
use cardan_golden::Angles;
use cardan_outputs::{Outputs, StatusBit};
use cardan_spec::flags;
use cardan_units::HalfTurns;

const SOLUTIONS: usize = 20;

fn series(degrees: f64) -> Series {
    support::series_of((0..SOLUTIONS).map(|at| {
        Some(Angles {
            yaw: HalfTurns::from_degrees(degrees + at as f64),
            pitch: HalfTurns::from_degrees(degrees / 2.0),
            roll: HalfTurns::default(),
        })
    }))
}

fn comparison() -> Comparison {
    let native: Vec<i64> = (0..SOLUTIONS as i64).collect();
    let shared = Node {
        name: "tilt_x".into(),
        unit: "g".into(),
        per_solution: 1,
        format: Some(Format {
            word: 16,
            frac: 14,
            rounding: "nearest".into(),
            overflow: "saturate".into(),
        }),
        lsb: 1.0 / 16384.0,
        emulated: Some(native.clone()),
        real: Some(native.iter().map(|&raw| raw as f64 / 16384.0).collect()),
        golden: Some(
            native
                .iter()
                .map(|&raw| (raw as f64 + 0.4) / 16384.0)
                .collect(),
        ),
        native,
        expected: None,
        overflows: 0,
        allowance: None,
        tuned: None,
        tolerance: Some(Tolerance {
            max_abs: 0.000_05,
            reason: "one rounding".into(),
        }),
        ..Node::default()
    };
    let own = Node {
        name: "product".into(),
        golden: None,
        ..shared.clone()
    };
    let mut flags = vec![0; SOLUTIONS];
    flags[3] = (flags::HALF_SPACE | flags::YAW_HELD).into();
    let frames = vec![vec![1, 2, 0]; SOLUTIONS];
    Comparison {
        run: Run {
            app: "attitude".into(),
            scenario: "tumble".into(),
            seed: 1,
            session: "s".into(),
            seconds: 0.16,
            samples: 1280,
            solution_seconds: 0.008,
        },
        nodes: vec![shared, own],
        frames: Frames {
            native: frames.clone(),
            emulated: frames,
        },
        flags,
        outputs: Outputs {
            status: flags::NAMES
                .iter()
                .map(|&(mask, name)| StatusBit {
                    name: name.into(),
                    mask: mask.into(),
                })
                .collect(),
            group: Some(support::group()),
            ..Outputs::default()
        },
        chain: support::chain(
            [10.0, 10.1, 10.2, 10.3, 10.4, 10.41, 10.43, 10.43].map(series),
            Vec::new(),
        ),
        ..Comparison::default()
    }
}

/// Keys of the outermost object of a document, in order.
fn keys(json: &str) -> Vec<String> {
    let (mut keys, mut depth, mut rest) = (Vec::new(), 0, json);
    while let Some(character) = rest.chars().next() {
        match character {
            '{' | '[' => depth += 1,
            '}' | ']' => depth -= 1,
            '"' => {
                let end = 1 + rest[1..].find('"').unwrap();
                if depth == 1 && rest[end + 1..].starts_with(':') {
                    keys.push(rest[1..end].to_owned());
                }
                rest = &rest[end..];
            }
            _ => {}
        }
        rest = &rest[1..];
    }
    keys
}

fn begins_with(json: &serde_json::value::RawValue, expected: &[&str]) {
    let keys = keys(json.get());
    assert_eq!(keys[..expected.len().min(keys.len())], *expected);
}

/// Has these keys, in the order of the product's chain.
fn holds(json: &serde_json::value::RawValue, expected: &[&str]) {
    let keys = keys(json.get());
    for key in expected {
        assert!(keys.iter().any(|found| found == key), "{key} in {keys:?}");
    }
}

type Fields = std::collections::BTreeMap<String, Box<serde_json::value::RawValue>>;

fn fields(json: &serde_json::value::RawValue) -> Fields {
    serde_json::from_str(json.get()).unwrap()
}

#[test]
fn the_document_has_the_keys_of_the_contract_in_its_order() {
    let json = serde_json::to_string(&compare(&comparison())).unwrap();
    let document = serde_json::value::RawValue::from_string(json).unwrap();
    begins_with(
        &document,
        &[
            "verdict",
            "app",
            "scenario",
            "seed",
            "session",
            "seconds",
            "samples",
            "nodes",
            "attitude",
            "attitude_flagged",
            "error_budget",
            "emulator",
            "link",
        ],
    );
    let top = fields(&document);
    assert_eq!(top["verdict"].get(), "\"pass\"");
    let nodes: Vec<Box<serde_json::value::RawValue>> =
        serde_json::from_str(top["nodes"].get()).unwrap();
    begins_with(
        &nodes[0],
        &[
            "name",
            "unit",
            "format",
            "samples",
            "min",
            "max",
            "overflows",
            "golden_vs_native",
            "real_vs_native",
            "native_vs_emulated",
            "tolerance",
            "pass",
        ],
    );
    let node = fields(&nodes[0]);
    let metrics = [
        "max_abs",
        "rms",
        "bias",
        "sqnr_db",
        "max_lsb",
        "first_violation",
    ];
    begins_with(&node["golden_vs_native"], &metrics);
    begins_with(&node["real_vs_native"], &metrics);
    begins_with(
        &node["native_vs_emulated"],
        &["compared", "mismatches", "first_mismatch"],
    );
    begins_with(&node["format"], &["word", "frac", "rounding", "overflow"]);
    let sizes = ["rms_deg", "p99_deg", "max_deg", "samples"];
    for angle in ["roll", "pitch", "yaw", "total"] {
        begins_with(&fields(&top["attitude"])[angle], &sizes);
    }
    let flagged = fields(&top["attitude_flagged"]);
    assert_eq!(
        flagged.keys().collect::<Vec<_>>(),
        ["half_space", "yaw_held"]
    );
    begins_with(&fields(&flagged["half_space"])["total"], &sizes);
    holds(
        &top["error_budget"],
        &[
            "sensor_frontend",
            "latency",
            "adc",
            "algorithm",
            "rounding",
            "compiled",
        ],
    );
    begins_with(
        &top["emulator"],
        &[
            "cycles",
            "instructions",
            "realtime_factor",
            "cpu_load",
            "stack_peak",
            "late_conversions",
            "lost_conversions",
            "isr_latency_max_cycles",
        ],
    );
    begins_with(&top["link"], &["messages", "bytes", "lost"]);
}

#[test]
fn what_is_undefined_is_null_and_nothing_is_nan() {
    let mut comparison = comparison();
    comparison.nodes[0].golden.as_mut().unwrap()[2] = f64::NAN;
    comparison.emulator.realtime_factor = f64::INFINITY;
    comparison.chain = Chain::new(&support::STAGES, 3);
    let json = serde_json::to_value(compare(&comparison)).unwrap();
    assert_eq!(json["verdict"], "fail");
    assert!(json["nodes"][0]["golden_vs_native"]["max_abs"].is_null());
    assert!(json["nodes"][1]["golden_vs_native"].is_null());
    assert!(
        json["nodes"][1]["real_vs_native"]["sqnr_db"].is_null(),
        "no error at all"
    );
    assert_eq!(json["nodes"][1]["real_vs_native"]["max_abs"], 0.0);
    assert!(json["attitude"].is_null());
    assert!(json["error_budget"]["adc"].is_null());
    assert!(json["emulator"]["realtime_factor"].is_null());
    let violation = &json["nodes"][0]["golden_vs_native"]["first_violation"];
    assert_eq!(violation["sample"], 2);
    assert!(json["reasons"][0].as_str().unwrap().contains("node tilt_x"));
}

#[test]
fn the_budget_in_the_document_is_the_step_from_series_to_series() {
    let json = serde_json::to_value(compare(&comparison())).unwrap();
    let detail = &json["error_budget_detail"];
    for (index, (part, yaw)) in [
        ("latency", 0.1),
        ("motion", 0.1),
        ("sensor_frontend", 0.1),
        ("adc", 0.1),
        ("algorithm", 0.01),
        ("rounding", 0.02),
        ("compiled", 0.0),
    ]
    .iter()
    .enumerate()
    {
        assert_eq!(detail["parts"][index]["part"], *part);
        for figure in ["bias_deg", "rms_deg", "max_deg"] {
            let found = detail["parts"][index]["yaw"][figure].as_f64().unwrap();
            assert!((found - yaw).abs() < 1e-9, "{part} {figure} {found}");
        }
    }
    assert_eq!(json["error_budget"]["compiled"], 0.0);
    assert!(detail["closure_deg"].as_f64().unwrap() < 1e-9);
    assert_eq!(detail["closure_samples"], 19);
}

#[test]
fn the_table_fits_its_width_and_is_colourless_where_asked() {
    let mut comparison = comparison();
    comparison.nodes[0].tolerance.as_mut().unwrap().max_abs = 0.000_01;
    let report = compare(&comparison);
    for width in [60, 80, 100, 200] {
        let text = render(
            &report,
            Style {
                color: false,
                width,
            },
        );
        assert!(!text.contains('\u{1b}'));
        for line in text.lines() {
            assert!(line.chars().count() <= width, "{width}: {line}");
        }
        assert!(text.contains("tilt_x") && text.contains("FAIL"));
    }
    let wide = render(
        &report,
        Style {
            color: false,
            width: 200,
        },
    );
    assert!(wide.contains("SQNR dB") && wide.contains("product*"));
    let narrow = render(
        &report,
        Style {
            color: false,
            width: 60,
        },
    );
    // No column goes without a word.
    let titles = narrow.lines().nth(1).expect("titles");
    assert!(!titles.contains("SQNR dB"), "{titles}");
    let left_out = narrow.lines().find(|line| line.starts_with("left out: "));
    assert!(narrow.contains("SQNR dB") && left_out.is_some(), "{narrow}");
    let colourful = render(
        &report,
        Style {
            color: true,
            width: 100,
        },
    );
    assert!(colourful.contains("\u{1b}[1;31mFAIL\u{1b}[0m"));
    assert!(colourful.contains("\u{1b}[32mok\u{1b}[0m"));
}
