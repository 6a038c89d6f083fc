//! The same motion in other units, separators, clocks, encodings and containers is the same recording.

use std::io::Write as _;

use flate2::Compression;
use flate2::write::{DeflateEncoder, GzEncoder};

use crate::swing::*;

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
