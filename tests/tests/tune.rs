//! `tune` and `ranges` as a user runs them: documents, exit codes, files, bad input.

use std::fs;
use std::process::Output;

use cardan_tests::{SHORT_SEARCH, assert_refused, document, root, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

fn tune(more: &[&str]) -> Output {
    run(&[&SHORT_SEARCH[..], &["--quiet"], more].concat())
}

/// What is not verified is no pass.
fn assert_exit(output: &Output) {
    let verified = document(output)["verified"].as_bool().expect("is told");
    let code = if verified { 0 } else { 1 };
    assert_eq!(output.status.code(), Some(code), "{}", stderr(output));
}

fn bits(candidate: &Value) -> u64 {
    candidate["bits"].as_u64().expect("a count")
}

#[test]
fn a_tuned_file_meets_its_budget_in_fewer_bits_and_a_million_samples_compare_bit_by_bit() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("tuned.toml");
    let path = file.to_string_lossy();
    let output = tune(&["--json", "--budget", "attitude.rms<=0.05", "--out", &path]);
    let found = document(&output);
    assert_eq!(found["feasible"], true, "{}", stderr(&output));
    assert_exit(&output);
    let text = fs::read_to_string(&file).expect("is written");
    let tuned: toml::Table = text.parse().expect("is TOML");
    let to = &tuned["tuned"];
    assert_eq!(to["budget"][0].as_str(), Some("attitude.rms<=0.05"));
    assert_eq!(to["verified"].as_bool(), found["verified"].as_bool());
    let reached = to["reached"][0].as_float().expect("a number");
    assert_eq!(found["best"]["reached"][0]["value"], reached);
    assert!(
        to["tolerance"]
            .as_array()
            .is_some_and(|nodes| nodes.len() > 40)
    );
    assert!(bits(&found["deployed"]) > bits(&found["best"]));
    let error = found["best"]["error"].as_f64().expect("a number");
    assert!(error > 0.0 && error <= 0.05, "{error}");
    assert!(bits(&found["best"]) <= bits(&found["best_uniform"]));
    assert!(bits(&found["best_uniform"]) < bits(&found["baseline"]));
    let yaw = &found["best"]["formats"]["yaw"];
    for key in ["word", "frac", "rounding", "overflow"] {
        assert!(!yaw[key].is_null(), "{key}");
    }
    let verification = found["verification"].as_array().expect("a list");
    assert!(!verification.is_empty());
    for case in verification {
        let reached = case["reached"].as_array().expect("a list");
        assert!(!reached.is_empty(), "{case}");
    }

    let compared = [
        "compare",
        "--quiet",
        "--json",
        "--in-process",
        "--seconds",
        "126",
    ];
    let compared = run(&[&compared[..], &["--wordlengths", &path]].concat());
    let compared = document(&compared);
    let nodes = compared["nodes"].as_array().expect("a list");
    assert!(nodes.len() > 50);
    // Native runs on the tunable arithmetic, the image was compiled with `fixed` types.
    let samples = &nodes[0]["native_vs_emulated"]["compared"];
    assert!(samples.as_u64() >= Some(1_000_000), "{samples} samples");
    for node in nodes {
        let bits = &node["native_vs_emulated"];
        assert_eq!(bits["mismatches"], 0, "{}", node["name"]);
        assert!(
            bits["compared"].as_u64().expect("a count") > 0,
            "{}",
            node["name"]
        );
    }
}

#[test]
fn the_same_search_gives_the_same_document_whatever_the_number_of_threads() {
    let [one, two] = ["1", "2"].map(|threads| {
        let budget = ["--json", "--budget", "yaw.p99<=0.2", "--threads", threads];
        let output = tune(&budget);
        assert_exit(&output);
        let mut found = document(&output);
        found["seconds"] = Value::Null;
        found
    });
    assert_eq!(one, two);
}

#[test]
fn a_budget_that_cannot_be_met_names_what_stands_in_the_way() {
    let output = tune(&["--json", "--budget", "attitude.rms<=1e-9"]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let found = document(&output);
    assert_eq!(found["feasible"], false);
    assert_eq!(found["binding"], "attitude.rms<=1e-9");
    let reason = found["reason"].as_str().expect("is told");
    assert!(reason.contains("the algorithm itself"), "{reason}");
    assert!(bits(&found["best"]) > 0, "the closest point");
}

#[test]
fn without_an_input_that_raises_a_status_bit_the_user_is_told() {
    let told = |also: &str| {
        let budget = ["--json", "--budget", "attitude.rms<=0.05", "--also", also];
        document(&tune(&budget))["warnings"].to_string()
    };
    // Bit 2: disturbed field.
    assert!(
        told("tumble").contains("status bits 0x01d7"),
        "{}",
        told("tumble")
    );
    assert!(
        told("magnet").contains("status bits 0x0141"),
        "{}",
        told("magnet")
    );
}

#[test]
fn a_journal_that_was_cut_is_continued_and_a_foreign_one_refused() {
    let folder = tempdir().expect("a folder");
    let journal = folder.path().join("journal");
    let path = journal.to_string_lossy();
    let search = |budget: &str| tune(&["--json", "--budget", budget, "--journal", &path]);
    let first = search("attitude.rms<=0.05");
    assert_exit(&first);
    let whole = fs::read(&journal).expect("kept");
    fs::write(&journal, &whole[..whole.len() * 2 / 3]).expect("ours");
    let again = document(&search("attitude.rms<=0.05"));
    assert_eq!(again["best"], document(&first)["best"]);
    assert!(
        again["warnings"].to_string().contains("cut off"),
        "{}",
        again["warnings"]
    );
    assert_eq!(fs::read(&journal).expect("kept"), whole);

    let foreign = search("attitude.rms<=0.06");
    assert_eq!(foreign.status.code(), Some(2));
    assert!(stderr(&foreign).contains("journal of another search"));
    assert_eq!(
        fs::read(&journal).expect("kept"),
        whole,
        "nothing is written"
    );
}

#[test]
fn what_tune_cannot_use_is_refused_by_name() {
    let missing = root().join("no-such-folder/tuned.toml");
    let missing = missing.to_string_lossy();
    let cases: [(&[&str], &str); 8] = [
        (&["--budget", "attitude.rmz<=0.02"], "did you mean 'rms'"),
        (&["--budget", "sqnr(yow)>=60dB"], "did you mean 'yaw'"),
        (&["--budget", "attitude.rms<=x"], "attitude.rms<=x"),
        (
            &["--budget", "overflow==0", "--lock", "yow"],
            "no node 'yow'",
        ),
        (
            &["--budget", "overflow==0", "--widths", "0,8"],
            "expected word lengths",
        ),
        (&["--budget", "overflow==0", "--also", "no-such"], "no-such"),
        (
            &["--budget", "attitude.rms<=0.05", "--out", &missing],
            "cannot be written",
        ),
        (&[], "--budget"),
    ];
    for (options, named) in cases {
        let output = tune(options);
        assert_refused(&output, &[named]);
    }
}

#[test]
fn ranges_stand_side_by_side_and_what_is_proven_has_no_witness() {
    let folder = tempdir().expect("a folder");
    let report = folder.path().to_string_lossy();
    let output = run(&[
        "ranges",
        "--json",
        "--quiet",
        "--seconds",
        "1",
        "--search",
        "2000",
        "--report",
        &report,
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found = document(&output);
    let nodes = found["nodes"].as_array().expect("a list");
    assert!(nodes.len() > 50);
    let proven = nodes.iter().filter(|node| node["proven"] == true);
    assert_eq!(
        Some(proven.clone().count() as u64),
        found["proven"].as_u64()
    );
    assert!(proven.clone().count() > 20);
    let mut held = 0;
    for node in nodes {
        let name = &node["name"];
        if node["proven"] == true {
            assert!(
                node["witness"].is_null() && node["overflows"] == 0,
                "{name}"
            );
        }
        let ends = |how: &str| (node[how]["lo"].as_f64(), node[how]["hi"].as_f64());
        if let ((Some(lo), Some(hi)), affine) = (ends("derived"), ends("derived_affine")) {
            let affine = (
                affine.0.expect("never wider"),
                affine.1.expect("never wider"),
            );
            assert!(affine.0 >= lo && affine.1 <= hi, "{name}: {node}");
        }
        let (Some(min), Some(max)) = (node["min"].as_f64(), node["max"].as_f64()) else {
            continue;
        };
        for how in ["derived", "derived_affine"] {
            if let (Some(lo), Some(hi)) = ends(how) {
                assert!(lo <= min && max <= hi, "{name}: {node}");
                held += 1;
            }
        }
    }
    assert!(held > nodes.len(), "{held} ranges of {} nodes", nodes.len());
    let page = fs::read_to_string(folder.path().join("ranges.html")).expect("is written");
    for word in [
        ">simulated</th>",
        ">interval</th>",
        ">affine</th>",
        "weight_1",
    ] {
        assert!(page.contains(word), "{word}");
    }
}
