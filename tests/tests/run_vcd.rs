//! `run --vcd`: registers and variables at the cycle of each store; read by GTKWave's tools, and by
//! `--stimulus`, which also reads what a Verilog simulator writes.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cardan_emulator::{ATMEGA328P, Image, Machine, Unconnected};
use cardan_tests::program::{compile, folder, hex_text, text, write};
use cardan_tests::{run, stderr};

/// Picoseconds per cycle at 16 MHz.
const PERIOD: u64 = 62_500;

/// Changes of each signal: time in picoseconds, value as text. Names come with their scopes.
fn changes(dump: &Path) -> BTreeMap<String, Vec<(u64, String)>> {
    let bytes = fs::read(dump).expect("written");
    let mut parser = vcd::Parser::new(&bytes[..]);
    let header = parser.parse_header().expect("a header");
    let (amount, unit) = header.timescale.expect("a time scale");
    assert_eq!(unit, vcd::TimescaleUnit::PS);
    let mut names = BTreeMap::new();
    collect(&header.items, "", &mut names);
    let mut found: BTreeMap<String, Vec<(u64, String)>> = BTreeMap::new();
    let mut now = 0;
    for command in parser {
        let (code, value) = match command.expect("a well-formed dump") {
            vcd::Command::Timestamp(time) => {
                let time = time * u64::from(amount);
                assert!(time >= now, "time runs backwards");
                now = time;
                continue;
            }
            vcd::Command::ChangeScalar(code, value) => (code, value.to_string()),
            vcd::Command::ChangeVector(code, bits) => (code, number(&bits.to_string())),
            vcd::Command::ChangeReal(code, volts) => (code, volts.to_string()),
            _ => continue,
        };
        let name = names.get(&code).expect("a declared signal").clone();
        found.entry(name).or_default().push((now, value));
    }
    found
}

fn number(bits: &str) -> String {
    let value = u64::from_str_radix(bits, 2);
    value.map_or_else(|_| bits.to_owned(), |value| value.to_string())
}

fn collect(items: &[vcd::ScopeItem], scope: &str, names: &mut BTreeMap<vcd::IdCode, String>) {
    for item in items {
        match item {
            vcd::ScopeItem::Var(var) => {
                names.insert(var.code, format!("{scope}{}", var.reference));
            }
            vcd::ScopeItem::Scope(inner) => {
                collect(
                    &inner.items,
                    &format!("{scope}{}.", inner.identifier),
                    names,
                );
            }
            _ => {}
        }
    }
}

fn dumped(folder: &Path, elf: &Path, name: &str, arguments: &[&str]) -> PathBuf {
    let dump = folder.join(name);
    let all = [&["run", text(elf), "--vcd", text(&dump)], arguments].concat();
    let output = run(&all);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    dump
}

/// Changes of values of the machine, seen step by step, as they are expected in a dump.
fn stepped(elf: &Path, value: impl Fn(&Machine, &Image) -> u64) -> Vec<(u64, String)> {
    let image = Image::read(elf, &ATMEGA328P).expect("an image");
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    let mut last = value(&machine, &image);
    let mut changes = vec![(0, last.to_string())];
    loop {
        let stop = machine.step(&mut Unconnected);
        let now = value(&machine, &image);
        if now != last {
            last = now;
            changes.push((machine.cycle() * PERIOD, now.to_string()));
        }
        if stop.is_some() {
            return changes;
        }
    }
}

/// Bytes of a variable.
fn variable(machine: &Machine, image: &Image, name: &str, bytes: usize) -> u64 {
    let address = image.symbol(name).expect("a variable").address as usize;
    let bytes = machine.data()[address..address + bytes].iter().rev();
    bytes.fold(0, |value, &byte| value << 8 | u64::from(byte))
}

const SIGNALS: [&str; 24] = [
    "--vcd-signal",
    "counter",
    "--vcd-signal",
    "level:i8",
    "--vcd-signal",
    "table:u16",
    "--vcd-signal",
    "PB0",
    "--vcd-signal",
    "OCR1A",
    "--vcd-signal",
    "PORTB",
    "--vcd-signal",
    "r24",
    "--vcd-signal",
    "sp",
    "--vcd-signal",
    "pc",
    "--vcd-signal",
    "sreg",
    "--vcd-signal",
    "@0x0100",
    "--cycles",
    "1000000",
];

#[test]
fn each_store_is_shown_at_its_own_cycle() {
    let folder = folder();
    let elf = compile("signals", folder.path());
    let dump = dumped(folder.path(), &elf, "out.vcd", &SIGNALS);
    let found = changes(&dump);
    assert_eq!(found.len(), 11, "{:?}", found.keys());
    let expected = |name: &str, value: &dyn Fn(&Machine, &Image) -> u64| {
        let expected = stepped(&elf, value);
        assert!(
            found[name] == expected,
            "{name}: {:?}, expected {expected:?}",
            found[name]
        );
        assert!(expected.len() > 1, "{name} never changes");
    };
    expected("variables.counter", &|m, i| variable(m, i, "counter", 2));
    expected("variables.level", &|m, i| variable(m, i, "level", 1));
    expected("variables.table", &|m, i| variable(m, i, "table", 2));
    expected("variables.@0x0100", &|m, _| m.data()[0x100].into());
    expected("core.r24", &|m, _| m.data()[24].into());
    expected("core.sp", &|m, _| m.sp().into());
    expected("core.pc", &|m, _| m.pc().into());
    expected("core.sreg", &|m, _| m.sreg().into());
    expected("io.PORTB", &|m, _| {
        m.stored_register(0x25).expect("it is kept").into()
    });
    // The store to PORTB takes effect on the pin at once.
    let port = &found["io.PORTB"];
    let pin = &found["pins.PB0"];
    assert!(pin == port, "{pin:?}, expected {port:?}");
    assert_eq!(pin.len(), 41);
    let compare: Vec<&str> = found["io.OCR1A"]
        .iter()
        .map(|change| change.1.as_str())
        .collect();
    assert_eq!(&compare[..3], ["0", "1000", "2000"]);
}

#[test]
fn gtkwave_reads_the_same_changes() {
    let folder = folder();
    let elf = compile("signals", folder.path());
    let dump = dumped(folder.path(), &elf, "out.vcd", &SIGNALS);
    let (fast, back) = (
        folder.path().join("out.fst"),
        folder.path().join("back.vcd"),
    );
    for (program, from, to) in [("vcd2fst", &dump, &fast), ("fst2vcd", &fast, &back)] {
        let output = Command::new(program)
            .args(match program {
                "vcd2fst" => [text(from), text(to)].to_vec(),
                _ => ["-f", text(from), "-o", text(to)].to_vec(),
            })
            .output()
            .unwrap_or_else(|error| {
                panic!("{program} cannot be started ({error}); apt-get install gtkwave")
            });
        assert!(output.status.success(), "{program}: {}", stderr(&output));
    }
    let (ours, theirs) = (changes(&dump), changes(&back));
    assert_eq!(
        ours.keys().collect::<Vec<_>>(),
        theirs.keys().collect::<Vec<_>>()
    );
    for (name, changes) in &ours {
        assert!(
            changes == &theirs[name],
            "{name}: {changes:?} {:?}",
            theirs[name]
        );
    }
}

#[test]
fn a_dump_drives_another_chip_to_the_cycle() {
    let folder = folder();
    let pulses = compile("pulses", folder.path());
    let capture = compile("capture", folder.path());
    let dump = dumped(
        folder.path(),
        &pulses,
        "pulses.vcd",
        &["--vcd-signal", "PB0"],
    );
    let edges: Vec<u64> = changes(&dump)["pins.PB0"]
        .iter()
        .skip(1)
        .map(|&(time, _)| time / PERIOD)
        .collect();
    assert!(edges.len() >= 32, "{}", edges.len());
    let output = run(&["run", text(&capture), "--stimulus", text(&dump)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let captured: Vec<u16> = output
        .stdout
        .chunks(2)
        .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
        .collect();
    assert_eq!(captured.len(), 32);
    // The timer was started some cycles after the beginning; from edge to edge it is exact.
    for (times, counts) in edges.windows(2).zip(captured.windows(2)) {
        let expected = times[1] - times[0];
        assert_eq!(u64::from(counts[1].wrapping_sub(counts[0])), expected);
    }
}

#[test]
fn voltages_are_shown_when_they_are_held() {
    let folder = folder();
    let elf = compile("convert", folder.path());
    let table = write(
        &folder,
        "s.csv",
        "t_s,adc0_V,adc3_V\n0,1.25,2.5\n0.005,3.75,0\n",
    );
    let arguments = [
        "--stimulus",
        text(&table),
        "--vcd-signal",
        "adc0_V",
        "--vcd-signal",
        "adc3_V",
    ];
    let dump = dumped(folder.path(), &elf, "volts.vcd", &arguments);
    let found = changes(&dump);
    let values = |name: &str| -> Vec<&str> {
        let changes = found[name].iter();
        changes.map(|change| change.1.as_str()).collect()
    };
    assert_eq!(values("analog.adc0_V"), ["1.25", "3.75"]);
    assert_eq!(values("analog.adc3_V"), ["2.5"]);
    // The first conversion holds 13.5 ADC clocks of 128 cycles after its start.
    let first = found["analog.adc0_V"][0].0 / PERIOD;
    assert!((1728..1728 + 300).contains(&first), "{first}");
    assert!(found["analog.adc0_V"][1].0 > 10_000_000_000, "10 ms later");
    let again = run(&[
        "run",
        text(&elf),
        "--stimulus",
        text(&dump),
        "--uart",
        "none",
    ]);
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
}

#[test]
fn names_that_are_no_signal_are_refused_with_what_was_meant() {
    let folder = folder();
    let elf = compile("signals", folder.path());
    for (name, parts) in [
        ("countr", &["countr", "did you mean `counter`"][..]),
        ("OCR1C", &["OCR1C", "OCR1A"]),
        ("portb", &["PORTB"]),
        ("TCNT1", &["by itself", "OCR1A"]),
        ("UDR0", &["reading it has an effect"]),
        ("table", &["9 bytes", "table:u8"]),
        ("PB0:u8", &["take a type"]),
        ("@0x0900:u16", &["no place in SRAM", "0x08ff"]),
        ("@0x08ff:u16", &["no place in SRAM"]),
        ("@0x0025", &["I/O registers go by name"]),
        ("@", &["@0x0123"]),
        ("r32", &["no such signal"]),
        ("", &["no such signal"]),
    ] {
        let dump = folder.path().join("none.vcd");
        let output = run(&[
            "run",
            text(&elf),
            "--vcd",
            text(&dump),
            "--vcd-signal",
            name,
        ]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{name}: {said}");
        for part in parts {
            assert!(said.contains(part), "{name} says {said:?}, not {part:?}");
        }
        assert!(!dump.exists(), "nothing is written");
    }
    let dump = folder.path().join("none.vcd");
    let twice = ["--vcd-signal", "PB0", "--vcd-signal", "PB0"];
    let output = run(&[&["run", text(&elf), "--vcd", text(&dump)], &twice[..]].concat());
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("twice"));
    let output = run(&["run", text(&elf), "--vcd-signal", "PB0"]);
    assert_eq!(output.status.code(), Some(2), "without --vcd");
}

/// Levels of PB0 that `follow` shows for a stimulus, with their times in cycles.
fn followed(folder: &Path, stimulus: &Path) -> Vec<(u64, String)> {
    let elf = compile("follow", folder);
    let arguments = ["--stimulus", text(stimulus), "--vcd-signal", "PB0"];
    let dump = dumped(folder, &elf, "followed.vcd", &arguments);
    let found = &changes(&dump)["pins.PB0"];
    found
        .iter()
        .map(|(time, level)| (time / PERIOD, level.clone()))
        .collect()
}

#[test]
fn what_a_verilog_simulator_dumps_is_a_stimulus() {
    let folder = folder();
    let source = "`timescale 1ns / 10ps
module chip(input PD2, input [7:0] bus); endmodule
module bench;
  reg PD2; reg [7:0] bus; real adc0_V; integer n; wire w = PD2;
  chip dut(PD2, bus);
  initial begin
    $dumpfile(\"bench.vcd\"); $dumpvars(0, bench);
    bus = 8'bx; adc0_V = 0.5; n = 0;
    #3125000 PD2 = 1; bus = 8'h5a; adc0_V = 1.25e-3;
    #3125000.03 PD2 = 0; bus = 8'bz; n = 7;
    #3750000 PD2 = 1'bx;
    #100 $finish;
  end
endmodule
";
    let file = write(&folder, "bench.v", source);
    let program = folder.path().join("bench");
    for (tool, arguments) in [
        ("iverilog", vec!["-o", text(&program), text(&file)]),
        ("vvp", vec![text(&program)]),
    ] {
        let output = Command::new(tool)
            .current_dir(folder.path())
            .args(&arguments)
            .output()
            .unwrap_or_else(|error| {
                panic!("{tool} cannot be started ({error}); apt-get install iverilog")
            });
        assert!(output.status.success(), "{tool}: {}", stderr(&output));
    }
    let table = write(&folder, "s.csv", "cycle,PD2\n50000,1\n100000,0\n");
    let expected = followed(folder.path(), &table);
    assert_eq!(expected.len(), 3, "{expected:?}");
    let found = followed(folder.path(), &folder.path().join("bench.vcd"));
    assert_eq!(found, expected);
}

#[test]
fn dialects_of_dumps_and_tables_mean_the_same() {
    let folder = folder();
    let table = write(&folder, "s.csv", "cycle,PD2\n50000,1\n100000,0\n");
    let expected = followed(folder.path(), &table);
    let body = "$enddefinitions $end\n$dumpvars\n0!\n$end\n";
    let head = |scale: &str| format!("$timescale {scale} $end $var wire 1 ! PD2 $end {body}");
    let vector = "$timescale 1ps $end $var reg 1 ! PD2 [0:0] $end $enddefinitions $end\n\
                  #0 bx !\n#3125000000 b1 !\n#6250000000 b0 !\n";
    let aliased = "$date today $end $version 3.2 $end $timescale 10 us $end \
                   $scope module tb $end $var wire 1 ! PD2 $end $scope module tb $end \
                   $var wire 1 ! PD2 $end $var wire 4 \" PB [3:0] $end $upscope $end $upscope $end \
                   $enddefinitions $end $comment starts $end #0 0! bxz01 \" #312 \
                   $dumpoff x! bx \" $end $dumpon 0! b1 \" $end\n";
    let dumps = [
        (
            "1 fs",
            head("1 fs") + "#3125000000000 1!\n#6250000000000 0!\n",
        ),
        (
            "1 ps, CRLF",
            (head("1ps") + "#3125000000\n1!\n#6250000000\n0!\n").replace('\n', "\r\n"),
        ),
        ("100 ns", head("100ns") + "#31250 1! #62500 0!"),
        ("us", head("1 us") + "#3125 1!\n#6250 0!\n"),
        (
            "marked",
            "\u{feff}".to_owned() + &head("1us") + "#3125 1!\n#6250 0!\n",
        ),
        ("vector", vector.to_owned()),
        ("256 scopes", nested(256)),
    ];
    for (name, dump) in dumps {
        let file = write(&folder, "dialect.vcd", dump);
        assert_eq!(followed(folder.path(), &file), expected, "{name}");
    }
    let aliased = write(&folder, "aliased.vcd", aliased);
    assert_eq!(followed(folder.path(), &aliased), [(0, "0".to_owned())]);
    for (name, content) in [
        ("CRLF", "cycle,PD2\r\n50000,1\r\n100000,0\r\n"),
        ("marked", "\u{feff}cycle,PD2\n50000,1\n100000,0\n"),
        ("quoted", "\"cycle\",\"PD2\"\n50000,1\n\n100000,0"),
        ("seconds", "t_s,PD2\n3.125e-3,1\n0.00625,0\n"),
    ] {
        let file = write(&folder, "dialect.csv", content);
        assert_eq!(followed(folder.path(), &file), expected, "{name}");
    }
}

/// PD2 inside so many scopes; the same inputs as elsewhere.
fn nested(scopes: usize) -> String {
    format!(
        "$timescale 1 us $end {} $var wire 1 ! PD2 $end {} $enddefinitions $end\n\
         $dumpvars\n0!\n$end\n#3125 1!\n#6250 0!\n",
        "$scope module a $end ".repeat(scopes),
        "$upscope $end ".repeat(scopes)
    )
}

#[test]
fn what_no_input_can_be_is_refused_with_its_place() {
    let folder = folder();
    let program = write(&folder, "good.hex", hex_text(&[0xE089, 0xCFFF]));
    let one = "$timescale 1 ns $end $var wire 1 ! PB0 $end $enddefinitions $end\n";
    for (content, parts) in [
        (
            "$timescale 1 ns $end $scope module a $end $var wire 1 ! PB0 $end $upscope $end \
             $scope module b $end $var wire 1 \" PB0 $end $upscope $end $enddefinitions $end"
                .to_owned(),
            &["a.PB0", "b.PB0", "rename"][..],
        ),
        (
            "$timescale 1 ns $end $var reg 16 ! adc0_V $end $enddefinitions $end\n#0 b101 !\n"
                .to_owned(),
            &["adc0_V", "real"],
        ),
        (
            "$timescale 1 ns $end $var real 64 ! PB0 $end $enddefinitions $end\n#0 r1 !\n"
                .to_owned(),
            &["PB0", "real"],
        ),
        (nested(257), &["nested deeper than 256", "dump of a design"]),
        (format!("{one}#0 b10 !\n"), &["line 2", "2 bits"]),
        (format!("{one}#0\n1!\n$attribute\n"), &["line 4", "command"]),
        (
            "$timescale 1 h $end $var wire 1 ! PB0 $end $enddefinitions $end".to_owned(),
            &["line 1", "unit"],
        ),
        (
            "t_s;adc0_V\n0;1\n".to_owned(),
            &["line 1", "semicolons", "commas"],
        ),
    ] {
        let file = write(&folder, "bad.file", content);
        let output = run(&["run", text(&program), "--stimulus", text(&file)]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        for part in parts {
            assert!(said.contains(part), "{said:?} does not say {part:?}");
        }
    }
}
