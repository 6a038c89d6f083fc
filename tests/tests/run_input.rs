//! `run` refuses what it cannot use: exit 2, and a message with file, place and expectation.

use std::fs;

use cardan_tests::program::{compile, folder, hex_text, text, write};
use cardan_tests::{run, stderr};

/// `ldi r24, 9`; a jump to itself.
const HALT: [u16; 2] = [0xE089, 0xCFFF];

/// Asserts that `arguments` are refused with exit 2 and a message that says `parts`.
fn refused(arguments: &[&str], parts: &[&str]) {
    let output = run(arguments);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    for part in parts {
        assert!(
            said.contains(part),
            "{arguments:?} says {said:?}, not {part:?}"
        );
    }
}

#[test]
fn files_that_are_no_program_are_refused_by_name_and_reason() {
    let folder = folder();
    let elf = compile("answer", folder.path());
    let whole = fs::read(&elf).expect("compiled");
    let good = hex_text(&HALT);
    let (mut machine, mut broken) = (whole.clone(), good.clone());
    machine[18] = 62;
    broken.replace_range(9..10, "F");
    let noise: Vec<u8> = (0..2000u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    let random = [&b"\x7fELF"[..], &noise].concat();
    let far = ":020000040001F9\n:0200000000E01E\n:00000001FF\n";
    for (name, content, says) in [
        ("empty.elf", &b""[..], "is empty"),
        ("short.elf", &whole[..40], "truncated"),
        ("cut.elf", &whole[..whole.len() / 2], "truncated"),
        ("random.elf", &random, "ELF"),
        ("noise.bin", &noise, "neither an ELF file nor Intel HEX"),
        ("machine.elf", &machine, "machine 62"),
        ("broken.hex", broken.as_bytes(), "line 1"),
        (
            "open.hex",
            good.lines().next().expect("a line").as_bytes(),
            "end-of-file record",
        ),
        ("far.hex", far.as_bytes(), "flash is too small"),
    ] {
        let file = write(&folder, name, content);
        refused(&["run", text(&file)], &[name, says]);
    }
    refused(
        &["run", "no/such/file.elf"],
        &["no/such/file.elf", "cannot be read"],
    );
    refused(&["run", text(folder.path())], &["cannot be read"]);
    refused(&["run"], &["<FILE>"]);
}

#[test]
fn values_out_of_range_are_refused_with_what_is_expected() {
    let folder = folder();
    let file = write(&folder, "good.hex", hex_text(&HALT));
    let refuse = |arguments: &[&str], parts: &[&str]| {
        refused(&[&["run", text(&file)], arguments].concat(), parts);
    };
    refuse(&["--mcu", "atmega1"], &["atmega1", "atmega328p"]);
    for hz in ["0", "-1", "1e6", "20000001", "99999999999999999999", "fast"] {
        refuse(&["--freq", hz], &["--freq"]);
    }
    for volts in ["0", "nan", "inf", "12", "five"] {
        refuse(&["--vcc", volts], &["--vcc", "1.8 to 5.5"]);
        refuse(&["--aref", volts], &["--aref", "from 1 to the supply"]);
    }
    refuse(
        &["--aref", "5.1"],
        &["--aref 5.1", "supply of 5 V", "--vcc"],
    );
    refuse(&["--vcc", "3.3", "--aref", "3.4"], &["--aref 3.4", "3.3 V"]);
    for value in [
        "8=1", "1", "=1", "0=", "0=nan", "0=inf", "x=1", "-1=1", "0=1=2",
    ] {
        refuse(&[&format!("--adc={value}")], &["--adc", "CH=VOLTS"]);
    }
    refuse(&["--adc", "2=1", "--adc", "2=2"], &["--adc 2", "twice"]);
    for cycles in ["-5", "1.5", "many"] {
        refuse(&["--cycles", cycles], &["--cycles"]);
    }
    refuse(&["--uart", "no/such/folder/file"], &["no/such/folder/file"]);
    refuse(&["--vcd", "no/such/folder/file"], &["no/such/folder/file"]);
}

#[test]
fn a_faulty_stimulus_is_refused_with_line_and_column() {
    let folder = folder();
    let program = write(&folder, "good.hex", hex_text(&HALT));
    for (content, parts) in [
        ("", &["header"][..]),
        ("t_s,adc0_V\n", &["no rows"]),
        ("time,adc0_V\n0,1\n", &["line 1, column 1", "time", "t_s"]),
        ("t_s\n0\n", &["line 1", "no input"]),
        ("t_s,adc8_V\n0,1\n", &["line 1, column 2", "adc8_V"]),
        ("t_s,adc0_V,PE1\n0,1,1\n", &["line 1, column 3", "PE1"]),
        ("t_s,PB0,PB0\n0,1,1\n", &["line 1, column 3", "twice"]),
        (
            "t_s,adc0_V\n0,1\n1,volt\n",
            &["line 3, column 2 (adc0_V)", "volt"],
        ),
        ("t_s,adc0_V\n0,nan\n", &["line 2, column 2 (adc0_V)", "nan"]),
        ("t_s,adc0_V\n0,\n", &["line 2, column 2 (adc0_V)"]),
        (
            "t_s,adc0_V,PB0\n0,1,2\n",
            &["line 2, column 3 (PB0)", "0 or 1"],
        ),
        (
            "t_s,adc0_V\n0,1\n0,2\n",
            &["line 3, column 1 (t_s)", "increase"],
        ),
        ("t_s,adc0_V\n-1,1\n", &["line 2, column 1 (t_s)"]),
        ("t_s,adc0_V\n1e9,1\n", &["line 2, column 1 (t_s)"]),
        (
            "cycle,adc0_V\n1.5,1\n",
            &["line 2, column 1 (cycle)", "1.5"],
        ),
        ("t_s,adc0_V\n0,1,2\n", &["line 2", "3 cells", "expected 2"]),
        ("t_s,adc0_V\n0,\u{fffd}\n", &["line 2, column 2"]),
    ] {
        let stimulus = write(&folder, "stimulus.csv", content);
        let arguments = ["run", text(&program), "--stimulus", text(&stimulus)];
        refused(&arguments, &[&["stimulus.csv"], parts].concat());
    }
    let binary = write(&folder, "binary.csv", b"t_s,adc0_V\n0,\xff\xfe\n");
    refused(
        &["run", text(&program), "--stimulus", text(&binary)],
        &["line 2", "not text"],
    );
    let twice = write(&folder, "twice.csv", "t_s,adc0_V\n0,1\n");
    let arguments = [
        "run",
        text(&program),
        "--stimulus",
        text(&twice),
        "--adc",
        "0=1",
    ];
    refused(&arguments, &["--adc 0", "twice.csv"]);
    refused(
        &["run", text(&program), "--stimulus", "none.csv"],
        &["none.csv", "cannot be read"],
    );
}

#[test]
fn a_faulty_dump_as_stimulus_is_refused_with_its_place() {
    let folder = folder();
    let program = write(&folder, "good.hex", hex_text(&HALT));
    for (content, says) in [
        ("$timescale 1 ns $end $enddefinitions $end", "no signal"),
        ("$var wire 1 ! PB0 $end $enddefinitions $end", "$timescale"),
        (
            "$timescale 1 ns $end $var wire 2 ! PB0 $end $enddefinitions $end",
            "2 bits",
        ),
        (
            "$timescale 1 ns $end $var wire 1 ! PB0 $end",
            "unexpected end",
        ),
        (
            "$timescale 1 ns $end $var wire 1 ! PB0 $end $enddefinitions $end #5 1! #4 ",
            "#4",
        ),
        (
            "$timescale 1 s $end $var wire 1 ! PB0 $end $enddefinitions $end #1000001 ",
            "1000000 s",
        ),
        (
            "$timescale 1 ns $end $var wire 1 ! PB0 $end $enddefinitions $end\n#1\n7!",
            "line 3",
        ),
        (
            "$timescale 1 ns $end $var real 9 ! adc1_V $end $enddefinitions $end #0 rnan !\n",
            "nite",
        ),
    ] {
        let file = write(&folder, "bad.vcd", content);
        refused(
            &["run", text(&program), "--stimulus", text(&file)],
            &["bad.vcd", says],
        );
    }
}
