//! Recordings: made ones with known truth, every fault in a file, and the real ones.

use std::io::Write;
use std::path::{Path, PathBuf};

use cardan_scenario::rotation::{self, Quaternion};
use cardan_scenario::{Scenario, Stimulus, Trajectory, report};
use flate2::Compression;
use flate2::write::GzEncoder;
use nalgebra::{Matrix3, Vector3};
use tempfile::TempDir;

const HEADER: &str =
    "t_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT,ref_qw,ref_qx,ref_qy,ref_qz";

/// A file in a directory of its own.
fn file(name: &str, content: &[u8]) -> (TempDir, PathBuf) {
    let directory = tempfile::tempdir().expect("temporary directory");
    let path = directory.path().join(name);
    std::fs::write(&path, content).expect("write");
    (directory, path)
}

fn open(path: &Path) -> Result<Trajectory, cardan_scenario::Error> {
    Trajectory::new(&Scenario::default().with_recording(path), 1)
}

/// Fails unless the error for a file with `content` contains its name and every one of `parts`.
fn check(name: &str, content: &[u8], parts: &[&str]) {
    let (_directory, path) = file(name, content);
    let found = open(&path).expect_err("a faulty file").to_string();
    for part in parts.iter().chain([&name]) {
        assert!(found.contains(part), "'{part}' is missing in: {found}");
    }
}

/// Lines of a recording at rest, without reference.
fn resting(rows: u32) -> Vec<String> {
    let line = |k| {
        format!(
            "{:.4},0.0,0.0,9.81,5.0,20.0,-40.0,,,,",
            f64::from(k) * 0.0035
        )
    };
    std::iter::once(HEADER.to_string())
        .chain((0..rows).map(line))
        .collect()
}

fn with_line(number: usize, line: &str) -> Vec<u8> {
    let mut lines = resting(1000);
    lines[number - 1] = line.into();
    lines.join("\n").into_bytes()
}

#[test]
fn every_fault_of_a_file_is_told_with_its_place() {
    check("empty.csv", b"", &["is empty", "header"]);
    check("head.csv", HEADER.as_bytes(), &["0 rows", "at least 4"]);
    check(
        "short.csv",
        resting(3).join("\n").as_bytes(),
        &["3 rows", "at least 4"],
    );
    let missing = with_line(1, &HEADER.replace("mag_y_uT", "mag_y_nT"));
    check(
        "missing.csv",
        &missing,
        &["line 1", "'mag_y_uT' is missing", "mag_y_nT"],
    );
    let missing = with_line(1, &HEADER.replace("ref_qy", "q2"));
    check("reference.csv", &missing, &["'ref_qy' is missing"]);
    let cell = |text: &str| with_line(7, &format!("0.0175,0.0,{text},9.81,5.0,20.0,-40.0,,,,"));
    check(
        "text.csv",
        &cell("abc"),
        &["line 7", "'acc_y_m_s2'", "'abc' is not a finite number"],
    );
    check(
        "nan.csv",
        &cell("NaN"),
        &["line 7", "'acc_y_m_s2'", "not a finite number"],
    );
    check(
        "inf.csv",
        &cell("-inf"),
        &["line 7", "'acc_y_m_s2'", "not a finite number"],
    );
    check(
        "huge.csv",
        &cell("1e300"),
        &["line 7", "'acc_y_m_s2'", "out of reason"],
    );
    check(
        "hole.csv",
        &cell(""),
        &["line 7", "'acc_y_m_s2'", "only ref_* columns may be"],
    );
    check(
        "cells.csv",
        &with_line(7, "0.0175,0.0"),
        &["line 7", "2 cells", "header has 11"],
    );
    let back = with_line(9, "0.0210,0.0,0.0,9.81,5.0,20.0,-40.0,,,,");
    check(
        "time.csv",
        &back,
        &["line 9", "'t_s'", "time must increase"],
    );
    let part = with_line(9, "0.0245,0.0,0.0,9.81,5.0,20.0,-40.0,1.0,,0.0,0.0");
    check(
        "part.csv",
        &part,
        &["line 9", "'ref_qx'", "is empty while other"],
    );
    let long = with_line(9, "0.0245,0.0,0.0,9.81,5.0,20.0,-40.0,1.0,1.0,0.0,0.0");
    check(
        "long.csv",
        &long,
        &["line 9", "length 1.4142", "expected 1"],
    );
    let binary = with_line(9, "0.0245,\u{0}\u{1},0.0,9.81,5.0,20.0,-40.0,,,,");
    check("binary.csv", &binary, &["line 9", "'acc_x_m_s2'"]);
    check("latin.csv", b"t_s\n\xff\xfe\n", &["t_s"]);
}

#[test]
fn a_missing_file_is_told_by_name() {
    let found = open(Path::new("no/such.csv"))
        .expect_err("missing")
        .to_string();
    assert!(found.contains("no/such.csv"), "{found}");
}

#[test]
fn truncated_and_damaged_compressed_files_are_told_so() {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder
        .write_all(resting(2000).join("\n").as_bytes())
        .expect("compress");
    let whole = encoder.finish().expect("compress");
    check("cut.csv.gz", &whole[..whole.len() / 2], &["truncated"]);
    check("cut2.csv.gz", &whole[..whole.len() - 4], &["truncated"]);
    let mut damaged = whole.clone();
    let middle = damaged.len() / 2;
    damaged[middle..middle + 8].fill(0xaa);
    check("damaged.csv.gz", &damaged, &[]);
    let (_directory, path) = file("whole.csv", &whole);
    assert!(open(&path).is_ok(), "compression is told by content");
}

#[test]
fn implausible_physics_is_refused_with_the_key_that_mends_it() {
    let in_g = resting(1000).join("\n").replace("9.81", "1.00");
    check(
        "in_g.csv",
        in_g.as_bytes(),
        &["1.0000 m/s^2", "motion.recording.gravity_m_s2"],
    );
    let dead = resting(1000)
        .join("\n")
        .replace("5.0,20.0,-40.0", "0.0,0.0,0.0");
    check(
        "dead.csv",
        dead.as_bytes(),
        &["heading", "field.horizontal_ut"],
    );
}

/// Orientation of sensor axes in ENU at `t_s` of the made recording: slow turns about all axes.
fn made_orientation(t_s: f64) -> Quaternion {
    let swing = |f: f64, phase: f64| libm::sin(2.0 * std::f64::consts::PI * f * t_s + phase);
    let (s, c) = libm::sincos(0.5 * (0.9 * t_s));
    let tilt = rotation::normalised([1.0, 0.3 * swing(0.2, 0.0), 0.3 * swing(0.17, 1.0), 0.0]);
    // Heading, then tilt: product of quaternions (c, 0, 0, s) and tilt.
    [
        c * tilt[0],
        c * tilt[1] - s * tilt[2],
        c * tilt[2] + s * tilt[1],
        s * tilt[0],
    ]
}

/// Time of the motion, which starts smoothly after two seconds of rest.
fn moving(t_s: f64) -> f64 {
    let u = (t_s - 2.0).max(0.0);
    u * u * u / (1.0 + u * u)
}

/// A recording at 285.7 Hz of that motion in a field of (20 uT to 10 degrees east, 40 uT down), the
/// reference lost between 6 and 8 s.
fn made(with_reference: bool) -> Vec<u8> {
    let mut lines = vec![HEADER.to_string()];
    let declination = 10.0_f64.to_radians();
    let field = Vector3::new(20.0 * declination.sin(), 20.0 * declination.cos(), -40.0);
    for k in 0..8000 {
        let q = made_orientation(moving(f64::from(k) * 0.0035));
        let to_sensor = rotation::from_quaternion(q).transpose();
        let (f, b) = (to_sensor * Vector3::new(0.0, 0.0, 9.7), to_sensor * field);
        let known = with_reference && !(1714..=2285).contains(&k) && k % 3 == 0;
        let reference = match known {
            true => format!("{},{},{},{}", q[0], q[1], q[2], q[3]),
            false => ",,,".into(),
        };
        let t = 5.0 + f64::from(k) * 0.0035;
        lines.push(format!(
            "{t},{},{},{},{},{},{},{reference}",
            f.x, f.y, f.z, b.x, b.y, b.z
        ));
    }
    lines.join("\n").into_bytes()
}

/// True attitude of the made recording: magnetic NED to body, by the default mounting.
fn made_truth(t_s: f64) -> Matrix3<f64> {
    let mounting = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let (s, c) = libm::sincos(10.0_f64.to_radians());
    let ned_to_enu = Matrix3::new(s, c, 0.0, c, -s, 0.0, 0.0, 0.0, -1.0);
    let to_sensor = rotation::from_quaternion(made_orientation(moving(t_s))).transpose();
    mounting * to_sensor * ned_to_enu
}

#[test]
fn a_made_recording_gives_back_field_gravity_truth_and_experience() {
    let (_directory, path) = file("made.csv", &made(true));
    let recording = open(&path).expect("valid");
    assert!((recording.duration_s().expect("ends") - 7999.0 * 0.0035).abs() < 1e-9);
    let field = recording.field();
    assert!((field.horizontal_ut - 20.0).abs() < 1e-6 && (field.vertical_ut - 40.0).abs() < 1e-6);
    for k in 0..2000 {
        let t = 0.0137 * f64::from(k);
        let truth = made_truth(t);
        let experience = recording.at(t);
        let gravity = -Vector3::from(experience.specific_force_g);
        let earth = Vector3::new(20.0, 0.0, 40.0);
        assert!((gravity - truth.column(2)).norm() < 1e-5, "{t}");
        assert!(
            (Vector3::from(experience.field_ut) - truth * earth).norm() < 1e-3,
            "{t}"
        );
        match recording.truth_at(t) {
            // Slerp over 10.5 ms misses an acceleration of 2 rad/s^2 by up to 3e-5 rad.
            Some(found) => assert!(rotation::angle_between(&found, &truth) < 5e-5, "{t}"),
            None => assert!((5.97..8.03).contains(&t) || t > 27.97, "no truth at {t}"),
        }
        assert!(
            !(6.05..7.95).contains(&t) || recording.truth_at(t).is_none(),
            "in the gap: {t}"
        );
    }
    assert!(recording.truth_at(-0.1).is_none() && recording.truth_at(100.0).is_none());
}

#[test]
fn without_a_reference_field_and_dip_come_from_rest_and_are_reported() {
    let (_directory, path) = file("made.csv", &made(false));
    let scenario = Scenario::default().with_recording(&path);
    let recording = Trajectory::new(&scenario, 1).expect("valid");
    assert!(!recording.has_truth() && recording.truth_at(3.0).is_none());
    let field = recording.field();
    assert!((field.horizontal_ut - 20.0).abs() < 1e-3 && (field.vertical_ut - 40.0).abs() < 1e-3);
    let listed = report::assumptions(&scenario, &recording);
    for key in [
        "field.horizontal_ut",
        "field.vertical_ut",
        "motion.recording.gravity_m_s2",
    ] {
        assert!(listed.iter().any(|a| a.key == key), "{key}");
    }
}

#[test]
fn an_explicit_field_is_taken_instead_of_the_estimate() {
    let (_directory, path) = file("made.csv", &made(true));
    let mut scenario = Scenario::default().with_recording(&path);
    scenario.field.horizontal_ut = Some(21.0);
    scenario.field.vertical_ut = Some(39.0);
    let recording = Trajectory::new(&scenario, 1).expect("valid");
    assert_eq!(
        (
            recording.field().horizontal_ut,
            recording.field().vertical_ut
        ),
        (21.0, 39.0)
    );
    let truth = recording.truth_at(4.0).expect("has a reference");
    assert!(
        rotation::angle_between(&truth, &made_truth(4.0)) < 1e-5,
        "magnetic north stays"
    );
}

#[test]
fn tones_pass_the_resampling_with_the_stated_gain_and_image() {
    // Gains of Catmull-Rom (Keys' cubic convolution) by numerical Fourier transform of its kernel.
    for (share, gain, image) in [
        (0.1, 0.9981, 0.0037),
        (0.175, 0.9836, 0.0190),
        (0.25, 0.939, 0.0626),
    ] {
        let hz = share / 0.0035;
        let turn = 2.0 * std::f64::consts::PI;
        let mut lines = resting(0);
        for k in 0..4000 {
            let t = f64::from(k) * 0.0035;
            let tone = if k < 1000 {
                0.0
            } else {
                libm::sin(turn * hz * t)
            };
            lines.push(format!("{t},{tone},0.0,9.81,5.0,20.0,-40.0,,,,"));
        }
        let (_directory, path) = file("tone.csv", lines.join("\n").as_bytes());
        let recording = open(&path).expect("valid");
        let amplitude = |hz: f64| {
            let (mut s, mut c, n) = (0.0, 0.0, 100_000);
            for k in 0..n {
                // 2,800 whole sampling intervals hold whole periods of all three tones and images.
                let t = 3.85 + 9.8 * (f64::from(k) + 0.5) / f64::from(n);
                let (sine, cosine) = libm::sincos(turn * hz * t);
                let force = recording.at(t).specific_force_g[1] * 9.81;
                (s, c) = (s + force * sine, c + force * cosine);
            }
            2.0 * (s * s + c * c).sqrt() / f64::from(n)
        };
        assert!(
            (amplitude(hz) - gain).abs() < 5e-4,
            "{hz}: {}",
            amplitude(hz)
        );
        let image_hz = 1.0 / 0.0035 - hz;
        assert!(
            amplitude(image_hz) < image + 5e-4,
            "{hz}: image {}",
            amplitude(image_hz)
        );
    }
}

#[test]
fn after_its_end_a_recording_holds_its_last_value() {
    let (_directory, path) = file("made.csv", &made(true));
    let recording = open(&path).expect("valid");
    let end = recording.duration_s().expect("ends");
    assert_eq!(recording.at(end), recording.at(end + 10.0));
}

/// The folder of real recordings (BROAD): what `CARDAN_RECORDINGS` names, and must be there then, else
/// one beside the repository. A checkout without cannot run a test on them, and says so past the
/// harness, which would keep it to itself.
fn real() -> Option<PathBuf> {
    if let Some(folder) = std::env::var_os("CARDAN_RECORDINGS") {
        return Some(folder.into());
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder = root.join("../shared/data/broad");
    if !folder.exists() {
        let _ = writeln!(
            std::io::stderr(),
            "NOT RUN: {} is missing; CARDAN_RECORDINGS may name another folder",
            folder.display()
        );
        return None;
    }
    Some(folder)
}

#[test]
fn real_recordings_agree_with_their_own_reference() {
    let names = [
        ("02_undisturbed_slow_rotation_B.csv.gz", 186.0),
        ("05_undisturbed_slow_rotation_with_breaks_B.csv.gz", 207.0),
    ];
    let Some(folder) = real() else { return };
    for (name, seconds) in names {
        let recording = open(&folder.join(name)).expect("valid");
        let duration = recording.duration_s().expect("ends");
        assert!((duration - seconds).abs() < 1.0, "{duration}");
        let field = recording.field();
        assert!((field.total_ut() - 45.0).abs() < 2.0, "{field:?}");
        let (mut known, mut gravity_off, mut field_off) = (0, Vec::new(), Vec::new());
        let n = 2000;
        for k in 0..n {
            let t = duration * f64::from(k) / f64::from(n);
            let Some(truth) = recording.truth_at(t) else {
                continue;
            };
            known += 1;
            let experience = recording.at(t);
            let down = -Vector3::from(experience.specific_force_g).normalize();
            gravity_off.push(libm::acos(down.dot(&truth.column(2)).min(1.0)).to_degrees());
            let earth = truth * Vector3::new(field.horizontal_ut, 0.0, field.vertical_ut);
            let measured = Vector3::from(experience.field_ut).normalize();
            field_off.push(libm::acos(measured.dot(&earth.normalize()).min(1.0)).to_degrees());
        }
        gravity_off.sort_by(f64::total_cmp);
        field_off.sort_by(f64::total_cmp);
        let median = |v: &[f64]| v[v.len() / 2];
        println!("{name}: {known} of {n} with reference; {field:?};");
        println!(
            "  median angle: gravity {}, field {}",
            median(&gravity_off),
            median(&field_off)
        );
        // A wrong mounting, frame or sign is off by tens of degrees; sensor errors by a few.
        assert!(known > n * 6 / 10, "{known}");
        assert!(median(&gravity_off) < 2.0 && median(&field_off) < 3.0);
    }
}
