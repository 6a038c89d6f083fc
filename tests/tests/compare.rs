//! `compare` as a user runs it: result, determinism, bad inputs.

use std::fs;
use std::process::{Command, Stdio};

use cardan_tests::{cardan, root, run, stderr};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};
use serde_json::Value;

/// A run of 13 solutions.
const SHORT: [&str; 4] = ["compare", "--quiet", "--seconds", "0.2"];

fn document(arguments: &[&str]) -> Value {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("one JSON document")
}

fn without_host_times(mut document: Value) -> Value {
    document["emulator"]["realtime_factor"] = Value::Null;
    document["reproduce"] = Value::Null;
    document
}

#[test]
fn the_main_job_passes_with_a_thousand_solutions_and_every_bit_equal() {
    let document = document(&["compare", "--json", "--quiet"]);
    assert_eq!(document["verdict"], "pass");
    assert!(document["seconds"].as_f64().expect("a number") >= 10.0);
    let nodes = document["nodes"].as_array().expect("an array");
    assert!(nodes.len() > 20);
    for node in nodes {
        let bits = &node["native_vs_emulated"];
        assert_eq!(bits["mismatches"], 0, "{}", node["name"]);
        assert!(
            bits["compared"].as_u64().expect("a count") >= 1000,
            "{}",
            node["name"]
        );
    }
    assert_eq!(document["error_budget"]["compiled"], 0.0);
    assert_eq!(document["link"]["lost"], 0);
}

/// A scenario's limits are wider in a shorter run; a limit that the user states is that limit.
#[test]
fn a_limit_that_is_stated_for_a_run_is_not_widened_however_short_it_is() {
    let judged = |set: Option<&str>| -> Value {
        let short = ["compare", "--json", "--quiet", "--seconds", "4"];
        let set = set.map(|set| vec!["--set", set]).unwrap_or_default();
        let output = run(&[&short[..], &set].concat());
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(&output)))
    };
    let is = |value: &Value, expected: f64| {
        let value = value.as_f64().expect("a number");
        (value / expected - 1.0).abs() < 1e-12
    };
    let own = judged(None);
    let rms = own["attitude"]["total"]["rms_deg"].as_f64().expect("known");
    let own_truth = &own["limits"]["truth"];
    assert_eq!(own["verdict"], "pass");
    assert!(is(&own["limits"]["widening"], 3_f64.sqrt()));
    assert!(own_truth["rms_deg"].as_f64().expect("set") > rms);
    for (factor, verdict) in [(1.01, "pass"), (0.99, "fail")] {
        let stated = judged(Some(&format!("tolerance.truth.rms_deg={}", factor * rms)));
        assert!(is(&stated["limits"]["truth"]["rms_deg"], factor * rms));
        assert_eq!(
            stated["limits"]["truth"]["p99_deg"], own_truth["p99_deg"],
            "not stated"
        );
        assert_eq!(stated["verdict"], verdict, "{}", stated["reasons"]);
    }
    let stage = judged(Some("tolerance.stages.adc_deg=0.07"));
    let adc = stage["error_budget"]["adc"].as_f64().expect("known");
    assert!(adc > 0.07, "{adc}");
    assert!(is(&stage["limits"]["stages_deg"]["adc"], 0.07));
    assert_eq!(stage["verdict"], "fail");
}

/// A recording is no shorter than it should be: limits of a scenario file stay as they are on it.
#[test]
fn limits_of_a_file_are_not_widened_on_a_recording_however_much_of_it_is_run() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let mut table = "t_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT\n".to_owned();
    for row in 0..400 {
        table += &format!("{:.2},0,0,9.81,20,0,-44\n", f64::from(row) / 100.0);
    }
    fs::write(at("rest.csv"), table).expect("written");
    fs::write(at("mine.toml"), "[tolerance.stages]\nadc_deg = 0.001\n").expect("written");
    for seconds in [&["--seconds", "1"][..], &[]] {
        let options = [
            "compare",
            "--json",
            "--quiet",
            "--scenario",
            &at("mine.toml"),
        ];
        let recording = ["--recording", &at("rest.csv")];
        let output = run(&[&options[..], &recording, seconds].concat());
        let found = cardan_tests::document(&output);
        let adc = found["error_budget"]["adc"].as_f64().expect("a figure");
        assert!(adc > 0.001, "{adc}");
        assert_eq!(found["limits"]["widening"], 1.0);
        assert_eq!(found["limits"]["stages_deg"]["adc"], 0.001);
        assert_eq!(found["verdict"], "fail");
    }
}

#[test]
fn without_noise_the_attitude_is_right_to_0_3_degrees() {
    let document = document(&["compare", "--json", "--quiet", "--scenario", "tumble-quiet"]);
    let rms = document["attitude"]["total"]["rms_deg"]
        .as_f64()
        .expect("a number");
    assert!(rms < 0.3, "{rms} degrees");
}

#[test]
fn with_a_third_tilt_axis_every_attitude_is_told_and_without_it_hardly_any() {
    let run = |fitted: &str| {
        let over = ["compare", "--json", "--quiet", "--scenario", "somersault"];
        document(&[&over[..], &["--seconds", "6", "--set", fitted]].concat())
    };
    let share = |document: &Value| {
        let count = |key: &str| document[key].as_f64().expect("a count");
        count("unflagged_solutions") / count("solutions")
    };
    let with = run("sensors.third_tilt=true");
    let nodes = with["nodes"].as_array().expect("an array");
    assert!(nodes.len() > 60, "{} nodes", nodes.len());
    for node in nodes {
        let bits = &node["native_vs_emulated"];
        assert_eq!(bits["mismatches"], 0, "{}", node["name"]);
        assert!(bits["compared"].as_u64() >= Some(700), "{}", node["name"]);
    }
    assert_eq!(with["emulator"]["lost_conversions"], 0);
    assert_eq!(with["error_budget"]["compiled"], 0.0);
    let rms = with["attitude"]["total"]["rms_deg"].as_f64();
    assert!(rms.is_some_and(|rms| rms < 3.0), "{rms:?} degrees");
    assert!(share(&with) > 0.65, "{}", share(&with));
    let without = run("sensors.third_tilt=false");
    assert!(share(&without) < 0.25, "{}", share(&without));
}

#[test]
fn a_measured_third_axis_has_the_bits_in_every_node_and_no_late_or_lost_conversion() {
    let over = ["compare", "--json", "--quiet", "--scenario", "somersault"];
    let measured = ["--seconds", "6", "--set", "sensors.third_tilt=measured"];
    let document = document(&[&over[..], &measured].concat());
    assert_eq!(document["verdict"], "pass");
    // 10 ms each, after 0.12 s of settling.
    assert_eq!(document["solutions"], 588);
    let nodes = document["nodes"].as_array().expect("an array");
    assert!(nodes.iter().any(|node| node["name"] == "tilt_z"));
    for node in nodes {
        let bits = &node["native_vs_emulated"];
        assert_eq!(bits["mismatches"], 0, "{}", node["name"]);
        assert!(
            bits["compared"].as_u64().expect("a count") >= 588,
            "{}",
            node["name"]
        );
        if node["name"] == "tilt_z" {
            let off = node["golden_vs_native"]["max_abs"]
                .as_f64()
                .expect("a number");
            assert!(off > 0.0 && off < 8e-5, "{off} g");
        }
    }
    for what in ["late_conversions", "lost_conversions"] {
        assert_eq!(document["emulator"][what], 0, "{what}");
    }
    assert_eq!(document["error_budget"]["compiled"], 0.0);
    assert_eq!(document["frames"]["mismatches"], 0);
}

#[test]
fn a_third_axis_of_no_kind_is_refused_with_the_kinds() {
    let output = run(&["compare", "--set", "sensors.third_tilt=maybe"]);
    assert_eq!(output.status.code(), Some(2));
    let said = stderr(&output);
    let expected = "expected measured (2), comparator or true (1), absent or false (0)";
    assert!(said.contains(expected), "{said}");
}

#[test]
fn the_same_seed_gives_the_same_document_and_another_seed_another() {
    let run = |seed: &str| {
        without_host_times(document(
            &[&SHORT[..], &["--json", "--seed", seed]].concat(),
        ))
    };
    let one = run("1");
    assert_eq!(one, run("1"));
    assert_ne!(one, run("2"));
    let threads = document(&[&SHORT[..], &["--json", "--in-process"]].concat());
    assert_eq!(one, without_host_times(threads));
}

#[test]
fn two_sessions_side_by_side_do_not_meet() {
    let start = |session: &str, seed: &str| {
        Command::new(cardan())
            .args(SHORT)
            .args(["--json", "--session", session, "--seed", seed])
            .stdout(Stdio::piped())
            .spawn()
            .expect("starts")
    };
    let children = [start("side-a", "1"), start("side-b", "2")];
    let results = children.map(|child| {
        let output = child.wait_with_output().expect("ends");
        assert_eq!(output.status.code(), Some(0));
        serde_json::from_slice::<Value>(&output.stdout).expect("JSON")
    });
    assert_eq!(
        (&results[0]["session"], &results[0]["seed"]),
        (&"side-a".into(), &1.into())
    );
    assert_eq!(
        (&results[1]["session"], &results[1]["seed"]),
        (&"side-b".into(), &2.into())
    );
}

/// Asserts exit 2 and that standard error holds all of `expected`, without a panic.
fn refused(arguments: &[&str], expected: &[&str]) {
    let output = run(arguments);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    assert!(!text.contains("panicked"), "{arguments:?}: {text}");
    for part in expected {
        assert!(
            text.contains(part),
            "{arguments:?}: {part:?} is not in: {text}"
        );
    }
    assert!(output.stdout.is_empty(), "{arguments:?} wrote a result");
}

#[test]
fn bad_durations_and_names_are_refused() {
    for seconds in ["0", "-1", "nan", "inf", "1e7", "ten", "0.01"] {
        refused(&["compare", "--seconds", seconds], &["seconds"]);
    }
    refused(&["compare", "--scenario", "tumbel"], &["tumbel", "tumble"]);
    refused(&["compare", "--app", "inertia"], &["inertia", "attitude"]);
    refused(&["compare", "--session", "a/b"], &["a/b"]);
    refused(&["compare", "--seed", "-1"], &["--seed"]);
    refused(&["compare", "--no-such-option"], &["--no-such-option"]);
}

#[test]
fn bad_images_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("image.elf");
    let name = file.to_str().expect("a name");
    refused(
        &["compare", "--firmware", "/no/such.elf"],
        &["/no/such.elf"],
    );
    let good =
        fs::read(root().join("firmware/boards/atmega328p/images/tapped.elf")).expect("there");
    let mut random = vec![0; 4096];
    ChaCha8Rng::seed_from_u64(1).fill_bytes(&mut random);
    let host = fs::read(std::env::current_exe().expect("this test")).expect("an ELF of this host");
    for bad in [
        &[][..],
        &good[..100],
        &good[..good.len() / 2],
        &random,
        &host,
    ] {
        fs::write(&file, bad).expect("writes");
        refused(&["compare", "--firmware", name], &["image.elf"]);
    }
}

#[test]
fn bad_scenarios_are_refused_with_key_and_place() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("scenario.toml");
    let name = file.to_str().expect("a name");
    for (text, expected) in [
        ("secnds = 3\n", ["scenario.toml", "seconds"]),
        ("seconds = \n", ["scenario.toml", "line 1"]),
        (
            "[sensors.magnetometer]\nq = -3.0\n",
            ["scenario.toml, line 2", "unknown key 'q'"],
        ),
    ] {
        fs::write(&file, text).expect("writes");
        refused(&["compare", "--scenario", name], &expected);
    }
}

#[test]
fn bad_recordings_are_refused_with_line_and_column() {
    const HEADER: &str = "t_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT\n";
    let row = |t: &str, x: &str| format!("{t},{x},0,9.81,20,0,-40\n");
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("motion.csv");
    let name = file.to_str().expect("a name");
    let rows = |rows: &[String]| HEADER.to_owned() + &rows.concat();
    let cases = [
        (String::new(), vec!["motion.csv"]),
        (HEADER.replace("mag_y_uT,", ""), vec!["mag_y_uT"]),
        (
            rows(&[row("0", "0"), row("0.1", "abc")]),
            vec!["line 3", "acc_x_m_s2"],
        ),
        (
            rows(&[row("0", "0"), row("0.1", "nan")]),
            vec!["line 3", "acc_x_m_s2"],
        ),
        (
            rows(&[row("0", "0"), row("0.1", "inf")]),
            vec!["line 3", "acc_x_m_s2"],
        ),
        (
            rows(&[row("0", "0"), row("0", "0")]),
            vec!["line 3", "'t_s'"],
        ),
    ];
    for (text, expected) in cases {
        fs::write(&file, text).expect("writes");
        refused(&["compare", "--recording", name], &expected);
    }
}

#[test]
fn bad_wordlengths_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("w.toml");
    let name = file.to_str().expect("a name");
    let good = fs::read_to_string(root().join("firmware/wordlengths.toml")).expect("committed");
    fs::write(&file, good.replacen("word = 16", "word = 65", 1)).expect("writes");
    refused(
        &["compare", "--wordlengths", name],
        &["w.toml", "word = 65"],
    );
    fs::write(
        &file,
        good.replacen("name = \"tilt_x\"", "name = \"tilt_u\"", 1),
    )
    .expect("writes");
    refused(&["compare", "--wordlengths", name], &["tilt_u"]);
}

#[test]
fn a_printed_scenario_is_what_the_other_options_make_of_it_and_runs() {
    let folder = tempfile::tempdir().expect("a folder");
    let set = ["--set", "climate.start_k=303", "--seconds", "0.3"];
    let output = run(&[&["compare", "--print-scenario"], &set[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text = String::from_utf8(output.stdout).expect("text");
    let printed: toml::Table = text.parse().expect("TOML");
    assert_eq!(printed["climate"]["start_k"].as_float(), Some(303.0));
    assert_eq!(printed["seconds"].as_float(), Some(0.3));
    let file = folder.path().join("mine.toml");
    std::fs::write(&file, text).expect("written");
    let nodes = |arguments: &[&str]| {
        document(&[&["compare", "--json", "--quiet"], arguments].concat())["nodes"].clone()
    };
    let own = nodes(&["--scenario", &file.to_string_lossy()]);
    assert_eq!(own, nodes(&set));
}

#[test]
fn what_would_have_no_effect_is_refused() {
    for (arguments, parts) in [
        (
            &["compare", "--print-scenario", "--junit", "x.xml"][..],
            &["--print-scenario", "--junit"][..],
        ),
        (
            &["compare", "--explain", "yaw", "--baseline", "x.json"],
            &["--explain", "--baseline"],
        ),
        (
            &["compare", "--explain", "yaw", "--print-scenario"],
            &["--explain", "--print-scenario"],
        ),
        (
            &["tune", "--budget", "attitude.rms<=1", "--coefficients", "x"],
            &["--coefficients x", "--cost area"],
        ),
    ] {
        cardan_tests::assert_refused(&run(arguments), parts);
    }
}

#[test]
fn a_folder_may_have_a_name_like_an_option() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = std::process::Command::new(cardan_tests::cardan())
        .args(["compare", "--quiet", "--seconds", "0.3", "--report=-inf"])
        .args(["--junit=-x.xml", "--dump=-y.csv"])
        .current_dir(folder.path())
        .output()
        .expect("runs");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for name in ["-inf/report.html", "-x.xml", "-y.csv"] {
        assert!(folder.path().join(name).is_file(), "{name}");
    }
}
