//! The results that the target's own tests compare with are the host's.
//!
//! `CARDAN_WRITE_EXPECTED=1 cargo test -p cardan-firmware --test target_results` writes them anew,
//! for a firmware that is meant to compute something else.

#![allow(missing_docs, reason = "shared with the board's tests")]

mod target;

use std::fmt::Write;
use std::path::Path;

use cardan_firmware::frame::Frame;
use cardan_spec::flags;
use target::{EXPECTED, Results, SOLUTIONS};

fn results() -> Results {
    let mut frames = [Frame::default(); SOLUTIONS];
    let complete = target::solutions(|number, frame| {
        frames[number] = *frame;
        true
    });
    assert!(complete, "a solution's codes make one solution");
    Results {
        products: target::products(),
        long_products: target::long_products(),
        quotients: target::quotients(),
        roots: target::roots(),
        sums: target::sums(),
        frames,
    }
}

fn write(results: &Results) {
    let mut text = String::from("// Written by the host: see ../target_results.rs.\n");
    let _ = writeln!(text, "{results:#?}");
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/target/expected.in");
    std::fs::write(&file, text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
}

#[test]
fn the_committed_results_are_the_hosts() {
    let results = results();
    if std::env::var_os("CARDAN_WRITE_EXPECTED").is_some() {
        write(&results);
        return;
    }
    assert_eq!(results, EXPECTED, "see the head of this file");
}

#[test]
fn the_solutions_differ_from_each_other_and_most_are_valid() {
    let frames = results().frames;
    // The attitudes jump, so the half space gets lost on the way, and one lies at the horizon, where the
    // heading is noise, which the next remember; nothing else is odd.
    let valid = frames.iter().filter(|frame| frame.flags == 0).count();
    assert!(valid >= SOLUTIONS / 3, "{frames:?}");
    let is_odd = |frame: &Frame| frame.flags & !(flags::HALF_SPACE | flags::INCONSISTENT) != 0;
    assert!(!frames.iter().any(is_odd), "{frames:?}");
    for pair in frames.windows(2) {
        assert_ne!(pair[0].angles, pair[1].angles);
    }
}
