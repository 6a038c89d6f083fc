//! Helpers of the integration tests: external tools and assembled programs.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test program uses its part of the helpers"
)]

pub mod random;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use cardan_emulator::{
    ATMEGA328P, AnalogInput, Conversion, Environment, Image, Machine, Pin, ResetCause, SerialByte,
};

/// How to install what the tests need. A missing tool fails the test: it must not pass unseen.
pub const INSTALL: &str = "sudo apt-get install gcc gcc-avr binutils-avr avr-libc gdb-avr simavr libsimavr-dev libelf-dev";

/// A directory for compiled programs that lives as long as the test process.
fn scratch() -> &'static Path {
    static DIRECTORY: OnceLock<tempfile::TempDir> = OnceLock::new();
    DIRECTORY
        .get_or_init(|| tempfile::tempdir().expect("a temporary directory"))
        .path()
}

/// Runs a tool and panics with its output, or with the install command if it is missing.
pub fn tool(program: &str, arguments: &[&str]) {
    let output = Command::new(program)
        .args(arguments)
        .output()
        .unwrap_or_else(|error| {
            panic!("{program} cannot be started ({error}); install what the tests need: {INSTALL}")
        });
    assert!(
        output.status.success(),
        "{program} {arguments:?} failed (tools missing? {INSTALL}):\n{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// Compiles a host program in C from `tests/oracle` against simavr.
pub fn oracle(name: &str) -> PathBuf {
    let source = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/oracle")
        .join(name);
    let program = scratch().join(name.trim_end_matches(".c"));
    tool(
        "gcc",
        &[
            "-O2",
            "-Wall",
            "-o",
            text(&program),
            text(&source),
            "-lsimavr",
        ],
    );
    program
}

/// Compiles `source` (C if `extension` is `c`, assembler if `S`) for the ATmega328P.
pub fn compile(name: &str, extension: &str, source: &str, options: &[&str]) -> PathBuf {
    let file = scratch().join(format!("{name}.{extension}"));
    let elf = scratch().join(format!("{name}.elf"));
    std::fs::write(&file, source).expect("the scratch directory is writable");
    let mut arguments = vec!["-mmcu=atmega328p", "-DF_CPU=16000000UL", "-o", text(&elf)];
    arguments.push(text(&file));
    arguments.extend(options);
    tool("avr-gcc", &arguments);
    elf
}

/// Compiles a file in C for the ATmega328P.
pub fn compile_file(file: &Path) -> PathBuf {
    let name = file.file_stem().expect("a file in C");
    let elf = scratch().join(name).with_extension("elf");
    tool(
        "avr-gcc",
        &[
            "-mmcu=atmega328p",
            "-DF_CPU=16000000UL",
            "-Os",
            "-std=gnu99",
            "-o",
            text(&elf),
            text(file),
        ],
    );
    elf
}

/// A machine at 16 MHz with the assembled program. `source` is the code from address 0, with
/// names of I/O registers as data addresses (so: lds/sts, or in/out with `_SFR_IO_ADDR`).
pub fn assembled(name: &str, source: &str) -> Machine {
    let source = format!("#include <avr/io.h>\n.global __vectors\n__vectors:\n{source}\n");
    let elf = compile(name, "S", &source, &["-nostartfiles", "-nostdlib"]);
    let image = Image::read(&elf, &ATMEGA328P).expect("avr-gcc writes a good ELF file");
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    machine
}

/// A machine at 16 MHz with a program in C, linked with libc and libm.
pub fn compiled(name: &str, source: &str) -> Machine {
    let elf = compile(name, "c", source, &["-Os", "-std=gnu99", "-lm"]);
    let image = Image::read(&elf, &ATMEGA328P).expect("avr-gcc writes a good ELF file");
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    machine
}

/// Collects what a program sends over the serial line.
#[derive(Default)]
pub struct Terminal {
    /// Bytes with the cycles at which their stop bits ended.
    pub bytes: Vec<(u64, u8)>,
}

impl Environment for Terminal {
    fn uart_tx(&mut self, cycle: u64, byte: u8) {
        self.bytes.push((cycle, byte));
    }
}

impl Terminal {
    /// The bytes as text.
    pub fn text(&self) -> String {
        self.bytes
            .iter()
            .map(|&(_, byte)| char::from(byte))
            .collect()
    }
}

/// A bench that drives pins by a script and writes down everything the chip does.
#[derive(Default)]
pub struct Bench {
    /// Input levels: cycle, pin, level, in the order of their cycles.
    pub inputs: Vec<(u64, Pin, bool)>,
    /// Bytes to send to the chip.
    pub serial_in: std::collections::VecDeque<SerialByte>,
    /// Voltage of every analog input as a function of the cycle.
    pub volts: Option<fn(u64, AnalogInput) -> f64>,
    pub edges: Vec<(u64, Pin, bool)>,
    pub asked: Vec<(u64, AnalogInput)>,
    pub conversions: Vec<Conversion>,
    pub ignored: Vec<u64>,
    pub sent: Vec<(u64, u8)>,
    pub strobes: Vec<(u64, u8)>,
    pub spi: Vec<(u64, u8)>,
    pub twi: Vec<String>,
    pub clocks: Vec<(u64, u64)>,
    pub resets: Vec<(u64, ResetCause)>,
}

impl Bench {
    /// Cycles and levels of the edges of one pin.
    pub fn edges_of(&self, pin: Pin) -> Vec<(u64, bool)> {
        self.edges
            .iter()
            .filter(|edge| edge.1 == pin)
            .map(|edge| (edge.0, edge.2))
            .collect()
    }

    /// Cycles of the strobes, which the tests use as marks.
    pub fn marks(&self) -> Vec<u64> {
        self.strobes.iter().map(|strobe| strobe.0).collect()
    }
}

impl Environment for Bench {
    fn pin_edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        assert!(
            self.edges.last().is_none_or(|last| last.0 <= cycle),
            "edges out of order"
        );
        self.edges.push((cycle, pin, level));
    }

    fn pin_level(&mut self, cycle: u64, pin: Pin) -> Option<bool> {
        let past = self
            .inputs
            .iter()
            .rev()
            .find(|input| input.1 == pin && input.0 <= cycle);
        past.map(|input| input.2)
    }

    fn analog(&mut self, cycle: u64, input: AnalogInput) -> f64 {
        self.asked.push((cycle, input));
        self.volts.map_or(0.0, |volts| volts(cycle, input))
    }

    fn conversion(&mut self, event: Conversion) {
        self.conversions.push(event);
    }

    fn trigger_ignored(&mut self, cycle: u64) {
        self.ignored.push(cycle);
    }

    fn uart_tx(&mut self, cycle: u64, byte: u8) {
        self.sent.push((cycle, byte));
    }

    fn uart_rx(&mut self, _cycle: u64) -> Option<SerialByte> {
        self.serial_in.pop_front()
    }

    fn strobe(&mut self, cycle: u64, value: u8, _data: &[u8]) {
        self.strobes.push((cycle, value));
    }

    fn spi_exchange(&mut self, cycle: u64, byte: u8) -> u8 {
        self.spi.push((cycle, byte));
        !byte
    }

    fn twi_start(&mut self, _cycle: u64) {
        self.twi.push("start".to_owned());
    }

    fn twi_address(&mut self, _cycle: u64, address: u8) -> bool {
        self.twi.push(format!("address {address:02x}"));
        address >> 1 == 0x50
    }

    fn twi_write(&mut self, _cycle: u64, byte: u8) -> bool {
        self.twi.push(format!("write {byte:02x}"));
        true
    }

    fn twi_read(&mut self, _cycle: u64, acknowledged: bool) -> u8 {
        self.twi.push(format!("read {acknowledged}"));
        0xA5
    }

    fn twi_stop(&mut self, _cycle: u64) {
        self.twi.push("stop".to_owned());
    }

    fn clock_changed(&mut self, cycle: u64, hz: u64) {
        self.clocks.push((cycle, hz));
    }

    fn reset(&mut self, cycle: u64, cause: ResetCause) {
        self.resets.push((cycle, cause));
    }

    fn next_input(&self, cycle: u64) -> Option<u64> {
        self.inputs
            .iter()
            .map(|input| input.0)
            .find(|&at| at > cycle)
    }
}

/// Macros for assembled programs: `set REGISTER, value`, `get rN, REGISTER`, `mark value` (a
/// strobe), a vector table of `jmp` by number.
pub const PRELUDE: &str = "
.macro set register, value
    ldi r16, \\value
    sts \\register, r16
.endm
.macro set16 register, value
    ldi r16, hi8(\\value)
    sts \\register + 1, r16
    ldi r16, lo8(\\value)
    sts \\register, r16
.endm
.macro mark value
    ldi r17, \\value
    out 0x1e, r17
.endm
.macro nops count
    .rept \\count
    nop
    .endr
.endm
.macro vector number, target
    .org 4 * \\number
    jmp \\target
.endm
";

/// Assembles `source` behind the prelude; execution starts at its label `start`.
pub fn program(name: &str, source: &str) -> Machine {
    assembled(name, &format!("{PRELUDE}\n jmp start\n{source}\n"))
}
