//! `run` shows what peripherals put out on their own: PWM behind the end of `main`, bits on TXD.

use std::fs;
use std::path::Path;

use cardan_tests::program::{compile, folder, text};
use cardan_tests::{run, stderr};
use serde_json::Value;

/// One cycle at 16 MHz, in picoseconds.
const CYCLE_PS: u64 = 62_500;

fn document(arguments: &[&str]) -> Value {
    let output = run(&[&["run", "--json"], arguments].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("a document")
}

/// Cycles and levels of a pin in a dump with one signal.
fn changes(dump: &Path) -> Vec<(u64, bool)> {
    let dump = fs::read(dump).expect("the dump is there");
    let (mut now, mut found) = (0, Vec::new());
    for command in vcd::Parser::new(&dump[..]) {
        match command.expect("a sound dump") {
            vcd::Command::Timestamp(time) => now = time / CYCLE_PS,
            vcd::Command::ChangeScalar(_, value) => found.push((now, value == vcd::Value::V1)),
            _ => {}
        }
    }
    found
}

#[test]
fn with_a_cycle_limit_peripherals_go_on_behind_the_end_of_main() {
    let folder = folder();
    let elf = compile("pwm", folder.path());
    let dump = folder.path().join("pwm.vcd");
    let limit = ["--cycles", "1600000"];
    let shown = ["--vcd", text(&dump), "--vcd-signal", "PB1"];
    for engine in ["interp", "jit"] {
        let arguments = [&[text(&elf), "--engine", engine][..], &limit, &shown].concat();
        let document = document(&arguments);
        assert_eq!(document["stop"], "limit", "{engine}");
        let edges = changes(&dump);
        // The first change is the level at the beginning.
        let rises: Vec<u64> = edges.iter().filter(|e| e.1).map(|e| e.0).collect();
        assert!(
            rises.len().abs_diff(1_600_000 / 256) <= 2,
            "{}",
            rises.len()
        );
        assert!(rises.windows(2).all(|pair| pair[1] - pair[0] == 256));
        let mut highs = edges[1..].windows(2).filter(|pair| pair[0].1);
        assert!(highs.all(|pair| pair[1].0 - pair[0].0 == 64));
    }
    for arguments in [&[][..], &["--program-exit", "--cycles", "1600000"]] {
        let output = run(&[&["run", "--json", text(&elf)], arguments].concat());
        let document: Value = serde_json::from_slice(&output.stdout).expect("a document");
        assert_eq!(document["stop"], "halt", "{arguments:?}");
    }
}

#[test]
fn the_dump_shows_each_bit_on_txd() {
    let folder = folder();
    let elf = compile("answer", folder.path());
    let dump = folder.path().join("txd.vcd");
    let document = document(&[text(&elf), "--vcd", text(&dump), "--vcd-signal", "PD1"]);
    assert_eq!(document["uart0_bytes"], 6);
    // 8N1 at 8 * (16 + 1) cycles per bit, decoded as a logic analyser does.
    let bit = 136;
    let edges = changes(&dump);
    let level = |at: u64| {
        edges
            .iter()
            .rev()
            .find(|edge| edge.0 <= at)
            .is_some_and(|edge| edge.1)
    };
    let mut bytes = Vec::new();
    let mut idle_from = edges
        .iter()
        .find(|edge| edge.1)
        .expect("TXD is idle high")
        .0;
    while let Some(&(start, _)) = edges.iter().find(|edge| edge.0 > idle_from && !edge.1) {
        let value = (0..8)
            .map(|n| u8::from(level(start + bit * (n + 1) + bit / 2)) << n)
            .sum::<u8>();
        assert!(level(start + bit * 9 + bit / 2), "no stop bit");
        bytes.push(value);
        idle_from = start + bit * 9 + bit / 2;
    }
    assert_eq!(bytes, b"hello\n");
}
