//! Recordings as loggers write them: the same motion in other units, separators, encodings and
//! containers is the same recording; what is not understood is refused with the mend.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cardan_scenario::{Scenario, Stimulus, Trajectory};
use flate2::Compression;
use flate2::write::{DeflateEncoder, GzEncoder};
use tempfile::TempDir;

const G: f64 = 9.806_65;

/// One sample of a slow swing: seconds, m/s^2, microtesla.
fn sample(k: u32) -> [f64; 7] {
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

const ROWS: u32 = 1500;

/// A table of the swing: how a row looks, how cells are parted.
fn table(header: &str, between: &str, row: impl Fn(u32, [f64; 7]) -> Vec<String>) -> String {
    let rows = (0..ROWS).map(|k| row(k, sample(k)).join(between));
    std::iter::once(header.to_owned())
        .chain(rows)
        .collect::<Vec<_>>()
        .join("\n")
        + "\n"
}

fn plain(values: [f64; 7]) -> Vec<String> {
    values.map(|value| format!("{value:.6}")).into()
}

const HEADER: &str = "t_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT";

fn file(content: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("found.csv");
    std::fs::write(&path, content).expect("written");
    (folder, path)
}

fn open_with(path: &Path, set: &[(&str, f64)]) -> Result<Trajectory, String> {
    let mut scenario = Scenario::default().with_recording(path);
    for (key, value) in set {
        scenario
            .set(key, *value)
            .map_err(|error| error.to_string())?;
    }
    Trajectory::new(&scenario, 1).map_err(|error| error.to_string())
}

/// The content is the swing.
fn assert_same(what: &str, content: &[u8], set: &[(&str, f64)], within: f64) {
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
fn assert_refused(what: &str, content: &[u8], parts: &[&str]) {
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

fn in_units(header: &str, factors: [f64; 3]) -> String {
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

#[test]
fn other_units_and_names_are_the_same() {
    let cases: [(&str, [f64; 3]); 12] = [
        (
            "t_ms,acc_x_g,acc_y_g,acc_z_g,mag_x_nT,mag_y_nT,mag_z_nT",
            [1e3, 1.0 / G, 1e3],
        ),
        (
            "t_us,acc_x_mg,acc_y_mg,acc_z_mg,mag_x_gauss,mag_y_gauss,mag_z_gauss",
            [1e6, 1e3 / G, 1e-2],
        ),
        (
            "t_ns,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_mT,mag_y_mT,mag_z_mT",
            [1e9, 1.0, 1e-3],
        ),
        (
            "time_s,ax_g,ay_g,az_g,mx_uT,my_uT,mz_uT",
            [1.0, 1.0 / G, 1.0],
        ),
        (
            "Time (s),Acceleration x (m/s^2),Acceleration y (m/s^2),Acceleration z (m/s^2),Magnetic field x (µT),Magnetic field y (µT),Magnetic field z (µT)",
            [1.0, 1.0, 1.0],
        ),
        (
            "timestamp_ms,accX [mg],accY [mg],accZ [mg],magX [mG],magY [mG],magZ [mG]",
            [1e3, 1e3 / G, 10.0],
        ),
        (
            "elapsed (ms),accel_x (m/s²),accel_y (m/s²),accel_z (m/s²),mag_x (T),mag_y (T),mag_z (T)",
            [1e3, 1.0, 1e-6],
        ),
        (
            "seconds,acc.x.g,acc.y.g,acc.z.g,mag.x.uT,mag.y.uT,mag.z.uT",
            [1.0, 1.0 / G, 1.0],
        ),
        (
            "t,a_x,a_y,a_z,b_x,b_y,b_z\nms,g,g,g,uT,uT,uT",
            [1e3, 1.0 / G, 1.0],
        ),
        (
            "t [s]; units below,acc_x,acc_y,acc_z,mag_x,mag_y,mag_z",
            [1.0, 1.0, 1.0],
        ),
        (
            "T_MS,ACC_X_MG,ACC_Y_MG,ACC_Z_MG,MAG_X_NT,MAG_Y_NT,MAG_Z_NT",
            [1e3, 1e3 / G, 1e3],
        ),
        (
            "t_s,accelerometer_x_g,accelerometer_y_g,accelerometer_z_g,magnetometer_x_Gs,magnetometer_y_Gs,magnetometer_z_Gs",
            [1.0, 1.0 / G, 1e-2],
        ),
    ];
    for (header, factors) in cases {
        let text = in_units(header, factors);
        if header.contains("units below") {
            assert_refused(header, text.as_bytes(), &["line 1"]);
        } else {
            assert_same(header, text.as_bytes(), &[], 2e-6);
        }
    }
}

#[test]
fn times_since_1970_keep_their_digits() {
    for (start, per_second) in [(1.7e9, 1.0), (1.7e12, 1e3), (1.7e15, 1e6), (1.7e18, 1e9)] {
        for name in ["timestamp", "time", "unix"] {
            let header = HEADER.replacen("t_s", name, 1);
            let text = table(&header, ",", |k, v| {
                let mut cells = plain(v);
                cells[0] = match per_second {
                    1.0 => format!("{}.{:03}", start as u64 + u64::from(k / 250), k % 250 * 4),
                    _ => (start as i64 + i64::from(k) * (per_second as i64) / 250).to_string(),
                };
                cells
            });
            assert_same(name, text.as_bytes(), &[], 1e-5);
        }
    }
}

#[test]
fn separators_commas_comments_and_line_ends_as_found() {
    let header = |between: &str| HEADER.replace(',', between);
    let comma = |v| {
        plain(v)
            .into_iter()
            .map(|cell| cell.replace('.', ","))
            .collect()
    };
    let semicolons = table(&header(";"), ";", |_, v| plain(v));
    let german = table(&header(";"), ";", |_, v| comma(v));
    let contract = table(HEADER, ",", |_, v| plain(v));
    let quoted = table(&format!("\"{}\"", header("\",\"")), ",", |_, v| {
        plain(v)
            .into_iter()
            .map(|cell| format!("\"{cell}\""))
            .collect()
    });
    let commented = contract.replace("\n0.400000,", "\n# shaken\n\n0.400000,");
    let cases = [
        ("semicolons", semicolons.clone()),
        ("semicolons and commas", german.clone()),
        ("tabs", table(&header("\t"), "\t", |_, v| plain(v))),
        (
            "tabs and commas",
            table(&header("\t"), "\t", |_, v| comma(v)),
        ),
        ("spaces", table(&header("  "), "   ", |_, v| plain(v))),
        ("quotation marks", quoted),
        ("CRLF", contract.replace('\n', "\r\n")),
        ("CR", contract.replace('\n', "\r")),
        ("comments", commented),
        ("a comment as header", format!("# {contract}")),
        ("Excel's first line", format!("sep=;\r\n{semicolons}")),
        (
            "a preamble",
            format!("Device,X12\nRate,250 Hz\n\n{contract}"),
        ),
        ("closing separators", contract.replace('\n', ",\n")),
        ("UTF-8 with a mark", format!("\u{feff}{contract}")),
    ];
    for (what, text) in cases {
        assert_same(what, text.as_bytes(), &[], 2e-6);
    }
}

#[test]
fn encodings_and_containers_as_found() {
    let text = table(&format!("# 25 °C, Gerät\n{HEADER}"), ",", |_, v| plain(v));
    let utf16 = |big: bool, mark: bool| -> Vec<u8> {
        let text = if mark {
            format!("\u{feff}{text}")
        } else {
            text[text.find("t_s").expect("there")..].to_owned()
        };
        let bytes = |unit: u16| {
            if big {
                unit.to_be_bytes()
            } else {
                unit.to_le_bytes()
            }
        };
        text.encode_utf16().flat_map(bytes).collect()
    };
    for (big, mark) in [(false, true), (true, true), (false, false), (true, false)] {
        assert_same("UTF-16", &utf16(big, mark), &[], 2e-6);
    }
    let latin: Vec<u8> = text.chars().map(|letter| letter as u32 as u8).collect();
    assert_same("Latin-1", &latin, &[], 2e-6);
    let mut gz = GzEncoder::new(Vec::new(), Compression::fast());
    gz.write_all(&utf16(false, true)).expect("compressed");
    assert_same(
        "UTF-16 in gzip",
        &gz.finish().expect("compressed"),
        &[],
        2e-6,
    );
    for packed in [false, true] {
        let archive = zip(&[("found.csv", text.as_bytes())], packed);
        assert_same("zip", &archive, &[], 2e-6);
        let with_folder = zip(
            &[
                ("__MACOSX/._found.csv", b"x"),
                ("found.csv", text.as_bytes()),
            ],
            packed,
        );
        assert_same("zip of a Mac", &with_folder, &[], 2e-6);
        let mut damaged = archive.clone();
        damaged[2000] ^= 0x55;
        assert_refused("damaged zip", &damaged, &["found.csv"]);
        assert_refused("cut zip", &archive[..archive.len() / 2], &["zip archive"]);
    }
    let two = zip(&[("a.csv", b"x"), ("b.csv", b"y")], false);
    assert_refused("two files", &two, &["2 files", "a.csv, b.csv", "unpack"]);
    let excel = zip(&[("[Content_Types].xml", b"x"), ("xl/a.xml", b"y")], false);
    assert_refused("xlsx", &excel, &["Excel", "save it as CSV"]);
}

/// A zip archive (PKWARE APPNOTE 6.3.10) of these files.
fn zip(files: &[(&str, &[u8])], packed: bool) -> Vec<u8> {
    let (mut archive, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in files {
        let mut crc = flate2::Crc::new();
        crc.update(content);
        let data = if packed {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
            encoder.write_all(content).expect("compressed");
            encoder.finish().expect("compressed")
        } else {
            content.to_vec()
        };
        let method: u16 = if packed { 8 } else { 0 };
        let mut common = Vec::new();
        common.extend([20, 0, 0, 0]);
        common.extend(method.to_le_bytes());
        common.extend([0; 4]);
        common.extend(crc.sum().to_le_bytes());
        common.extend((data.len() as u32).to_le_bytes());
        common.extend((content.len() as u32).to_le_bytes());
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0; 2]);
        let offset = archive.len() as u32;
        archive.extend(b"PK\x03\x04");
        archive.extend(&common);
        archive.extend(name.as_bytes());
        archive.extend(&data);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&common);
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let start = archive.len() as u32;
    archive.extend(&directory);
    archive.extend(b"PK\x05\x06\0\0\0\0");
    archive.extend(
        [
            (files.len() as u16).to_le_bytes(),
            (files.len() as u16).to_le_bytes(),
        ]
        .concat(),
    );
    archive.extend((directory.len() as u32).to_le_bytes());
    archive.extend(start.to_le_bytes());
    archive.extend([0, 0]);
    archive
}

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

#[test]
fn gravity_is_turned_round_when_the_user_says_so_and_not_twice() {
    let turned = in_units(HEADER, [1.0, -1.0, 1.0]);
    let set = [("motion.recording.acc_is_gravity", 1.0)];
    assert_same("gravity", turned.as_bytes(), &set, 2e-6);
    // South of the equator it is right as it is.
    let (_folder, path) = file(turned.as_bytes());
    let south = open_with(&path, &[("motion.recording.acc_is_gravity", 0.0)]).expect("read");
    assert!(south.field().vertical_ut < -30.0);
    // With a reference there is no doubt.
    let header = format!("{HEADER},ref_qw,ref_qx,ref_qy,ref_qz");
    for (sign, is_right) in [(1.0, true), (-1.0, false)] {
        let text = table(&header, ",", |_, v| {
            let half = 0.5 * libm::asin(v[2] / G);
            let mut cells = plain([v[0], v[1], sign * v[2], sign * v[3], v[4], v[5], v[6]]);
            cells.extend([libm::cos(half), libm::sin(half), 0.0, 0.0].map(|q| format!("{q:.9}")));
            cells
        });
        let (_folder, path) = file(text.as_bytes());
        for stated in [None, Some(0.0), Some(1.0)] {
            let set: Vec<_> = stated
                .iter()
                .map(|&v| ("motion.recording.acc_is_gravity", v))
                .collect();
            let expected = is_right != (stated == Some(1.0));
            let found = open_with(&path, &set);
            assert_eq!(
                found.is_ok(),
                expected,
                "{sign} {stated:?}: {:?}",
                found.err()
            );
            if let Err(error) = found {
                assert!(error.contains("motion.recording.acc_is_gravity"), "{error}");
            }
        }
    }
}

#[test]
fn a_slower_magnetometer_is_interpolated_on_demand() {
    let slow = table(HEADER, ",", |k, v| {
        let mut cells = plain(v);
        if k % 5 != 2 {
            cells[4..].fill(String::new());
        }
        cells
    });
    assert_refused(
        "slow",
        slow.as_bytes(),
        &[
            "line 2",
            "mag_x_uT",
            "--set motion.recording.interpolate_mag=true",
        ],
    );
    // The first two rows go; the rest is 8 ms later then.
    let (_folder, path) = file(slow.as_bytes());
    let found = open_with(&path, &[("motion.recording.interpolate_mag", 1.0)]).expect("read");
    let (_kept, contract) = file(table(HEADER, ",", |_, v| plain(v)).as_bytes());
    let expected = open_with(&contract, &[]).expect("read");
    for step in 0..100 {
        let t = 0.05 + 0.055 * f64::from(step);
        let (a, b) = (expected.at(t + 0.008), found.at(t));
        for axis in 0..3 {
            assert!((a.specific_force_g[axis] - b.specific_force_g[axis]).abs() < 1e-5);
            // A straight line over 20 ms misses a curvature of 27 uT/s^2 by 1.4 nT.
            assert!(
                (a.field_ut[axis] - b.field_ut[axis]).abs() < 0.01,
                "{t} {a:?} {b:?}"
            );
        }
    }
    let partly = slow.replace(",,,\n0.004000", ",1.0,,\n0.004000");
    let (_folder, path) = file(partly.as_bytes());
    let error = open_with(&path, &[("motion.recording.interpolate_mag", 1.0)]);
    assert!(error.expect_err("one cell of three").contains("mag_y_uT"));
}

#[test]
fn gaps_are_told_and_no_solution_that_sees_one_counts() {
    let rows: Vec<String> = table(HEADER, ",", |_, v| plain(v))
        .lines()
        .map(str::to_owned)
        .collect();
    let text = [&rows[..501], &rows[751..1000], &rows[1010..]]
        .concat()
        .join("\n");
    let (_folder, path) = file(text.as_bytes());
    let found = open_with(&path, &[]).expect("read");
    let remark = found.remark().expect("two gaps");
    assert!(
        remark.contains("2 gaps") && remark.contains("line 501") && remark.contains("1.996 s")
            || remark.contains("1.004 s"),
        "{remark}"
    );
    // 500 rows end at 1.996 s; the next is at 3.0 s.
    for (from, to, is_bridged) in [
        (1.5, 1.99, false),
        (1.9, 2.1, true),
        (2.4, 2.5, true),
        (2.95, 3.05, true),
        (3.05, 3.06, true),
        (3.11, 3.2, false),
    ] {
        assert_eq!(found.is_bridged(from, to), is_bridged, "{from} to {to}");
    }
    // A longer gap is allowed on demand.
    let one = open_with(&path, &[("motion.recording.longest_gap_s", 0.5)]).expect("read");
    assert!(one.remark().expect("one gap").contains("1 gap "));
    let none = open_with(&path, &[("motion.recording.longest_gap_s", 2.0)]).expect("read");
    assert_eq!(none.remark(), None);
    assert!(!none.is_bridged(0.0, 6.0));
}
