//! Helpers of the integration tests: external tools and assembled programs.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test program uses its part of the helpers"
)]

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use cardan_emulator::{ATMEGA328P, Environment, Image, Machine};

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
