//! Scenario files: bundled ones, printing, and what every mistake in them is told.

use cardan_scenario::scenario::{BUNDLED, DEFAULT};
use cardan_scenario::{Scenario, Trajectory, print_scenario, report};
use cardan_spec::ThirdTilt;

fn message(text: &str) -> String {
    Scenario::parse(text, "mine.toml", "mine")
        .expect_err(text)
        .to_string()
}

/// Fails unless the error for `text` contains every one of `parts`.
fn check(text: &str, parts: &[&str]) {
    let found = message(text);
    for part in parts {
        assert!(found.contains(part), "'{part}' is missing in: {found}");
    }
}

#[test]
fn every_bundled_scenario_loads_and_runs() {
    for (name, _) in BUNDLED {
        let scenario = Scenario::load(name).expect(name);
        assert_eq!(scenario.name, name);
        let trajectory = Trajectory::new(&scenario, 1).expect(name);
        assert!(trajectory.has_truth() && trajectory.duration_s().is_none());
    }
}

#[test]
fn the_default_run_holds_a_thousand_solutions_and_ten_seconds() {
    use cardan_spec::timing::{BLOCK_CYCLES, CPU_HZ, WARM_UP_BLOCKS};
    let seconds = Scenario::load(DEFAULT).expect("bundled").seconds;
    let solutions = seconds * CPU_HZ as f64 / BLOCK_CYCLES as f64 - WARM_UP_BLOCKS as f64;
    assert!(seconds >= 10.0 && solutions >= 1000.0);
}

#[test]
fn a_printed_scenario_reads_back_as_itself_and_documents_every_parameter() {
    let text = r#"
        seconds = 3.5
        [field]
        horizontal_ut = 20.0
        vertical_ut = -41.5
        [sensors.magnetometer]
        quality = 80
        [calibration]
        tilt_matrix = [[-1.25, 0.01], [0.0, -1.2]]
        [tolerance.nodes]
        yaw = 1e-4
        [motion]
        kind = "static"
        [motion.recording]
        file = "some \"file\".csv"
        gravity_m_s2 = 9.81
    "#;
    let custom = Scenario::parse(text, "mine.toml", "mine").expect("valid");
    let bundled = BUNDLED.map(|(name, _)| Scenario::load(name).expect(name));
    for scenario in bundled.into_iter().chain([custom]) {
        let printed = print_scenario(&scenario);
        let back = Scenario::parse(&printed, "printed", "other").expect("printed text is valid");
        assert_eq!(back, scenario);
        for parameter in scenario.parameters() {
            assert!(printed.contains(parameter.meaning), "{parameter:?}");
        }
    }
}

#[test]
fn every_default_is_inside_its_range_and_has_a_unit_and_a_meaning() {
    for p in Scenario::default().parameters() {
        assert!(p.value == p.default && p.is_admissible(), "{p:?}");
        assert!(!p.unit.is_empty() && p.meaning.ends_with('.'), "{p:?}");
    }
}

#[test]
fn an_unknown_key_is_told_with_its_place_and_the_nearest_known_one() {
    let text = "seconds = 2.0\n[sensors.magnetometer]\n  qualty = 80.0\n";
    check(
        text,
        &[
            "mine.toml, line 3, column 3",
            "qualty",
            "did you mean 'quality'?",
        ],
    );
    check("[frontent]\n", &["line 1", "did you mean 'frontend'?"]);
    check("zzz = 1\n", &["unknown key 'zzz'; known here: name"]);
    check(
        "[motion]\nkind = \"tumbel\"\n",
        &["line 2", "unknown value", "'tumble'"],
    );
    check(
        "[mounting]\nx_body = \"w\"\n",
        &["line 2", "unknown value 'w'", "-x"],
    );
}

#[test]
fn broken_toml_and_wrong_types_are_told_with_their_place() {
    check("seconds = 2.0\n[motion\n", &["mine.toml, line 2"]);
    check(
        "seconds = \"long\"\n",
        &["line 1, column 11", "expected f64"],
    );
    check("[noise]\nenabled = 1\n", &["line 2", "boolean"]);
    check("[calibration]\ntilt_offset = [0.0]\n", &["line 2"]);
}

#[test]
fn every_inadmissible_number_is_told_with_key_line_and_range() {
    let quality = "[sensors.magnetometer]\n\nquality = -100\n";
    check(
        quality,
        &[
            "mine.toml, line 3",
            "sensors.magnetometer.quality = -100",
            "0.6 to 100000",
        ],
    );
    for seconds in ["0", "-1", "nan", "inf", "1.1e6"] {
        check(
            &format!("seconds = {seconds}\n"),
            &["line 1", "seconds = ", "at most 1000000 s"],
        );
    }
    check(
        "[field]\nhorizontal_ut = 20.0\n",
        &["line 2", "field.vertical_ut beside it"],
    );
    check(
        "[field]\nsite = \"atlantis\"\n",
        &["line 2", "one of montpellier-2008"],
    );
    check(
        "[mounting]\nx_body = \"x\"\n",
        &["mine.toml, line 1", "right-handed"],
    );
    check(
        "[tolerance.nodes]\nyaw = -1\n",
        &["line 2", "tolerance.nodes.yaw = -1"],
    );
    check(
        "[tolerance.truth]\nrms_deg = nan\n",
        &["line 2", "tolerance.truth.rms_deg"],
    );
    check(
        "[calibration]\nfield_matrix = [[1, 0], [0, 9]]\n",
        &["line 2", "-7.99 to 7.99"],
    );
    check(
        "[motion]\nkind = \"recording\"\n",
        &["line 2", "--recording"],
    );
    check(
        "[frontend]\naperture_cycles = 16.5\n",
        &["line 2", "whole number"],
    );
    check(
        "[frontend]\ntilt_low_pass_hz = nan\n",
        &["line 2", "1 to 5000 Hz"],
    );
}

#[test]
fn every_parameter_is_checked_at_both_ends_of_its_range() {
    for p in Scenario::default().parameters() {
        for value in [p.least - p.least.abs() * 0.01 - 1e-9, p.most * 1.01] {
            let text = format!("[{}]\n{} = {value:?}\n", p.section, p.key);
            check(&text, &["line 2", &format!("{}.{}", p.section, p.key)]);
        }
    }
}

#[test]
fn an_unknown_scenario_is_told_with_the_bundled_names() {
    let found = Scenario::load("tumbel").expect_err("unknown").to_string();
    assert!(
        found.contains("tumble, tumble-quiet, somersault, measured, static"),
        "{found}"
    );
    assert!(found.contains("did you mean 'tumble'?"), "{found}");
    let found = Scenario::load("no/such/file.toml")
        .expect_err("unknown")
        .to_string();
    assert!(found.contains("path of a scenario file"), "{found}");
}

#[test]
fn a_directory_or_binary_file_is_unreadable_and_says_why() {
    let directory = tempfile::tempdir().expect("temporary directory");
    let path = directory.path().join("binary.toml");
    std::fs::write(&path, [0xff, 0xfe, 0x00]).expect("write");
    for path in [directory.path(), path.as_path()] {
        let name = path.to_str().expect("text path");
        let found = Scenario::load(name).expect_err("unreadable").to_string();
        assert!(
            found.contains("cannot read") && found.contains(name),
            "{found}"
        );
    }
}

#[test]
fn assumed_values_are_listed_with_their_reasons_and_published_ones_are_not() {
    let scenario = Scenario::load("tumble").expect("bundled");
    let trajectory = Trajectory::new(&scenario, 1).expect("valid");
    let listed = report::assumptions(&scenario, &trajectory);
    let find = |key: &str| listed.iter().find(|a| a.key == key);
    assert!(find("frontend.lna_gain").is_some_and(|a| a.source.contains("not published")));
    assert!(
        find("sensors.magnetometer.resonance_hz").is_none(),
        "published"
    );
    assert!(find("calibration").is_some_and(|a| a.value.contains("nominal sensors")));
    assert!(find("field.site").is_some());
}

#[test]
fn an_explicit_calibration_replaces_the_nominal_values_and_is_reported() {
    let text = "[calibration]\ntilt_offset = [0.01, -0.02]\nhorizontal_ut = 30\nvertical_ut = 40\n";
    let scenario = Scenario::parse(text, "mine.toml", "mine").expect("valid");
    let trajectory = Trajectory::new(&scenario, 1).expect("valid");
    let calibration = report::calibration(&scenario, &trajectory);
    assert_eq!(calibration.tilt_offset, [0.01, -0.02]);
    assert_eq!((calibration.horizontal, calibration.vertical), (0.6, 0.8));
    assert_eq!(calibration.tilt_matrix, [[-1.2, 0.0], [0.0, -1.2]]);
    let listed = report::assumptions(&scenario, &trajectory);
    assert!(
        listed
            .iter()
            .any(|a| a.value.contains("tilt_offset, horizontal_ut, vertical_ut"))
    );
}

#[test]
fn the_seed_changes_the_tumble() {
    let scenario = Scenario::load("tumble").expect("bundled");
    let at = |seed| {
        Trajectory::new(&scenario, seed)
            .expect("valid")
            .truth_at(1.0)
    };
    assert_eq!(at(1), at(1));
    assert_ne!(at(1), at(2));
}

#[test]
fn switches_are_set_by_1_and_0_alone_and_survive_the_printed_page() {
    let mut scenario = Scenario::default();
    assert!(scenario.noise.enabled);
    scenario.set("noise.enabled", 0.0).expect("a switch");
    assert!(!scenario.noise.enabled);
    let page = print_scenario(&scenario);
    let read = Scenario::parse(&page, "page.toml", "page").expect("reads back");
    assert!(!read.noise.enabled);
    let error = scenario.set("noise.enabled", 0.5).expect_err("neither");
    assert!(
        error.to_string().contains("true (1) or false (0)"),
        "{error}"
    );
}

#[test]
fn the_third_tilt_axis_is_a_word_or_a_truth_value_and_survives_the_printed_page() {
    let mut scenario = Scenario::default();
    assert_eq!(scenario.sensors.third_tilt, ThirdTilt::Absent);
    for kind in ThirdTilt::ALL {
        let number = f64::from(kind as u8);
        scenario.set("sensors.third_tilt", number).expect("a kind");
        assert_eq!(scenario.sensors.third_tilt, kind);
        let page = print_scenario(&scenario);
        let read = Scenario::parse(&page, "page.toml", "page").expect("reads back");
        assert_eq!(read.sensors.third_tilt, kind);
    }
    let read = |value: &str| {
        let text = format!("[sensors]\nthird_tilt = {value}\n");
        Scenario::parse(&text, "unit.toml", "unit").map(|read| read.sensors.third_tilt)
    };
    assert_eq!(read("true").expect("a kind"), ThirdTilt::Comparator);
    assert_eq!(read("false").expect("a kind"), ThirdTilt::Absent);
    for (value, expected) in [
        ("\"maybe\"", "known here: measured, comparator, absent"),
        ("\"mesured\"", "did you mean 'measured'?"),
        (
            "2",
            "expected one of measured, comparator, absent, true (comparator), false (absent)",
        ),
    ] {
        let message = read(value).expect_err("no kind").to_string();
        assert!(
            message.contains(expected) && message.contains("unit.toml"),
            "{message}"
        );
        assert!(message.contains("line 2"), "{message}");
    }
    for number in [0.5, 3.0, -1.0] {
        let error = scenario
            .set("sensors.third_tilt", number)
            .expect_err("neither");
        let expected = "measured (2), comparator or true (1), absent or false (0)";
        assert!(error.to_string().contains(expected), "{error}");
    }
}
