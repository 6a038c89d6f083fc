//! `compare --dump`: tables for other tools, read as they would.
//!
//! NumPy reads `.npy` files: `python3`, or the interpreter that `CARDAN_PYTHON` names.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use cardan_tests::{assert_refused, cardan, run, stderr};
use tempfile::tempdir;

/// Cycles between conversions, and between edges of the carrier, by design.
const CONVERSION_CYCLES: u64 = 2000;
/// A turn of the tilt multiplexer, and from its start to the first strobe.
const TURN_CYCLES: u64 = 16_000;
const SETTLING_CYCLES: u64 = 12_032;
/// Most by which a turn follows the carrier.
const MOST_TURN_LAG_CYCLES: u64 = 32;
const HALF_CARRIER_CYCLES: u64 = 500;
const CPU_HZ: f64 = 16e6;
/// Volts of a step of the converter.
const LSB_V: f64 = 5.0 / 1024.0;

/// A short run without noise; the verdict may miss tolerances on a few solutions, and is not asked.
fn dump(file: &Path, arguments: &[&str]) {
    let file = file.to_str().expect("a path in UTF-8");
    let short = ["compare", "--scenario", "tumble-quiet", "--seconds", "0.3"];
    let output = run(&[&short[..], &["--quiet", "--dump", file], arguments].concat());
    let code = output.status.code();
    assert!(matches!(code, Some(0 | 1)), "{code:?}: {}", stderr(&output));
}

/// Columns by name; empty cells are NaN.
type Columns = BTreeMap<String, Vec<f64>>;

fn csv(file: &Path) -> Columns {
    let text = fs::read_to_string(file).expect("the dump is there");
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    let mut columns = Columns::new();
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), names.len(), "{line}");
        for (name, cell) in names.iter().zip(cells) {
            let value = match cell {
                "" => f64::NAN,
                number => number.parse().expect("a number"),
            };
            columns.entry((*name).to_owned()).or_default().push(value);
        }
    }
    columns
}

/// What NumPy reads, bit by bit.
fn numpy(file: &Path) -> Columns {
    let script = "import sys, numpy\n\
                  a = numpy.load(sys.argv[1], allow_pickle=False)\n\
                  assert a.ndim == 1\n\
                  for name in a.dtype.names:\n    \
                      print(name, *(float(x).hex() for x in a[name]))";
    let python = std::env::var_os("CARDAN_PYTHON").unwrap_or("python3".into());
    let output = Command::new(&python)
        .args(["-c", script])
        .arg(file)
        .output()
        .expect("Python runs; see `cardan doctor`");
    assert!(output.status.success(), "{}", stderr(&output));
    let text = String::from_utf8(output.stdout).expect("text");
    let column = |line: &str| {
        let mut words = line.split(' ');
        let name = words.next().expect("a name").to_owned();
        (name, words.map(from_hex).collect())
    };
    text.lines().map(column).collect()
}

/// A number as Python's `float.hex` writes it.
fn from_hex(text: &str) -> f64 {
    if text == "nan" {
        return f64::NAN;
    }
    let (sign, text) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, text),
    };
    let text = text.strip_prefix("0x").expect("hexadecimal");
    let (mantissa, exponent) = text.split_once('p').expect("an exponent");
    let (whole, digits) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let number = u64::from_str_radix(&format!("{whole}{digits}"), 16).expect("digits");
    let exponent: i32 = exponent.parse().expect("a number");
    sign * number as f64 * 2.0_f64.powi(exponent - 4 * digits.len() as i32)
}

fn assert_equal(one: &Columns, other: &Columns) {
    let names = |columns: &Columns| columns.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(one), names(other));
    for (name, values) in one {
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        let plain = |values: &[f64]| {
            let plain = values
                .iter()
                .map(|v| if v.is_nan() { f64::NAN } else { *v });
            bits(&plain.collect::<Vec<_>>())
        };
        assert_eq!(plain(values), plain(&other[name]), "{name}");
    }
}

/// Rows in which the column has a value: (cycle, value).
fn series(columns: &Columns, name: &str) -> Vec<(u64, f64)> {
    let rows = columns["cycle"].iter().zip(&columns[name]);
    let present = rows.filter(|(_, value)| !value.is_nan());
    present
        .map(|(&cycle, &value)| (cycle as u64, value))
        .collect()
}

/// The options that name signals.
fn signals<'a>(names: &[&'a str]) -> Vec<&'a str> {
    let named = |name: &&'a str| ["--dump-signal", *name];
    names.iter().flat_map(named).collect()
}

#[test]
fn a_plain_dump_has_a_row_per_solution_and_numpy_reads_the_same_from_npy() {
    let folder = tempdir().expect("a temporary folder");
    let (table, array) = (folder.path().join("a.csv"), folder.path().join("a.npy"));
    dump(&table, &[]);
    dump(&array, &[]);
    let columns = csv(&table);
    assert_equal(&columns, &numpy(&array));
    // 0.3 s are 37.5 periods of 8 ms, 12 of which settle the filters.
    assert_eq!(columns["solution"].len(), 25);
    let text = fs::read_to_string(&table).expect("the dump is there");
    let start = "solution,t_s,flags,truth_yaw_deg,truth_pitch_deg,truth_roll_deg,";
    assert!(
        text.starts_with(start),
        "{}",
        text.lines().next().unwrap_or_default()
    );
    assert!(columns["yaw_native"].iter().any(|yaw| yaw.abs() > 0.01));
    for (native, emulated) in columns["yaw_native"]
        .iter()
        .zip(&columns["yaw_emulated_raw"])
    {
        // Half turns, of which a word has 2^15 or more parts.
        let parts = emulated / native;
        assert!(
            *native == *emulated || parts.log2().fract() == 0.0 && parts >= 32768.0,
            "{native}: {emulated}"
        );
    }
    assert!(
        !columns.contains_key("sample_native"),
        "one value per conversion"
    );
}

#[test]
fn signals_stand_side_by_side_at_their_cycles() {
    let folder = tempdir().expect("a temporary folder");
    let names = [
        "code",
        "adc0_V",
        "adc3_V",
        "PB1",
        "PB5",
        "yaw",
        "sample",
        "average",
        "adc0_band_pass_V",
        "adc0_hold_plus_V",
        "adc0_hold_minus_V",
        "adc0_low_pass_V",
    ];
    let signals = signals(&names);
    let (table, array) = (folder.path().join("s.csv"), folder.path().join("s.npy"));
    dump(&table, &signals);
    dump(&array, &[&signals[..], &["--in-process"]].concat());
    let columns = csv(&table);
    assert_equal(&columns, &numpy(&array));

    let cycles = &columns["cycle"];
    assert!(cycles.is_sorted(), "rows by cycle");
    for (cycle, t_s) in cycles.iter().zip(&columns["t_s"]) {
        assert_eq!(cycle / CPU_HZ, *t_s);
    }
    let codes = series(&columns, "code");
    assert_eq!(codes.len(), 37 * 64);
    for pair in codes[1..].windows(2) {
        assert_eq!(pair[1].0 - pair[0].0, CONVERSION_CYCLES);
    }
    let channels = series(&columns, "channel");
    for (channel, name) in [(0.0, "adc0_V"), (3.0, "adc3_V")] {
        let volts = series(&columns, name);
        assert_eq!(volts.len(), codes.len() / 4, "{name}");
        let mut seen = 0;
        for ((code, at), volts) in codes
            .iter()
            .zip(&channels)
            .filter(|(_, at)| at.1 == channel)
            .zip(&volts)
        {
            assert_eq!((code.0, at.0), (volts.0, volts.0), "{name}");
            // The converter's own errors are a few steps.
            let error = (code.1 + 0.5) * LSB_V - volts.1;
            assert!(error.abs() < 4.0 * LSB_V, "{name}: {error} V");
            seen += 1;
        }
        assert_eq!(seen, volts.len());
    }
    // The sample is the bipolar code, in the same row.
    let samples = series(&columns, "sample_native");
    assert_eq!(samples.len(), 25 * 64);
    for (sample, code) in samples.iter().zip(&codes[12 * 64..]) {
        assert_eq!(*sample, (code.0, code.1 - 512.0));
    }
    // A value per channel and solution, at the solution's last conversion.
    let averages = series(&columns, "average_native");
    assert_eq!(averages.len(), 25 * 4);
    for (number, average) in averages.iter().enumerate() {
        assert_eq!(average.0, codes[(12 + number / 4) * 64 + 63].0);
    }
    assert_eq!(series(&columns, "yaw_native").len(), 25);
    assert_eq!(series(&columns, "yaw_emulated_raw").len(), 25);
}

#[test]
fn pins_have_a_row_per_edge_and_inner_voltages_are_those_of_the_chain() {
    let folder = tempdir().expect("a temporary folder");
    let table = folder.path().join("p.csv");
    let names = [
        "PB1",
        "PB3",
        "PD3",
        "pin PB5",
        "adc0_V",
        "adc1_V",
        "adc0_band_pass_V",
        "adc1_band_pass_V",
        "adc0_hold_plus_V",
        "adc0_hold_minus_V",
        "adc0_low_pass_V",
    ];
    let signals = signals(&names);
    dump(&table, &signals);
    let columns = csv(&table);
    let carrier = series(&columns, "PB1");
    assert_eq!(carrier[0], (0, 0.0), "low after reset");
    assert!(carrier.len() > 9000, "{} edges in 0.3 s", carrier.len());
    for pair in carrier[1..].windows(2) {
        assert_eq!(pair[1].0 - pair[0].0, HALF_CARRIER_CYCLES);
        assert_eq!(pair[1].1, 1.0 - pair[0].1);
    }
    check_turns(&columns, &carrier);
    let solving = series(&columns, "PB5");
    assert_eq!(solving.len(), 1 + 2 * 25, "up and down per solution");
    // The low-pass averages the pair, the last amplifier puts it around mid supply.
    let [volts, plus, minus, low_pass] = [
        "adc0_V",
        "adc0_hold_plus_V",
        "adc0_hold_minus_V",
        "adc0_low_pass_V",
    ]
    .map(|name| series(&columns, name));
    for values in [&volts, &plus, &minus] {
        assert_eq!(values.len(), low_pass.len());
    }
    let gain = |at: usize| (volts[at].1 - volts[0].1) / (low_pass[at].1 - low_pass[0].1);
    let last = volts.len() - 1;
    assert!(gain(last).is_finite() && gain(last) > 0.0, "{}", gain(last));
    for at in 0..=last {
        assert_eq!(volts[at].0, low_pass[at].0);
        let expected = volts[0].1 + gain(last) * (low_pass[at].1 - low_pass[0].1);
        assert!((volts[at].1 - expected).abs() < 0.2 * LSB_V, "row {at}");
        // Once the filters have settled the tumble is slow against them.
        let pair = 0.5 * (plus[at].1 - minus[at].1);
        let is_settled = at >= 12 * 16;
        assert!(
            !is_settled || (pair - low_pass[at].1).abs() < 0.1,
            "row {at}: {pair} V, {} V",
            low_pass[at].1
        );
    }
}

/// The multiplexer switches by the schedule, and the band-pass is shown for the channel that has it.
fn check_turns(columns: &Columns, carrier: &[(u64, f64)]) {
    let (select, settled) = (series(columns, "PB3"), series(columns, "PD3"));
    assert!(select.len() > 290, "{} turns in 0.3 s", select.len());
    let lag = (select[1].0 - carrier[1].0) % HALF_CARRIER_CYCLES;
    assert!(
        lag <= MOST_TURN_LAG_CYCLES,
        "{lag} cycles after the carrier"
    );
    for pair in select[1..].windows(2) {
        assert_eq!(pair[1].0 - pair[0].0, TURN_CYCLES);
        assert_eq!(pair[1].1, 1.0 - pair[0].1);
    }
    for (settled, select) in settled[2..].iter().zip(&select[1..]) {
        assert_eq!(settled.0 - select.0, SETTLING_CYCLES);
        assert_eq!(settled.1, 1.0 - select.1, "they differ once settled");
    }
    for (level, volts, band_pass) in [
        (0.0, "adc0_V", "adc0_band_pass_V"),
        (1.0, "adc1_V", "adc1_band_pass_V"),
    ] {
        let cycles = |name: &str| -> Vec<u64> {
            series(columns, name)
                .iter()
                .map(|&(cycle, _)| cycle)
                .collect()
        };
        let mut own_turns = cycles(volts);
        own_turns.retain(|&cycle| {
            let last = select.partition_point(|edge| edge.0 <= cycle) - 1;
            select[last].1 == level
        });
        assert_eq!(cycles(band_pass), own_turns, "{band_pass}");
    }
}

#[test]
fn what_cannot_be_dumped_is_refused_before_anything_runs() {
    let folder = tempdir().expect("a temporary folder");
    let at = |name: &str| folder.path().join(name).display().to_string();
    let cases: [(&[&str], &[&str]); 7] = [
        (&["--dump", &at("a.mat")], &["a.mat", ".csv", ".npy"]),
        (&["--dump", &at("a")], &[".csv", ".npy"]),
        (
            &["--dump", &at("a.csv"), "--dump-signal", "yaww"],
            &["yaww", "`yaw`"],
        ),
        (
            &["--dump", &at("a.csv"), "--dump-signal", "adc5_V"],
            &["adc5_V", "adc0_V"],
        ),
        (
            &["--dump", &at("a.csv"), "--dump-signal", "PE1"],
            &["PE1", "PB0 to PD7"],
        ),
        (
            &[
                "--dump",
                &at("a.csv"),
                "--dump-signal",
                "yaw",
                "--dump-signal",
                "yaw",
            ],
            &["yaw", "twice"],
        ),
        (&["--dump-signal", "yaw"], &["--dump"]),
    ];
    for (arguments, parts) in cases {
        let output = run(&[&["compare"], arguments].concat());
        assert_refused(&output, parts);
    }
    let left = fs::read_dir(folder.path()).expect("a folder").count();
    assert_eq!(left, 0, "nothing is written");
}

#[test]
fn by_hand_a_pin_that_emulate_was_not_asked_for_is_an_error_that_says_so() {
    let folder = tempdir().expect("a temporary folder");
    let file = folder.path().join("a.csv").display().to_string();
    let session = format!("dump-{}", std::process::id());
    let start = |verb: &str, arguments: &[&str]| {
        Command::new(cardan())
            .args([verb, "--session", &session, "--quiet"])
            .args(arguments)
            .stderr(std::process::Stdio::piped())
            .stdout(std::process::Stdio::null())
            .spawn()
            .expect("starts")
    };
    let others = [
        start("golden", &[]),
        start("native", &[]),
        start("emulate", &["--seconds", "0.2"]),
    ];
    let asked = ["--seconds", "0.2", "--dump", &file, "--dump-signal", "PB1"];
    let diff = start("diff", &asked).wait_with_output().expect("ends");
    for mut other in others {
        other.wait().expect("ends");
    }
    let said = stderr(&diff);
    assert_eq!(diff.status.code(), Some(2), "{said}");
    for part in ["PB1", "emulate", "--dump-signal"] {
        assert!(said.contains(part), "{said}");
    }
}
