//! The page: whole, self-contained, safe against hostile names, and shown by a real browser.

mod support;

use std::path::Path;
use std::process::Command;

use cardan_compare::{Comparison, Node, compare, compare_with_plots, html};

fn page(comparison: &Comparison) -> String {
    let (report, plots) = compare_with_plots(comparison);
    html::page(&report, comparison, &plots)
}

/// A run that fails in several ways.
fn failing() -> Comparison {
    let mut comparison = support::comparison(1250);
    comparison.nodes[15].emulated.as_mut().unwrap()[700] ^= 1 << 3;
    comparison.nodes[13].tolerance.as_mut().unwrap().max_abs = 3e-5;
    comparison.frames.emulated[700][2] ^= 8;
    comparison.emulator.late_conversions = 2;
    comparison
}

#[test]
fn the_page_fetches_nothing() {
    let page = page(&support::comparison(60));
    for forbidden in [
        "http://", "https://", "src=", "<script", "<link", "@import", "url(",
    ] {
        assert!(!page.contains(forbidden), "{forbidden}");
    }
    assert!(page.contains("default-src 'none'"));
}

#[test]
fn every_part_of_the_report_is_on_the_page() {
    let comparison = failing();
    let report = compare(&comparison);
    let page = page(&comparison);
    assert!(page.contains("✗ Fail"));
    for node in &report.nodes {
        assert!(page.contains(&node.name), "{}", node.name);
    }
    assert_eq!(report.reasons.len(), 4, "{:?}", report.reasons);
    for expected in [
        "solution 700",
        "Error budget",
        "magnetometer.quality",
        "Longest interrupt latency",
        "18,302,144",
        "cardan compare --scenario tumble --seconds 10 --seed 1",
        "asin_term_1",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    assert!(!page.contains("NaN") && !page.contains("inf"));
}

#[test]
fn names_cannot_break_out_of_the_page() {
    let mut comparison = support::comparison(20);
    let hostile = "<img src=x onerror=alert(1)>\"'&";
    comparison.run.scenario = hostile.into();
    comparison.nodes[0].name = hostile.into();
    comparison.reproduce.command = hostile.into();
    let page = page(&comparison);
    assert!(!page.contains("<img"));
    assert!(page.contains("&lt;img"));
}

#[test]
fn a_run_with_nothing_in_it_still_makes_a_page() {
    let mut comparison = Comparison::default();
    assert!(page(&comparison).contains("✗ Fail"));
    comparison.nodes.push(Node::default());
    assert!(page(&comparison).contains("None in this run"));
}

/// Runs Chromium on a page; the test needs the Debian package `chromium`.
fn chromium(page: &Path, profile: &Path, arguments: &[&str]) -> Vec<u8> {
    let output = Command::new("chromium")
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
        ])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(arguments)
        .arg(format!("file://{}", page.display()))
        .output()
        .expect("chromium must be installed: apt-get install chromium");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}

#[test]
fn a_browser_shows_the_page_as_written() {
    let comparison = failing();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("compare-page");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(html::FILE);
    let written = page(&comparison);
    std::fs::write(&path, &written).unwrap();
    let profile = tempfile::tempdir().unwrap();
    let dom = chromium(&path, profile.path(), &["--dump-dom"]);
    let dom = String::from_utf8(dom).unwrap();
    // What the browser's parser made of it: as many elements as were written, none closed early.
    for element in [
        "<section", "<svg", "<path", "<rect", "<tr", "<td", "<figure", "<dd",
    ] {
        let count = |text: &str| text.matches(element).count();
        assert_eq!(count(&dom), count(&written), "{element}");
    }
    let picture = folder.join("report.png");
    let to = format!("--screenshot={}", picture.display());
    chromium(&path, profile.path(), &[&to, "--window-size=1200,5600"]);
    let png = std::fs::read(&picture).unwrap();
    assert!(png.starts_with(b"\x89PNG"));
}
