//! `compare --corners` as a user runs it: yield, worst corner, reproduction, bad input.

use std::fs;
use std::process::Output;

use cardan_tests::{document, run, stderr};
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
    let mut fixed = vec!["compare", "--quiet", "--corners", &file];
    if !more.contains(&"--seconds") {
        fixed.extend(["--seconds", "0.2"]);
    }
    run(&[&fixed[..], more].concat())
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
    assert!(failed > 0 && passed > 0, "{failed} of 6 fail");
    assert_eq!(output.status.code(), Some(1));
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

#[test]
fn a_yield_counts_the_error_against_truth_and_the_flagged_share() {
    // 150 mg are 9 degrees of tilt: the firmware computes rightly what the sensor says wrongly.
    let file = "[[corner]]\nname = \"off\"\nset = { \"sensors.accelerometer.offset_x_mg\" = 150.0 }\n\
                [spread]\n\"sensors.accelerometer.offset_y_mg\" = { range = 300.0 }\n";
    let output = corners(file, &["--json", "--mc", "3", "--seconds", "1"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let found = document(&output);
    let off = &found["runs"][1];
    assert_eq!(off["verdict"], "fail");
    assert_eq!(off["truth_missed"], true, "{off}");
    let units = &found["runs"].as_array().expect("runs")[2..];
    let failed = |key: &str| units.iter().filter(|run| run[key] == true).count();
    assert!(failed("truth_missed") > 0, "{units:?}");
    assert_eq!(found["yield"]["truth_missed"], failed("truth_missed"));
    assert_eq!(found["yield"]["too_flagged"], failed("too_flagged"));
    let passed = units.iter().filter(|run| run["verdict"] == "pass").count();
    assert_eq!(found["yield"]["passed"], passed);
    // A limit of one's own stands in place of the scenario's.
    let wide: Vec<&str> =
        "--json --set tolerance.truth.rms_deg=180 --set tolerance.truth.p99_deg=180 \
        --set tolerance.truth.max_deg=180 --set tolerance.status.most_flagged=1 --seconds 1"
            .split_whitespace()
            .collect();
    let found = document(&corners(file, &wide));
    assert_eq!(found["runs"][1]["truth_missed"], false);
}

#[test]
fn a_recording_without_reference_has_figures_against_golden_and_counts_its_solutions() {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("still.csv");
    let mut text = "t_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT\n".to_owned();
    for row in 0..200 {
        text += &format!("{:.2},0.5,1.0,9.7,10.0,20.0,-40.0\n", f64::from(row) * 0.01);
    }
    fs::write(&file, text).expect("written");
    let corner = "[[corner]]\nname = \"warm\"\nset = { \"climate.start_k\" = 300.0 }\n";
    let recording = file.to_string_lossy();
    let output = corners(
        corner,
        &["--json", "--seconds", "1", "--recording", &recording],
    );
    let found = document(&output);
    let runs = found["runs"].as_array().expect("runs");
    assert_eq!(runs.len(), 2, "nominal and warm");
    for run in runs {
        assert_eq!(run["against"], "golden", "{run}");
        assert!(run["solutions"].as_u64() > Some(100), "{run}");
        assert!(run["rms_deg"].as_f64().expect("a figure") < 0.1, "{run}");
        let share = run["flagged_share"].as_f64().expect("a share");
        let counted = 1.0
            - run["unflagged"].as_f64().expect("a count")
                / run["solutions"].as_f64().expect("a count");
        assert!((share - counted).abs() < 1e-12, "{run}");
    }
    let text = corners(corner, &["--seconds", "1", "--recording", &recording]);
    assert!(String::from_utf8_lossy(&text.stdout).contains("no reference attitude"));
}

#[test]
fn a_page_of_the_corners_is_written_where_it_is_asked_for() {
    let folder = TempDir::new().expect("a folder");
    let output = corners(
        FILE,
        &["--mc", "2", "--report", &folder.path().to_string_lossy()],
    );
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let page = fs::read_to_string(folder.path().join("corners.html")).expect("written");
    for word in ["hot", "mc-1", "climate.start_k", "Attitude error"] {
        assert!(page.contains(word), "{word}");
    }
}

#[test]
fn settings_take_what_messages_advise_and_name_the_nearest_key() {
    let set = |setting: &str| {
        run(&[
            "compare",
            "--in-process",
            "--seconds",
            "0.2",
            "--quiet",
            "--set",
            setting,
        ])
    };
    for setting in [
        "field.horizontal_ut=22 --set field.vertical_ut=40",
        "tolerance.truth.rms_deg=100",
        "tolerance.stages.adc_deg=100",
        "tolerance.channels.bias_lsb=900",
        "tolerance.status.most_flagged=1",
        "tolerance.nodes.yaw=1",
        "noise.enabled=false",
        "sensors.third_tilt=measured",
        "seconds=5",
    ] {
        let all: Vec<&str> = "compare --in-process --seconds 0.2 --quiet --set"
            .split(' ')
            .chain(setting.split(' '))
            .collect();
        let output = run(&all);
        let code = output.status.code();
        assert!(
            matches!(code, Some(0 | 1)),
            "{setting}: {code:?}: {}",
            stderr(&output)
        );
    }
    for (setting, near) in [
        ("tolerance.truth.rms=1", "tolerance.truth.rms_deg"),
        ("tolerance.truth.max=1", "tolerance.truth.max_deg"),
        ("tolerance.most_flagged=1", "tolerance.status.most_flagged"),
        ("tolerance.nodes.pich=1", "pitch"),
        ("rms_deg=1", "tolerance.truth.rms_deg"),
        ("field.horizontal=20", "field.horizontal_ut"),
        ("noise.enable=1", "noise.enabled"),
        ("climate.stort_k=1", "climate.start_k"),
    ] {
        let output = set(setting);
        assert_eq!(output.status.code(), Some(2), "{setting}");
        assert!(
            stderr(&output).contains(&format!("did you mean '{near}'")),
            "{setting}: {}",
            stderr(&output)
        );
    }
}
