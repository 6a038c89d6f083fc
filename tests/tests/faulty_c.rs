//! Faults in the firmware's source that leave every value right: each is planted in the attitude in C, built
//! with avr-gcc, run on the emulated chip, and must fail with its party named first.

use std::fs;
use std::process::Command;

use cardan_tests::program::{folder, text};
use cardan_tests::{root, run, stderr};
use serde_json::Value;

/// A fault: what is replaced in `device.c`, by what, and what the first reason must hold.
struct Fault {
    name: &'static str,
    from: &'static str,
    to: &'static str,
    first: &'static str,
    arguments: &'static [&'static str],
}

const TUMBLE: &[&str] = &["--seconds", "3"];
const SOMERSAULT: &[&str] = &["--scenario", "somersault", "--seconds", "3"];

const RAILS: &[&str] = &["--scenario", "rails", "--seconds", "12"];

/// The first reason of a run of the attitude in C with this fault; none where it passes.
fn first_reason(fault: &Fault) -> Option<String> {
    let folder = folder();
    for entry in fs::read_dir(root().join("firmware/c")).expect("the folder is there") {
        let path = entry.expect("readable").path();
        let is_source = path.extension().is_some_and(|end| end == "c" || end == "h");
        if !is_source {
            continue;
        }
        let name = path.file_name().expect("a file").to_owned();
        let mut content = fs::read_to_string(&path).expect("sources are text");
        if name == "device.c" {
            assert_eq!(
                content.matches(fault.from).count(),
                1,
                "{}: {}",
                fault.name,
                fault.from
            );
            content = content.replacen(fault.from, fault.to, 1);
        }
        fs::write(folder.path().join(name), content).expect("the folder is ours");
    }
    let built = Command::new("avr-gcc")
        .current_dir(folder.path())
        .args([
            "-mmcu=atmega328p",
            "-std=gnu99",
            "-O2",
            "-o",
            "faulty.elf",
            "attitude.c",
            "device.c",
        ])
        .output()
        .expect("avr-gcc starts: apt-get install gcc-avr binutils-avr avr-libc");
    assert!(built.status.success(), "{}: {}", fault.name, stderr(&built));
    let elf = folder.path().join("faulty.elf");
    let arguments = ["compare", "--json", "--quiet", "--firmware", text(&elf)];
    let output = run(&[&arguments[..], fault.arguments].concat());
    let document: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{}: {error}: {}", fault.name, stderr(&output)));
    let first = document["reasons"][0].as_str().map(str::to_owned);
    assert_eq!(
        output.status.code(),
        Some(i32::from(first.is_some())),
        "{}",
        fault.name
    );
    first
}

/// Waits for so many conversions.
const WAIT: &str =
    "{ uint8_t n = COUNT, before = turn; while (n) if (turn != before) { before = turn; n--; } }";

fn faults() -> Vec<Fault> {
    let fault = |name, from, to, first| Fault {
        name,
        from,
        to,
        first,
        arguments: TUMBLE,
    };
    const SEND: &str = "            send_frame(sequence, averages.values, &solution);";
    const START: &str = "    start_serial();\n    start_pins();";
    vec![
        fault(
            "the converter stops at a block's end",
            "    TIFR1 = _BV(OCF1B);",
            "    { static uint16_t n; if (++n == (12 + 100) * 64) ADCSRA = 0; }\n    TIFR1 = _BV(OCF1B);",
            "device: gave 100 of the run's",
        ),
        fault(
            "the clock is divided by two",
            START,
            "    CLKPR = 0x80; CLKPR = 1;\n    start_serial();\n    start_pins();",
            "the processor's clock changes to 8000000 Hz",
        ),
        fault(
            "messages wait for 12 conversions",
            SEND,
            "WAIT(12)\n            send_frame(sequence, averages.values, &solution);",
            "first byte of a message",
        ),
        fault(
            "messages jitter",
            SEND,
            "WAIT(sequence * 7 % 13)\n            send_frame(sequence, averages.values, &solution);",
            "first byte of a message",
        ),
        fault(
            "the solving pin falls before the solution is computed",
            "        PORTB |= _BV(PB5);\n",
            "        PORTB |= _BV(PB5); PORTB &= (uint8_t)~_BV(PB5);\n",
            "first byte of a message",
        ),
        fault(
            "the converter's pins are outputs",
            START,
            "    DDRC = 0x0f;\n    start_serial();\n    start_pins();",
            "ADC0 sampled at cycle",
        ),
        fault(
            "the converter's pins are pulled up",
            START,
            "    PORTC = 0x0f;\n    start_serial();\n    start_pins();",
            "ADC0 sampled at cycle",
        ),
        fault(
            "the settings in the EEPROM are overwritten",
            SEND,
            "            if (sequence == 50) { cli(); EEAR = 10; EEDR = 0x5a; EECR |= _BV(EEMPE); \
             EECR |= _BV(EEPE); sei(); }\n            send_frame(sequence, averages.values, &solution);",
            "byte 10 of the EEPROM has changed",
        ),
        fault(
            "a pin outside the design changes",
            SEND,
            "            DDRD |= _BV(PD4); PIND = _BV(PD4);\n            \
             send_frame(sequence, averages.values, &solution);",
            "pin PD4 changes",
        ),
        Fault {
            arguments: RAILS,
            ..fault(
                "codes at the lower end of the scale are not flagged",
                "if (code == 0 || code == LAST_CODE)",
                "if (code == LAST_CODE)",
                "frames: native and emulated differ",
            )
        },
        Fault {
            arguments: RAILS,
            ..fault(
                "codes at the upper end of the scale are not flagged",
                "if (code == 0 || code == LAST_CODE)",
                "if (code == 0)",
                "frames: native and emulated differ",
            )
        },
        Fault {
            arguments: SOMERSAULT,
            ..fault(
                "the comparator's pin is an output",
                START,
                "    start_serial();\n    start_pins();\n    DDRD |= _BV(PD6);",
                "Ain0 sampled at cycle",
            )
        },
    ]
}

#[test]
fn the_attitude_in_c_as_it_stands_passes() {
    for arguments in [TUMBLE, SOMERSAULT] {
        let unchanged = Fault {
            name: "unchanged",
            from: "    sei();\n    for (;; sequence++)",
            to: "    sei();\n    for (;; sequence++)",
            first: "",
            arguments,
        };
        assert_eq!(first_reason(&unchanged), None);
    }
}

#[test]
fn faults_of_the_device_that_leave_every_value_right_fail_and_are_named() {
    let mut complaints = Vec::new();
    for mut fault in faults() {
        // WAIT(n) stands for the loop.
        let waits = fault.to.split_once("WAIT(").map(|(before, rest)| {
            let (count, after) = rest.split_once(")\n").expect("closed");
            format!("{before}{}\n{after}", WAIT.replace("COUNT", count))
        });
        fault.to = waits.map_or(fault.to, |text| Box::leak(text.into_boxed_str()));
        match first_reason(&fault) {
            None => complaints.push(format!("{}: passes", fault.name)),
            Some(first) if first.contains(fault.first) => {}
            Some(first) => complaints.push(format!("{}: found '{first}'", fault.name)),
        }
    }
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}
