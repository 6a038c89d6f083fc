//! `accuracy` as a user runs it.

use cardan_tests::{assert_refused, run, stderr};
use serde_json::Value;

#[test]
fn the_chip_is_as_accurate_as_its_bound_allows_and_native_does_the_same() {
    let output = run(&["accuracy", "--json", "--quiet", "--attitudes", "300"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found: Value = serde_json::from_slice(&output.stdout).expect("one document");
    let rows = found["rows"].as_array().expect("a list");
    assert_eq!(rows.len(), 2, "one conversion and 64");
    for row in rows {
        let rms = row["emulated"]["rms"].as_f64().expect("a number");
        let bound = row["cramer_rao_rms"].as_f64().expect("a number");
        assert!(rms > 0.8 * bound && rms < 1.2 * bound, "{row}");
        assert_eq!(row["native_mismatches"], 0);
    }
}

#[test]
fn chopping_takes_noise_away_and_a_slow_carrier_costs_delay() {
    let output = run(&["accuracy", "--json", "--quiet", "--chopping=2000,16000"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found: Value = serde_json::from_slice(&output.stdout).expect("one document");
    let rows = found["rows"].as_array().expect("a list");
    let number = |row: usize, key: &str| rows[row][key].as_f64().expect("a number");
    assert!(rows[0]["chopping_hz"].is_null());
    assert_eq!([1, 2].map(|row| number(row, "chopping_hz")), [2e3, 16e3]);
    assert!(number(0, "tilt_deg") > 4.0 * number(2, "tilt_deg"));
    assert!(number(1, "group_delay_ms") > number(2, "group_delay_ms") + 3.0);
}

#[test]
fn what_accuracy_cannot_measure_is_refused_before_anything_runs() {
    for (options, parts) in [
        (["--averaging", "1,3"], ["3", "power of two"]),
        (["--averaging", "8192"], ["8192", "power of two"]),
        (["--tilt", "80"], ["80", "75"]),
        (["--attitudes", "0"], ["0", "1000000"]),
        (["--chopping=50", "--quiet"], ["50", "100000"]),
        (["--chopping", "--tilt=3"], ["--chopping", "--tilt"]),
        (["--scenario", "static"], ["--chopping", "--scenario"]),
    ] {
        let output = run(&[&["accuracy"][..], &options].concat());
        assert_refused(&output, &parts);
        assert!(!stderr(&output).contains("averaged:"), "nothing ran");
    }
}
