//! What is not understood is refused with the mend.

use std::io::Write as _;
use std::path::Path;

use cardan_scenario::Scenario;
use flate2::Compression;
use flate2::write::GzEncoder;

use crate::swing::*;

#[test]
fn what_is_not_understood_is_refused_with_the_mend() {
    let text = |header: &str| table(header, ",", |_, v| plain(v));
    let renamed = |from: &str, to: &str| text(&HEADER.replace(from, to));
    let cases = [
        (
            "no unit",
            renamed("_m_s2", ""),
            &["line 1", "acc_x", "tells no unit", "_g or _mg"][..],
        ),
        (
            "unknown unit",
            renamed("_m_s2", "_furlong"),
            &["line 1", "furlong", "_m_s2"],
        ),
        (
            "time without unit",
            renamed("t_s", "time"),
            &["line 2", "'time'", "t_ms"],
        ),
        (
            "twice",
            renamed("acc_x_m_s2", "acc_x_g,ax_g"),
            &["acc_x_g", "ax_g"],
        ),
        (
            "angles",
            format!("{HEADER},ref_roll_deg,ref_pitch_deg,ref_yaw_deg\n"),
            &["ref_roll_deg", "quaternion"],
        ),
        (
            "dates",
            text(HEADER).replace("\n0.400000,", "\n2024-05-01 12:00:00.4,"),
            &["line 102", "'t_s'", "date"],
        ),
        (
            "commas twice",
            table(HEADER, ",", |_, v| {
                plain(v).into_iter().map(|c| c.replace('.', ",")).collect()
            }),
            &["line 2", "14 cells", "semicolons"],
        ),
        (
            "no header",
            text(HEADER)[HEADER.len() + 1..].to_owned(),
            &["line 1", "numbers where the header", "t_s"],
        ),
        (
            "ms called s",
            in_units(HEADER, [1e3, 1.0, 1.0]),
            &["4 s apart", "t_ms"],
        ),
        (
            "g called m/s^2",
            in_units(HEADER, [1.0, 1.0 / G, 1.0]),
            &["acc_x_g", "motion.recording.gravity_m_s2"],
        ),
        (
            "mg called m/s^2",
            in_units(HEADER, [1.0, 1e3 / G, 1.0]),
            &["acc_x_mg"],
        ),
        (
            "linear acceleration",
            in_units(HEADER, [1.0, 1e-3, 1.0]),
            &["gravity has been taken out"],
        ),
        (
            "nT called uT",
            in_units(HEADER, [1.0, 1.0, 1e3]),
            &["mag_x_nT"],
        ),
        (
            "gauss called uT",
            in_units(HEADER, [1.0, 1.0, 1e-2]),
            &["mag_x_gauss"],
        ),
        (
            "gravity",
            in_units(HEADER, [1.0, -1.0, 1.0]),
            &["motion.recording.acc_is_gravity=true", "southern"],
        ),
        (
            "a long line",
            format!("{HEADER}\n{}", "1".repeat(1 << 20)),
            &["line 2", "longer than"],
        ),
        (
            "a long header",
            "a,".repeat(1 << 20),
            &["line 1", "longer than"],
        ),
        (
            "many cells",
            format!("{HEADER}\n{}", "1,".repeat(30_000)),
            &["line 2", "30001 cells"],
        ),
        ("HDF5", "\u{89}HDF".to_owned(), &["line 1"]),
    ];
    for (what, content, parts) in cases {
        assert_refused(what, content.as_bytes(), parts);
    }
    assert_refused("HDF5", b"\x89HDF\r\n\x1a\n", &["HDF5", "CSV"]);
    assert_refused("UTF-32", b"\xff\xfe\0\0t\0\0\0", &["UTF-32"]);
    let mut zeros = GzEncoder::new(Vec::new(), Compression::best());
    for _ in 0..64 {
        zeros.write_all(&vec![0; 1 << 20]).expect("compressed");
    }
    assert_refused(
        "a gz of zeros",
        &zeros.finish().expect("compressed"),
        &["no text"],
    );
    let mut empty = GzEncoder::new(Vec::new(), Compression::best());
    empty.write_all(HEADER.as_bytes()).expect("compressed");
    for _ in 0..4 {
        empty.write_all(&vec![b'\n'; 1 << 20]).expect("compressed");
    }
    assert_refused(
        "a gz of line ends",
        &empty.finish().expect("compressed"),
        &["without a sample"],
    );
}

#[test]
fn what_is_no_file_is_refused_at_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let pipe = folder.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.expect("mkfifo runs").success());
    for (path, part) in [
        (folder.path(), "folder"),
        (&pipe, "pipe"),
        (Path::new("/dev/zero"), "device"),
        (Path::new("/dev/null"), "device"),
    ] {
        let error = open_with(path, &[]).expect_err("no recording");
        assert!(error.contains(part), "{error}");
        let error = Scenario::load(path.to_str().expect("text")).expect_err("no scenario");
        assert!(error.to_string().contains(part), "{error}");
    }
}
