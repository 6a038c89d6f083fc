//! `run --engine`: the interpreter and the translator are told apart by their names and their
//! speed only.

use std::process::Output;

use cardan_tests::program::{compile, folder, text};
use cardan_tests::{root, run, stderr};
use serde_json::Value;

/// The document of a run, without what depends on the host's speed.
fn document(arguments: &[&str]) -> (Value, Vec<u8>) {
    let Output {
        status,
        stdout,
        stderr,
    } = run(&[&["run"], arguments, &["--json"]].concat());
    let text = String::from_utf8_lossy(&stderr);
    assert!(status.success(), "{text}");
    let mut document: Value = serde_json::from_slice(&stdout).expect("one JSON document");
    for name in ["host_seconds", "mcycles_per_second"] {
        assert!(document[name].is_f64(), "{name}");
        document[name] = Value::Null;
    }
    // The serial bytes, without the last line, which tells the speed.
    let serial = text
        .rsplit_once("atmega328p: stopped")
        .map_or("", |(serial, _)| serial);
    (document, serial.as_bytes().to_vec())
}

/// Both engines, whose names are taken out.
fn both(arguments: &[&str]) -> [(Value, Vec<u8>); 2] {
    ["interp", "jit"].map(|name| {
        let (mut document, serial) = document(&[arguments, &["--engine", name]].concat());
        assert_eq!(document["engine"].take(), name);
        (document, serial)
    })
}

#[test]
fn both_engines_give_the_same_document_and_the_same_bytes() {
    let folder = folder();
    let elf = compile("convert", folder.path());
    let [interpreted, translated] = both(&[text(&elf), "--adc", "0=1.25"]);
    assert_eq!(interpreted, translated);
    for name in ["plain", "tapped"] {
        let image = root().join(format!("firmware/boards/atmega328p/images/{name}.elf"));
        let [interpreted, translated] = both(&[text(&image), "--cycles", "60000000"]);
        assert!(interpreted.0["uart0_bytes"].as_u64() > Some(100), "{name}");
        assert_eq!(interpreted, translated);
    }
}

#[test]
fn without_the_option_the_best_engine_of_the_host_is_taken() {
    let folder = folder();
    let elf = compile("convert", folder.path());
    let has_translator = cfg!(any(target_arch = "x86_64", target_arch = "aarch64"));
    let expected = if has_translator { "jit" } else { "interp" };
    assert_eq!(document(&[text(&elf)]).0["engine"], expected);
}

#[test]
fn an_unknown_engine_is_wrong_usage() {
    let output = run(&["run", "program.elf", "--engine", "fast"]);
    assert_eq!(output.status.code(), Some(2));
    let text = stderr(&output);
    assert!(text.contains("interp") && text.contains("jit"), "{text}");
}
