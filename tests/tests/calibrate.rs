//! `calibrate` as a user runs it: a bad unit becomes a good one, its EEPROM file in other tools.

use std::fs;
use std::io::{BufRead, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Output};

use cardan_firmware::frame::crc16;
use cardan_spec::ThirdTilt;
use cardan_spec::calibration::{LEN, OPTIONS_AT};
use cardan_tests::program::{announced, folder, start, text, write};
use cardan_tests::{assert_refused, root, run, stderr};
use serde_json::Value;

/// A unit far off its design, within what its amplifiers bear.
const BAD_UNIT: [&str; 14] = [
    "sensors.accelerometer.offset_x_mg=60",
    "sensors.accelerometer.offset_y_mg=-45",
    "sensors.accelerometer.sensitivity_error_x=0.06",
    "sensors.accelerometer.sensitivity_error_y=-0.08",
    "sensors.accelerometer.cross_axis=0.01",
    "sensors.magnetometer.offset_x_ut=3",
    "sensors.magnetometer.offset_y_ut=-4",
    "sensors.magnetometer.sensitivity_error_x=0.05",
    "sensors.magnetometer.sensitivity_error_y=-0.07",
    "sensors.magnetometer.cross_axis=0.01",
    "sensors.magnetometer.non_orthogonality_deg=1.5",
    "adc.offset_lsb=2",
    "adc.gain_lsb=-2",
    "frontend.output_offset_mv=15",
];

fn with_bad_unit<'a>(arguments: &[&'a str]) -> Vec<&'a str> {
    let unit = BAD_UNIT.iter().flat_map(|setting| ["--set", setting]);
    arguments.iter().copied().chain(unit).collect()
}

fn document(output: &Output) -> Value {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", stderr(output)))
}

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{value} is no number"))
}

fn parameter(document: &Value, name: &str) -> (f64, f64) {
    let all = document["parameters"].as_array().expect("a list");
    let found = all
        .iter()
        .find(|parameter| parameter["name"] == name)
        .expect("is listed");
    (number(&found["value"]), number(&found["standard_error"]))
}

#[test]
fn a_bad_unit_is_as_good_as_its_noise_after_calibration() {
    let folder = folder();
    let file = folder.path().join("unit.eep");
    let arguments = with_bad_unit(&["calibrate", "--json", "--quiet", "--out", text(&file)]);
    let found = document(&run(&arguments));
    let held_out = &found["held_out"];
    let (before, after) = (&held_out["before"], &held_out["after"]);
    // Measured: 19.3 degrees before, 1.55 after, scatter within the attitudes 1.49.
    assert!(number(&before["rms_deg"]) > 8.0, "{before}");
    assert!(number(&after["rms_deg"]) < 1.8, "{after}");
    assert!(
        number(&after["rms_deg"]) < 1.25 * number(&after["noise_rms_deg"]),
        "{after}"
    );
    assert!(number(&after["max_deg"]) < 8.0, "{after}");
    assert_eq!(after["flagged"], 0);
    // What the unit was made with comes back: its zero-g offsets in steps of the converter, from
    // sensor, output stage and converter, and z's mean effect of 0.75 g.
    let (offset, error) = parameter(&found, "tilt_offset x");
    let made = (1.06 * 0.75 * -0.01 + 0.06) / 1.2 + 0.015 / 2.5 + (2.0 - 1.0 - 0.5) / 512.0;
    assert!(
        (offset - made).abs() < 6.0 * error + 2e-4,
        "{offset} {made} {error}"
    );

    // The same unit with that EEPROM in the whole comparison: native and golden have the same words.
    let compare = |eeprom: &[&str]| {
        let arguments = [
            "compare",
            "--in-process",
            "--json",
            "--quiet",
            "--seconds",
            "1.2",
        ];
        document(&run(&with_bad_unit(&[&arguments, eeprom].concat())))
    };
    let with = compare(&["--eeprom", text(&file)]);
    let without = compare(&[]);
    for document in [&with, &without] {
        assert_eq!(document["verdict"], "pass");
    }
    let rms = |document: &Value| number(&document["attitude"]["total"]["rms_deg"]);
    assert!(
        rms(&with) < 3.0 && rms(&without) > 6.0,
        "{} {}",
        rms(&with),
        rms(&without)
    );
    let assumed = with["assumed"].as_array().expect("a list");
    assert!(
        assumed
            .iter()
            .any(|a| a["value"] == format!("EEPROM image {}", file.display()))
    );
}

#[test]
fn equal_seeds_give_equal_documents_and_other_seeds_other_attitudes() {
    let quick = |seed: &str| {
        let arguments = [
            "calibrate",
            "--json",
            "--quiet",
            "--attitudes",
            "8",
            "--solutions",
            "8",
        ];
        document(&run(&[&arguments[..], &["--seed", seed]].concat()))
    };
    let (one, again, other) = (quick("1"), quick("1"), quick("2"));
    assert_eq!(one, again);
    assert_ne!(one["visits"][0], other["visits"][0]);
    assert_eq!(one["attitudes"]["used"], 8);
    assert_eq!(one["attitudes"]["solutions_used"], 64);
    assert_eq!(one["eeprom"]["file"], Value::Null);
}

/// The content of an Intel HEX file, as binutils read it.
fn by_objcopy(file: &Path) -> Vec<u8> {
    let raw = file.with_extension("raw");
    let status = Command::new("avr-objcopy")
        .args(["-I", "ihex", "-O", "binary"])
        .args([file, &raw])
        .status()
        .expect("avr-objcopy starts (apt-get install binutils-avr)");
    assert!(status.success());
    fs::read(raw).expect("was written")
}

#[test]
fn both_forms_of_the_file_hold_the_documents_bytes() {
    let folder = folder();
    let [hex, raw] = ["unit.hex", "unit.bin"].map(|name| folder.path().join(name));
    let content = [&hex, &raw].map(|file| {
        let arguments = [
            "calibrate",
            "--json",
            "--attitudes",
            "8",
            "--solutions",
            "4",
            "--out",
        ];
        let found = document(&run(&[&arguments[..], &[text(file)]].concat()));
        let digits = found["eeprom"]["hex"].as_str().expect("text").to_owned();
        let byte = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).expect("two digits");
        (0..digits.len()).step_by(2).map(byte).collect::<Vec<u8>>()
    });
    assert_eq!(by_objcopy(&hex), content[0]);
    assert_eq!(fs::read(&raw).expect("was written"), content[1]);
    assert_eq!(content[0], content[1]);
}

#[test]
fn a_recording_calibrates_against_its_own_instruments() {
    // Rocks slowly about both axes, all the way round in one, with heading; no reference orientation.
    let mut csv = String::from("t_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT\n");
    for step in 0..6000 {
        let t = f64::from(step) * 0.005;
        let (roll, pitch, yaw) = (0.5 * t, 1.2 * (0.37 * t).sin(), 0.9 * t);
        let [x, y, z] = body(roll, pitch, yaw, [0.0, 0.0, 1.0]).map(|g| 9.81 * g);
        let [p, q, r] = body(roll, pitch, yaw, [24.0, 0.0, 40.0]);
        // Sensor x is body y, sensor y body x, sensor z up; at rest it feels +1 g upwards.
        csv += &format!(
            "{t:.4},{:.5},{:.5},{:.5},{q:.4},{p:.4},{:.4}\n",
            -y, -x, z, -r
        );
    }
    let folder = folder();
    let file = write(&folder, "rocking.csv", csv);
    let arguments = [
        "calibrate",
        "--json",
        "--quiet",
        "--solutions",
        "16",
        "--recording",
        text(&file),
    ];
    let found = document(&run(&with_bad_unit(&arguments)));
    assert_eq!(found["source"], "recording");
    assert!(
        found["attitudes"]["used"].as_u64() > Some(50),
        "{}",
        found["attitudes"]
    );
    let (before, after) = (&found["held_out"]["before"], &found["held_out"]["after"]);
    assert!(number(&before["rms_deg"]) > 8.0, "{before}");
    assert!(number(&after["rms_deg"]) < 2.2, "{after}");
}

/// A reference vector (north, east, down) in body axes: Rx(roll) Ry(pitch) Rz(yaw).
fn body(roll: f64, pitch: f64, yaw: f64, [n, e, d]: [f64; 3]) -> [f64; 3] {
    let (n, e) = (yaw.cos() * n + yaw.sin() * e, yaw.cos() * e - yaw.sin() * n);
    let (n, d) = (
        pitch.cos() * n - pitch.sin() * d,
        pitch.sin() * n + pitch.cos() * d,
    );
    [
        n,
        roll.cos() * e + roll.sin() * d,
        roll.cos() * d - roll.sin() * e,
    ]
}

#[test]
fn a_recording_that_stays_level_is_refused_with_what_it_lacks() {
    let mut csv = String::from("t_s,acc_x_m_s2,acc_y_m_s2,acc_z_m_s2,mag_x_uT,mag_y_uT,mag_z_uT\n");
    for step in 0..1200 {
        let t = f64::from(step) * 0.005;
        let (east, north) = (24.0 * t.sin(), 24.0 * t.cos());
        csv += &format!("{t:.4},0,0,9.81,{east:.4},{north:.4},-40\n");
    }
    let folder = folder();
    let file = write(&folder, "level.csv", csv);
    let output = run(&["calibrate", "--recording", text(&file), "--solutions", "8"]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("level.csv") && said.contains("gravity along body"),
        "{said}"
    );
    assert!(said.contains("both signs"), "{said}");
}

#[test]
fn saturated_solutions_are_left_out_and_counted() {
    // Sensor and converter together drive a channel to its rail in the steepest attitudes.
    let arguments = [
        "calibrate",
        "--json",
        "--quiet",
        "--attitudes",
        "40",
        "--solutions",
        "4",
        "--set",
        "sensors.accelerometer.offset_x_mg=120",
        "--set",
        "sensors.accelerometer.sensitivity_error_x=0.06",
        "--set",
        "adc.offset_lsb=50",
    ];
    let found = document(&run(&arguments));
    let counted = &found["attitudes"];
    let left_out = counted["left_out"].as_u64().expect("a count");
    assert!(
        left_out >= 1 && counted["solutions_saturated"].as_u64() >= Some(4),
        "{counted}"
    );
    assert_eq!(counted["used"].as_u64(), Some(40 - left_out));
    let (offset, error) = parameter(&found, "tilt_offset x");
    assert!(
        (offset - (0.12 / 1.2 + 49.5 / 512.0)).abs() < 6.0 * error + 2e-4,
        "{offset} {error}"
    );
}

#[test]
fn bad_options_are_refused_before_anything_runs() {
    let cases: [(&[&str], &str); 7] = [
        (&["--attitudes", "5"], "6..=10000"),
        (&["--solutions", "1"], "2..=10000"),
        (&["--out", "unit.txt"], ".eep"),
        (&["--seconds", "3"], "--attitudes"),
        (&["--scenario", "tumbel"], "tumble"),
        (
            &["--set", "sensors.accelerometer.offset_x_mg=400"],
            "range at rest",
        ),
        (&["--eeprom", "nowhere.hex"], "nowhere.hex"),
    ];
    for (options, named) in cases {
        let output = run(&[&["calibrate"][..], options].concat());
        assert_refused(&output, &[named]);
    }
}

#[test]
fn eeprom_files_that_hold_no_calibration_are_refused_with_the_reason() {
    let folder = folder();
    let good = folder.path().join("good.bin");
    let made = [
        "calibrate",
        "--attitudes",
        "8",
        "--solutions",
        "4",
        "--out",
        text(&good),
    ];
    assert_eq!(run(&made).status.code(), Some(0));
    let bytes = fs::read(&good).expect("was written");
    let changed = |at: usize| {
        let mut bytes = bytes.clone();
        bytes[at] ^= 0x11;
        bytes
    };
    let with_options = |options: u8| {
        let mut third = bytes.clone();
        third[OPTIONS_AT] = options;
        let crc = crc16(&third[..LEN - 2]);
        third[LEN - 2..LEN].copy_from_slice(&crc.to_le_bytes());
        third
    };
    let [compared, measured] = [ThirdTilt::Comparator, ThirdTilt::Measured];
    let cases = [
        (
            "third.bin",
            with_options(compared as u8),
            "sensors.third_tilt",
        ),
        (
            "measured.bin",
            with_options(measured as u8),
            "sensors.third_tilt",
        ),
        ("options.bin", with_options(3), "options 0x03"),
        ("short.bin", bytes[..20].to_vec(), "20 bytes"),
        ("magic.bin", changed(0), "magic"),
        ("version.bin", changed(2), "layout version"),
        ("words.bin", changed(3), "words at address 3"),
        ("damaged.bin", changed(30), "checksum"),
        ("erased.bin", vec![0xff; 1024], "magic"),
        ("text.hex", b"no hex at all\n".to_vec(), "record 1"),
        ("cut.eep", b":0100000001FE\n".to_vec(), "cut short"),
        ("name.dat", bytes.clone(), ".bin"),
    ];
    for (name, content, reason) in cases {
        let file = write(&folder, name, content);
        for command in [&["compare"][..], &["emulate", "--session", "x"]] {
            let output = run(&[command, &["--seconds", "0.2", "--eeprom", text(&file)]].concat());
            let said = stderr(&output);
            assert_eq!(output.status.code(), Some(2), "{name}: {said}");
            assert!(
                said.contains(name) && said.contains(reason),
                "{name}: {said}"
            );
        }
    }
}

/// Status bits of a device that sends text lines on `port`.
fn told_status(port: &str) -> u16 {
    let mut line = fs::OpenOptions::new()
        .read(true)
        .write(true)
        .open(port)
        .expect("the terminal opens");
    line.write_all(b"t").expect("written");
    // The first may have lost its beginning.
    let mut lines = BufReader::new(line).split(b'\n').skip(1).map(|line| {
        let line = line.expect("the device sends");
        String::from_utf8_lossy(&line).trim().to_owned()
    });
    let status = lines.find_map(|line| line.split_once(" 0x").map(|(_, hex)| hex.to_owned()));
    u16::from_str_radix(&status.expect("a text line"), 16).expect("hex digits")
}

#[test]
fn a_device_takes_its_calibration_over_the_serial_line() {
    const UNCALIBRATED: u16 = 8;
    let folder = folder();
    let file = folder.path().join("unit.eep");
    let out = ["--attitudes", "6", "--solutions", "4", "--out", text(&file)];
    document(&run(
        &[&["calibrate", "--json", "--quiet"], &out[..]].concat()
    ));
    let plain = root().join("firmware/boards/atmega328p/images/plain.elf");
    let mut device = start(&["run", text(&plain), "--uart", "pty"]);
    let port = announced(&mut device, "serial line: ");
    let send = |file: &Path| {
        let send = ["--image", text(file), "--send", &port];
        run(&[&["calibrate", "--json", "--quiet"], &send[..]].concat())
    };
    assert_ne!(told_status(&port) & UNCALIBRATED, 0);
    let sent = document(&send(&file));
    assert_eq!(sent["bytes"], cardan_spec::calibration::LEN);
    assert_eq!(told_status(&port) & UNCALIBRATED, 0);

    // What the device would refuse is not sent.
    let damaged = write(&folder, "damaged.bin", [0x1d, 0xca, 2, 15]);
    assert_refused(&send(&damaged), &["damaged.bin", "bytes"]);
    device.kill().expect("our child");
    device.wait().expect("our child");
    // An option that would do nothing.
    let ignored = [
        "--image",
        text(&file),
        "--send",
        &port,
        "--wordlengths",
        "w.toml",
    ];
    let ignored = run(&[&["calibrate"], &ignored[..]].concat());
    assert_refused(&ignored, &["--wordlengths"]);
    // No serial line.
    let nobody = run(&["calibrate", "--image", text(&file), "--send", "/dev/null"]);
    assert_refused(&nobody, &["/dev/null", "serial port"]);
}
