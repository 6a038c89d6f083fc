//! Bad input and options without effect: each is refused before any work, with exit code 2 and what was wrong.

use cardan_tests::{assert_refused, run};

#[test]
fn lengths_and_files_are_checked_where_nothing_runs() {
    for seconds in ["nan", "-5", "0", "inf", "1e7"] {
        let output = run(&["compare", "--print-scenario", "--seconds", seconds]);
        assert_refused(&output, &["--seconds", "above 0 and at most 1e6"]);
    }
    for option in ["--recording", "--firmware", "--eeprom", "--wordlengths"] {
        for look in [&["--print-scenario"][..], &["--explain", "yaw"]] {
            let output = run(&[&["compare"][..], look, &[option, "nope.x"]].concat());
            assert_refused(&output, &[option, "nope.x", "no such file"]);
        }
    }
}

#[test]
fn options_that_have_no_effect_are_refused_also_where_others_stand_in_the_way() {
    let cases: [(&[&str], &str, &str); 9] = [
        (
            &["compare", "--corners", "c.toml", "--margin", "5"],
            "--margin",
            "--baseline",
        ),
        (
            &["compare", "--corners", "c.toml", "--dump-signal", "yaw"],
            "--dump-signal",
            "--dump",
        ),
        (
            &["compare", "--print-scenario", "--mc", "9"],
            "--mc",
            "--corners",
        ),
        (
            &["compare", "--print-scenario", "--jobs", "3"],
            "--jobs",
            "--corners",
        ),
        (
            &["compare", "--explain", "yaw", "--margin", "3"],
            "--margin",
            "--baseline",
        ),
        (&["compare", "--checkout", "."], "--checkout", "--build"),
        (
            &["compare", "--corners", "c.toml", "--in-process"],
            "--in-process",
            "leave it out",
        ),
        (
            &["accuracy", "--attitudes", "3", "--scenario", "nope"],
            "--scenario",
            "--chopping",
        ),
        (
            &["calibrate", "--image", "a.hex", "--send", "port", "--build"],
            "--build",
            "cannot be used with",
        ),
    ];
    for (arguments, option, mend) in cases {
        assert_refused(&run(arguments), &[option, mend]);
    }
}

#[test]
fn values_that_mean_nothing_are_refused() {
    let tune = |budget: &str, more: &[&str]| {
        run(&[
            &["tune", "--seconds", "1", "--runs", "1", "--budget", budget][..],
            more,
        ]
        .concat())
    };
    assert_refused(&tune("overflow==5", &[]), &["overflow==5", "expected 0"]);
    assert_refused(&tune("flags<=2", &[]), &["flags<=2", "0 to 1"]);
    assert_refused(&tune("attitude.rms<1", &[]), &["'<'", "expected '<='"]);
    for nodes in ["yaw", "yaw,yaw"] {
        let output = tune("attitude.rms<=1", &["--couple", nodes]);
        assert_refused(&output, &["--couple", "at least two"]);
    }
    let output = tune(
        "attitude.rms<=1",
        &["--couple", "yaw,pitch", "--lock", "yaw"],
    );
    assert_refused(&output, &["--couple", "locked"]);
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("both");
    let file = file.to_str().expect("text");
    let output = tune("attitude.rms<=1", &["--out", file, "--report", file]);
    assert_refused(&output, &["--report", "--out"]);
    for (option, expected) in [
        ("--seed", "-1"),
        ("--tilt", "0 to 75"),
        ("--averaging", "power of two"),
    ] {
        assert_refused(&run(&["accuracy", option, "-1"]), &[option, expected]);
    }
    assert_refused(&run(&["compare", "--set", "=5"]), &["--set", "KEY=VALUE"]);
    assert_refused(
        &run(&["compare", "--set", "motion.kind=static"]),
        &["scenario file"],
    );
}

#[test]
fn diff_tells_bad_input_before_it_waits_for_others() {
    let long = ["diff", "--session", "nobody-else", "--join-timeout", "30"];
    let begun = std::time::Instant::now();
    for more in [["--recording", "nope.csv"], ["--baseline", "nope.json"]] {
        assert_refused(&run(&[&long[..], &more].concat()), &[more[1]]);
    }
    assert!(begun.elapsed().as_secs() < 20, "they were waited for");
}

#[test]
fn a_firmware_may_have_any_name() {
    use std::os::unix::ffi::OsStrExt as _;
    let folder = tempfile::tempdir().expect("a folder");
    let name = std::ffi::OsStr::from_bytes(b"odd\xff.elf");
    let file = folder.path().join(name);
    let image = cardan_tests::root().join("firmware/boards/atmega328p/images/tapped.elf");
    std::fs::copy(image, &file).expect("copied");
    let mut arguments: Vec<std::ffi::OsString> =
        ["compare", "--seconds", "0.3", "--quiet", "--firmware"]
            .map(Into::into)
            .into();
    arguments.push(file.into_os_string());
    let output = run(&arguments);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}",
        cardan_tests::stderr(&output)
    );
}

#[test]
fn documents_are_one_document_for_every_verb_that_prints() {
    for arguments in [&["completions", "bash", "--json"][..], &["man", "--json"]] {
        let output = run(arguments);
        let document = cardan_tests::document(&output);
        assert!(
            document.as_object().is_some_and(|texts| texts.len() == 1),
            "{arguments:?}"
        );
    }
}
