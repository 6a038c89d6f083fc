//! The swing that every recording here tells of, as text, and what reading one of them gives.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cardan_scenario::{Scenario, Stimulus, Trajectory};
use tempfile::TempDir;

pub(crate) const G: f64 = 9.806_65;

/// One sample of a slow swing: seconds, m/s^2, microtesla.
pub(crate) fn sample(k: u32) -> [f64; 7] {
    let t = f64::from(k) * 0.004;
    let angle = 0.15 * (1.0 - libm::cos(2.0 * (t - 1.0).max(0.0)));
    let (s, c) = libm::sincos(angle);
    [
        t,
        0.0,
        G * s,
        G * c,
        5.0,
        20.0 * c - 40.0 * s,
        -40.0 * c - 20.0 * s,
    ]
}

pub(crate) const ROWS: u32 = 1500;

/// A table of the swing: how a row looks, how cells are parted.
pub(crate) fn table(
    header: &str,
    between: &str,
    row: impl Fn(u32, [f64; 7]) -> Vec<String>,
) -> String {
    let rows = (0..ROWS).map(|k| row(k, sample(k)).join(between));
    std::iter::once(header.to_owned())
        .chain(rows)
        .collect::<Vec<_>>()
        .join("\n")
        + "\n"
}

pub(crate) fn plain(values: [f64; 7]) -> Vec<String> {
    values.map(|value| format!("{value:.6}")).into()
}

pub(crate) const HEADER: &str = "t_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT";

pub(crate) fn file(content: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("found.csv");
    std::fs::write(&path, content).expect("written");
    (folder, path)
}

pub(crate) fn open_with(path: &Path, set: &[(&str, f64)]) -> Result<Trajectory, String> {
    let mut scenario = Scenario::default().with_recording(path);
    for (key, value) in set {
        scenario
            .set(key, *value)
            .map_err(|error| error.to_string())?;
    }
    Trajectory::new(&scenario, 1).map_err(|error| error.to_string())
}

/// The content is the swing.
pub(crate) fn assert_same(what: &str, content: &[u8], set: &[(&str, f64)], within: f64) {
    let (_kept, contract) = file(table(HEADER, ",", |_, v| plain(v)).as_bytes());
    let (_folder, path) = file(content);
    let expected = open_with(&contract, &[]).expect("the contract's form");
    let found = open_with(&path, set).unwrap_or_else(|error| panic!("{what}: {error}"));
    let both = [&expected, &found].map(|one| one.duration_s().expect("ends"));
    assert!((both[0] - both[1]).abs() < 0.02, "{what}: {both:?}");
    for step in 0..100 {
        let t = 0.05 + 0.057 * f64::from(step);
        let (a, b) = (expected.at(t), found.at(t));
        for axis in 0..3 {
            let force = (a.specific_force_g[axis] - b.specific_force_g[axis]).abs();
            let field = (a.field_ut[axis] - b.field_ut[axis]).abs();
            assert!(
                force < within && field < 50.0 * within,
                "{what}, {t} s: {a:?} {b:?}"
            );
        }
    }
}

/// The content is refused in one line that says all of `parts`.
pub(crate) fn assert_refused(what: &str, content: &[u8], parts: &[&str]) {
    let (_folder, path) = file(content);
    let begin = Instant::now();
    let error = open_with(&path, &[])
        .err()
        .unwrap_or_else(|| panic!("{what} is read"));
    assert!(begin.elapsed() < Duration::from_secs(60), "{what}");
    assert_eq!(error.lines().count(), 1, "{what}: {error}");
    assert!(error.len() < 1000, "{what}: {error}");
    for part in parts {
        assert!(error.contains(part), "{what}: says {error:?}, not {part:?}");
    }
}

pub(crate) fn in_units(header: &str, factors: [f64; 3]) -> String {
    table(header, ",", |_, v| {
        let [t, force, field] = factors;
        let scaled = [
            v[0] * t,
            v[1] * force,
            v[2] * force,
            v[3] * force,
            v[4] * field,
            v[5] * field,
            v[6] * field,
        ];
        scaled.map(|value| format!("{value:.13}")).into()
    })
}
