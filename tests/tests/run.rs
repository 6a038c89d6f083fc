//! `run` as a user sees it: how programs end, what comes out, what goes in.

use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use cardan_tests::program::{announced, compile, folder, hex_text, start, text, to_hex, write};
use cardan_tests::{cardan, document, run, stderr};
use serde_json::Value;

/// `ldi r24, 7`; `break`.
const BREAK: [u16; 2] = [0xE087, 0x9598];
/// `ldi r24, 1`; `out SMCR, r24` (sleep enabled, idle); `sleep`.
const SLEEP: [u16; 3] = [0xE081, 0xBF83, 0x9588];
/// `ldi r24, 9`; a jump to itself.
const HALT: [u16; 2] = [0xE089, 0xCFFF];
/// Not an instruction.
const INVALID: [u16; 2] = [0x0000, 0x0001];

/// Runs words as a HEX file.
fn words(words: &[u16], arguments: &[&str]) -> Output {
    let folder = folder();
    let file = write(&folder, "words.hex", hex_text(words));
    run(&[&["run", text(&file)], arguments].concat())
}

fn code(output: &Output) -> i32 {
    output.status.code().expect("it ends by itself")
}

#[test]
fn each_way_a_program_ends_has_its_name_its_cycles_and_its_place() {
    for (program, stop, cycles, pc) in [
        (&BREAK[..], "break", 2, 4),
        (&SLEEP[..], "sleep", 3, 6),
        (&HALT[..], "halt", 1, 2),
    ] {
        let output = words(program, &["--json"]);
        let document = document(&output);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        assert_eq!(document["stop"], stop);
        assert_eq!(document["cycles"], cycles, "{stop}");
        assert_eq!(document["pc"], pc, "{stop}");
        assert_eq!(document["mcu"], "atmega328p");
        assert_eq!(document["sp"], 0x8FF);
    }
    let output = words(&[0x0000, 0xCFFE], &["--json", "--cycles", "1000"]);
    assert_eq!(
        (code(&output), &document(&output)["stop"]),
        (0, &"limit".into())
    );
}

#[test]
fn a_crash_exits_with_4_says_where_and_still_prints_the_document() {
    let output = words(&INVALID, &["--json"]);
    let document = document(&output);
    assert_eq!(code(&output), 4);
    assert_eq!(document["stop"], "crash");
    assert_eq!(document["pc"], 2);
    assert_eq!(document["instructions"], 1);
    assert!(stderr(&output).contains("0x0002") && stderr(&output).contains("0x0001"));
    let erased = words(&[0x0000], &[]);
    assert_eq!(code(&erased), 4);
    assert!(
        stderr(&erased).contains("erased flash"),
        "{}",
        stderr(&erased)
    );
}

#[test]
fn the_programs_own_exit_code_counts_only_with_program_exit() {
    for (program, exit) in [(&BREAK[..], 7), (&SLEEP[..], 1), (&HALT[..], 9)] {
        assert_eq!(code(&words(program, &[])), 0);
        assert_eq!(code(&words(program, &["--program-exit"])), exit);
    }
    assert_eq!(code(&words(&INVALID, &["--program-exit"])), 4);
    let endless = [0x0000, 0xCFFE];
    assert_eq!(
        code(&words(&endless, &["--cycles", "99", "--program-exit"])),
        3
    );
    let folder = folder();
    let answer = compile("answer", folder.path());
    assert_eq!(code(&run(&["run", text(&answer), "--program-exit"])), 42);
}

#[test]
fn serial_bytes_go_to_standard_output_and_beside_json_to_standard_error() {
    let folder = folder();
    let elf = compile("answer", folder.path());
    for file in [elf.clone(), to_hex(&elf)] {
        let output = run(&["run", text(&file)]);
        assert_eq!(output.stdout, b"hello\n");
        assert!(stderr(&output).contains("halt"), "{}", stderr(&output));
        let output = run(&["run", text(&file), "--quiet"]);
        assert_eq!(
            (output.stdout, output.stderr),
            (b"hello\n".to_vec(), vec![])
        );
        let output = run(&["run", text(&file), "--json", "--quiet"]);
        let document = document(&output);
        assert_eq!(document["uart0_bytes"], 6);
        assert_eq!(document["registers"][24], 42);
        assert_eq!(document["stop"], "halt");
        assert_eq!(output.stderr, b"hello\n");
    }
    let sent = folder.path().join("sent");
    let output = run(&["run", text(&elf), "--uart", text(&sent)]);
    assert_eq!(
        (output.stdout, fs::read(&sent).expect("written")),
        (vec![], b"hello\n".to_vec())
    );
    assert_eq!(run(&["run", text(&elf), "--uart", "none"]).stdout, b"");
}

#[test]
fn two_runs_differ_in_host_times_only() {
    let folder = folder();
    let elf = compile("convert", folder.path());
    let document = || {
        let mut document = document(&run(&["run", text(&elf), "--json", "--adc", "0=1.25"]));
        for name in ["host_seconds", "mcycles_per_second"] {
            assert!(document[name].is_f64(), "{name}");
            document[name] = Value::Null;
        }
        document
    };
    assert_eq!(document(), document());
}

/// The codes that `convert` sends.
fn codes(arguments: &[&str]) -> Vec<u16> {
    let folder = folder();
    let elf = compile("convert", folder.path());
    let output = run(&[&["run", text(&elf)], arguments].concat());
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    output
        .stdout
        .chunks(2)
        .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
        .collect()
}

#[test]
fn voltages_come_from_the_command_line_and_follow_the_supply() {
    assert_eq!(codes(&[]), [0, 0, 0]);
    // floor(V * 1024 / 5 V)
    assert_eq!(
        codes(&["--adc", "0=1.25", "--adc", "3=2.51"]),
        [256, 514, 256]
    );
    assert_eq!(codes(&["--adc", "0=9", "--adc", "3=-1"]), [1023, 0, 1023]);
    // floor(V * 1024 / 2.5 V)
    assert_eq!(codes(&["--vcc", "2.5", "--adc", "0=1.25"]), [512, 0, 512]);
}

#[test]
fn a_stimulus_holds_each_value_until_the_next_row() {
    let folder = folder();
    let by_time = write(
        &folder,
        "t.csv",
        "t_s,adc0_V,adc3_V\n0,1.25,2.5\n0.005,3.75,0\n",
    );
    let by_cycle = write(
        &folder,
        "c.csv",
        "cycle,adc3_V, adc0_V\n0,2.5,1.25\n80000,0,3.75\n",
    );
    for file in [by_time, by_cycle] {
        assert_eq!(codes(&["--stimulus", text(&file)]), [256, 512, 768]);
    }
    let late = write(&folder, "late.csv", "t_s,adc0_V\n0.005,3.75\n");
    assert_eq!(
        codes(&["--stimulus", text(&late), "--adc", "3=2.5"]),
        [0, 512, 768]
    );
}

/// Edges of PB0 in a dump, as (picoseconds, level).
fn edges(dump: &Path) -> Vec<(u64, bool)> {
    let mut parser = vcd::Parser::new(fs::read(dump).map(std::io::Cursor::new).expect("written"));
    let header = parser.parse_header().expect("a header");
    assert_eq!(header.timescale, Some((1, vcd::TimescaleUnit::PS)));
    let pin = header
        .find_var(&["pins", "PB0"])
        .expect("PB0 is there")
        .code;
    let mut now = 0;
    let mut edges = Vec::new();
    for command in parser {
        match command.expect("a well-formed dump") {
            vcd::Command::Timestamp(time) => {
                assert!(time >= now, "time runs backwards");
                now = time;
            }
            vcd::Command::ChangeScalar(code, value) if code == pin => {
                edges.push((now, value == vcd::Value::V1));
            }
            _ => {}
        }
    }
    edges
}

#[test]
fn a_pin_stimulus_moves_the_program_and_the_dump_shows_each_edge_at_its_cycle() {
    let folder = folder();
    let elf = compile("follow", folder.path());
    let stimulus = write(&folder, "s.csv", "cycle,PD2\n50000,1\n100000,0\n160000,1\n");
    let dump = folder.path().join("out.vcd");
    let output = run(&[
        "run",
        text(&elf),
        "--stimulus",
        text(&stimulus),
        "--vcd",
        text(&dump),
    ]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let edges = edges(&dump);
    let levels: Vec<bool> = edges.iter().map(|&(_, level)| level).collect();
    assert_eq!(levels, [false, true, false, true]);
    for (&(time, _), cycle) in edges[1..].iter().zip([50_000, 100_000, 160_000]) {
        let period = 62_500;
        assert_eq!(time % period, 0, "16 MHz is 62500 ps per cycle");
        // The program polls the pin every few cycles.
        let delay = time / period - cycle;
        assert!(
            (3..40).contains(&delay),
            "{delay} cycles after the stimulus"
        );
    }
}

#[test]
fn a_dump_as_stimulus_does_the_same_as_the_table() {
    let folder = folder();
    let elf = compile("follow", folder.path());
    let table = write(&folder, "s.csv", "cycle,PD2\n50000,1\n100000,0\n160000,1\n");
    let dump = "$timescale 1 ns $end $scope module any $end $var wire 1 ! PD2 $end \
                $var wire 8 \" other $end $upscope $end $enddefinitions $end\n\
                #0 z! b101 \"\n#3125000 1!\n#6250000 0!\n#10000000 1!\n";
    let dump = write(&folder, "s.vcd", dump);
    let shown = [&table, &dump].map(|stimulus| {
        let out = folder.path().join("out.vcd");
        let arguments = [
            "run",
            text(&elf),
            "--stimulus",
            text(stimulus),
            "--vcd",
            text(&out),
        ];
        let output = run(&arguments);
        assert_eq!(code(&output), 0, "{}", stderr(&output));
        fs::read(out).expect("written")
    });
    assert!(shown[0] == shown[1], "the two runs differ");
    let volts = "$timescale 1 us $end $var real 64 v adc0_V $end $var real 64 w adc3_V $end \
                 $enddefinitions $end #0 r1.25 v r2.5 w #5000 r3.75 v r0 w ";
    let volts = write(&folder, "v.vcd", volts);
    assert_eq!(codes(&["--stimulus", text(&volts)]), [256, 512, 768]);
}

#[test]
fn standard_input_is_the_far_end_of_the_line() {
    let folder = folder();
    let elf = compile("echo", folder.path());
    let mut child = Command::new(cardan())
        .args(["run", text(&elf), "--uart", "stdio"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    let mut input = child.stdin.take().expect("piped");
    input
        .write_all(b"A line of text, longer than every buffer of the receiver, q")
        .expect("written");
    drop(input);
    let output = child.wait_with_output().expect("ends");
    assert_eq!(
        String::from_utf8_lossy(&output.stdout),
        "A line of text, longer than every buffer of the receiver, q"
    );
}

#[test]
fn a_serial_program_opens_the_pseudo_terminal_and_talks_with_the_chip() {
    let folder = folder();
    let elf = compile("echo", folder.path());
    let mut child = start(&["run", text(&elf), "--uart", "pty", "--program-exit"]);
    let name = announced(&mut child, "serial line: ");
    let mut terminal = fs::OpenOptions::new()
        .read(true)
        .write(true)
        .open(&name)
        .expect("the terminal opens");
    for message in ["hello\r\n", "\u{3}\u{4}\u{13} raw, q"] {
        terminal.write_all(message.as_bytes()).expect("written");
        let mut echoed = vec![0; message.len()];
        terminal.read_exact(&mut echoed).expect("the chip answers");
        assert_eq!(echoed, message.as_bytes());
    }
    let begin = Instant::now();
    while child.try_wait().expect("our child").is_none() {
        // A watchdog, far beyond what the end takes.
        assert!(
            begin.elapsed() < Duration::from_secs(60),
            "the run does not end"
        );
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(child.wait().expect("our child").code(), Some(0));
}

#[test]
fn stty_and_cat_use_the_pseudo_terminal_as_any_serial_line() {
    let folder = folder();
    let elf = compile("echo", folder.path());
    let mut child = start(&["run", text(&elf), "--uart", "pty", "--program-exit"]);
    let name = announced(&mut child, "serial line: ");
    let setting = Command::new("stty")
        .args(["-F", &name, "115200", "raw", "-echo"])
        .status()
        .expect("stty starts");
    assert!(setting.success());
    let heard = fs::File::create(folder.path().join("heard")).expect("the folder is ours");
    let mut listener = Command::new("cat")
        .arg(&name)
        .stdout(heard)
        .stderr(Stdio::null())
        .spawn()
        .expect("cat starts");
    fs::write(&name, "over the line, q").expect("the terminal takes it");
    let status = child.wait().expect("our child");
    // The end of the run hangs up, which ends cat.
    listener.wait().expect("our child");
    assert_eq!(status.code(), Some(0));
    let heard = fs::read(folder.path().join("heard")).expect("written");
    assert_eq!(String::from_utf8_lossy(&heard), "over the line, q");
}

#[test]
fn a_closed_reader_ends_the_run() {
    // Sends the letter U for ever: ldi r16, 8; sts UCSR0B, r16; sts UDR0, r16; rjmp .-6
    let endless = [0xE008, 0x9300, 0x00C1, 0x9300, 0x00C6, 0xCFFD];
    let folder = folder();
    let file = write(&folder, "endless.hex", hex_text(&endless));
    let mut child = Command::new(cardan())
        .args(["run", text(&file)])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    let mut first = [0; 100];
    let mut from = child.stdout.take().expect("piped");
    from.read_exact(&mut first).expect("the program sends");
    drop(from);
    assert_eq!(child.wait().expect("ends").code(), Some(0));
}
