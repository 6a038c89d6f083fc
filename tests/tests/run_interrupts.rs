//! `run` shows what interrupts did, and the converter's reference, as a user sees it.

use cardan_tests::program::{compile, compile_with, folder, text};
use cardan_tests::{run, stderr};
use serde_json::Value;

fn document(arguments: &[&str]) -> (Value, String) {
    let output = run(&[&["run", "--json"], arguments].concat());
    let notes = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{notes}");
    let document = serde_json::from_slice(&output.stdout).expect("a document");
    (document, notes)
}

#[test]
fn an_interrupt_that_spoils_registers_is_a_note_with_function_and_line() {
    let folder = folder();
    let elf = compile_with("spoiled", folder.path(), &["-gdwarf-4"]);
    let (document, notes) = document(&[text(&elf)]);
    let [damage] = &document["interrupt_damage"].as_array().expect("a list")[..] else {
        panic!("{document}")
    };
    assert_eq!(damage["vector"], "TIMER0_OVF");
    assert_eq!(damage["function"], "__vector_16");
    assert_eq!(damage["line"], 12);
    assert_eq!(damage["registers"][0]["register"], 2);
    let value = |name: &str| damage["registers"][0][name].as_u64().expect("a byte");
    assert_eq!(value("after"), (value("before") + 1) % 256);
    let note = notes.lines().find(|line| line.contains("TIMER0_OVF"));
    let note = note.expect("a note");
    for part in ["note:", "r2 0x", "spoiled.c:12", "__vector_16", "times"] {
        assert!(note.contains(part), "{note}");
    }
    assert!(!notes.contains("TIMER1_COMPA"), "{notes}");
}

#[test]
fn interrupts_sleeps_and_edges_are_counted_in_the_document() {
    let folder = folder();
    let elf = compile("spoiled", folder.path());
    let (document, _) = document(&[text(&elf)]);
    let [compare, overflow] = &document["interrupts"].as_array().expect("a list")[..] else {
        panic!("{document}")
    };
    assert_eq!(compare["vector"], "TIMER1_COMPA");
    assert_eq!(
        (&compare["count"], &compare["damaged"]),
        (&20.into(), &0.into())
    );
    assert_eq!(compare["returns"], 20);
    assert_eq!(overflow["vector"], "TIMER0_OVF");
    assert_eq!(overflow["damaged"], overflow["returns"]);
    assert_eq!(
        overflow["damaged"],
        document["interrupt_damage"][0]["count"]
    );
    let sleeps = document["sleeps"].as_u64().expect("a number");
    // Each wake-up toggles the pin; nothing else has edges.
    assert!(sleeps >= 20);
    assert_eq!(document["pin_edges"], serde_json::json!({ "PB5": sleeps }));
}

#[test]
fn a_voltage_at_aref_is_the_reference_only_where_the_program_selects_it() {
    let folder = folder();
    let elf = compile("reference", folder.path());
    let codes = |arguments: &[&str]| {
        let output = run(&[&["run", text(&elf), "--quiet", "--adc=0=0.8"], arguments].concat());
        let codes = output.stdout.chunks(2);
        codes
            .map(|code| u16::from_be_bytes([code[0], code[1]]))
            .collect::<Vec<_>>()
    };
    // floor(0.8 V * 1024 / reference): AREF, AVCC, 1.1 V.
    assert_eq!(codes(&[]), [163, 163, 744]);
    assert_eq!(codes(&["--aref", "2.5"]), [327, 163, 744]);
    assert_eq!(codes(&["--vcc", "4"]), [204, 204, 744]);
    assert_eq!(codes(&["--vcc", "4", "--aref", "3.6"]), [227, 204, 744]);
}
