//! `compare --corners` as a user runs it: yield, worst corner, reproduction, bad input.

use std::fs;
use std::process::Output;

use cardan_tests::{run, stderr};
use serde_json::Value;
use tempfile::TempDir;

const FILE: &str = r#"
[[corner]]
name = "hot"
set = { "climate.start_k" = 303.15, "climate.end_k" = 303.15 }

[spread]
"sensors.accelerometer.offset_x_mg" = { sigma = 20.0 }
"frontend.gain_error" = { range = 0.01 }
"#;

fn corners(text: &str, more: &[&str]) -> Output {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("corners.toml");
    fs::write(&file, text).expect("written");
    let file = file.to_string_lossy();
    let fixed = ["compare", "--quiet", "--seconds", "0.2", "--corners", &file];
    run(&[&fixed[..], more].concat())
}

fn document(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(output)))
}

#[test]
fn corners_and_units_are_compared_in_order_whatever_the_number_of_jobs() {
    let [one, three] = ["1", "3"].map(|jobs| {
        let output = corners(FILE, &["--json", "--mc", "3", "--jobs", jobs]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let mut document = document(&output);
        document["corners"] = Value::Null;
        document
    });
    assert_eq!(one, three);
    let runs = one["runs"].as_array().expect("an array");
    let names: Vec<&str> = runs.iter().filter_map(|run| run["name"].as_str()).collect();
    assert_eq!(names, ["nominal", "hot", "mc-0", "mc-1", "mc-2"]);
    assert_eq!(one["yield"]["units"], 3);
    assert_eq!(one["yield"]["passed"], 3);
    assert_eq!(runs[1]["set"]["climate.start_k"], 303.15);
    let seeds: Vec<u64> = runs.iter().filter_map(|run| run["seed"].as_u64()).collect();
    assert_eq!(seeds, [1, 1, 2, 3, 4]);
    let offsets: Vec<f64> = runs[2..]
        .iter()
        .filter_map(|run| run["set"]["sensors.accelerometer.offset_x_mg"].as_f64())
        .collect();
    assert!(offsets.len() == 3 && offsets[0] != offsets[1] && offsets[1] != offsets[2]);
}

#[test]
fn the_worst_corner_is_run_again_by_the_command_that_is_printed() {
    let found = document(&corners(FILE, &["--json", "--mc", "2"]));
    let worst = &found["runs"][found["worst"].as_u64().expect("an index") as usize];
    let rms = |run: &Value| run["rms_deg"].as_f64().expect("a number");
    let runs = found["runs"].as_array().expect("an array");
    assert!(runs.iter().all(|run| rms(run) <= rms(worst)));
    let command = worst["reproduce"].as_str().expect("text");
    let arguments: Vec<&str> = command.split(' ').skip(1).collect();
    let again = document(&run(&[&arguments[..], &["--json", "--quiet"]].concat()));
    assert_eq!(again["attitude"]["total"]["rms_deg"], worst["rms_deg"]);
    assert_eq!(again["verdict"], worst["verdict"]);
}

#[test]
fn a_unit_in_which_the_design_cannot_work_lowers_the_yield() {
    // Spread so wide that some amplifiers saturate at rest.
    let wide = "[spread]\n\"sensors.accelerometer.offset_x_mg\" = { range = 400.0 }\n";
    let output = corners(wide, &["--json", "--mc", "6"]);
    let found = document(&output);
    let units = found["runs"].as_array().expect("an array")[1..].to_vec();
    let failed = units.iter().filter(|run| run["verdict"] == "fail").count();
    let passed = found["yield"]["passed"].as_u64().expect("a count") as usize;
    assert_eq!(passed + failed, 6);
    assert_eq!(output.status.code(), Some(i32::from(failed > 0)));
}

#[test]
fn bad_corner_files_and_options_are_refused_before_anything_runs() {
    let cases = [
        (
            "[[corner]]\nname = \"x\"\nset = { \"climate.stort_k\" = 1 }\n",
            "climate.start_k",
        ),
        (
            "[[corner]]\nname = \"x\"\nset = { \"climate.start_k\" = 1 }\n",
            "climate.start_k",
        ),
        ("[[corners]]\n", "corner"),
        (
            "[spread]\n\"climate.start_k\" = { sigma = -1.0 }\n",
            "not negative",
        ),
    ];
    for (text, named) in cases {
        let output = corners(text, &[]);
        assert_eq!(output.status.code(), Some(2), "{text}");
        let said = stderr(&output);
        assert!(
            said.contains(named) && said.contains("corners.toml"),
            "{said}"
        );
    }
    for options in [&["--jobs", "0"][..], &["--mc", "-1"], &["--junit", "x"]] {
        assert_eq!(corners(FILE, options).status.code(), Some(2), "{options:?}");
    }
    for setting in [
        "climate.start_k",
        "climate.stort_k=1",
        "climate.start_k=nan",
        "=1",
    ] {
        let output = run(&["compare", "--seconds", "0.2", "--set", setting]);
        assert_eq!(output.status.code(), Some(2), "{setting}");
    }
    let alone = run(&["compare", "--mc", "3"]);
    assert_eq!(alone.status.code(), Some(2));
}
