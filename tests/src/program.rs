//! AVR programs for the tests: compiled from C, or written word by word.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use tempfile::{TempDir, tempdir};

use crate::{cardan, root};

/// How to install what the tests need.
const INSTALL: &str = "apt-get install gcc-avr binutils-avr avr-libc";

/// A folder that lives as long as the value.
///
/// # Panics
/// There is no room for temporary files.
#[must_use]
pub fn folder() -> TempDir {
    tempdir().expect("a temporary folder")
}

/// Writes a file into `folder`.
///
/// # Panics
/// The folder cannot be written.
pub fn write(folder: &TempDir, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let file = folder.path().join(name);
    fs::write(&file, content).expect("the folder is ours");
    file
}

/// A path as an argument.
///
/// # Panics
/// The path is not UTF-8.
#[must_use]
pub fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// Compiles `programs/NAME.c` into `folder` and returns the ELF file.
///
/// # Panics
/// The compiler is missing (with the command that installs it) or refuses the program.
#[must_use]
pub fn compile(name: &str, folder: &Path) -> PathBuf {
    compile_with(name, folder, &[])
}

/// The same with debug information, and statements in their order.
///
/// # Panics
/// As [`compile`].
#[must_use]
pub fn compile_for_debugger(name: &str, folder: &Path) -> PathBuf {
    compile_with(name, folder, &["-Og", "-g"])
}

/// The same with more options for the compiler.
///
/// # Panics
/// As [`compile`].
#[must_use]
pub fn compile_with(name: &str, folder: &Path, options: &[&str]) -> PathBuf {
    let source = root().join("tests/programs").join(format!("{name}.c"));
    compile_file(&source, folder, options)
}

/// Compiles any C file into `folder` and returns the ELF file.
///
/// # Panics
/// As [`compile`].
#[must_use]
pub fn compile_file(source: &Path, folder: &Path, options: &[&str]) -> PathBuf {
    let name = source.file_stem().expect("a file");
    let elf = folder.join(name).with_extension("elf");
    let mut gcc = Command::new("avr-gcc");
    gcc.args(["-mmcu=atmega328p", "-Os", "-Wall", "-Werror"])
        .args(options)
        .arg("-o")
        .arg(&elf)
        .arg(source);
    succeed(gcc);
    elf
}

/// The same program as Intel HEX.
///
/// # Panics
/// binutils are missing, or refuse the file.
#[must_use]
pub fn to_hex(elf: &Path) -> PathBuf {
    let hex = elf.with_extension("hex");
    let mut objcopy = Command::new("avr-objcopy");
    objcopy.args(["-O", "ihex"]).arg(elf).arg(&hex);
    succeed(objcopy);
    hex
}

fn succeed(mut command: Command) {
    let status = command.status().unwrap_or_else(|error| {
        panic!("{command:?} cannot be started ({error}); install it: {INSTALL}")
    });
    assert!(status.success(), "{command:?} fails");
}

/// Intel HEX text of program words from address 0.
#[must_use]
pub fn hex_text(words: &[u16]) -> String {
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    let mut text = String::new();
    for (index, chunk) in bytes.chunks(16).enumerate() {
        let address = (index * 16) as u16;
        let mut record = vec![chunk.len() as u8];
        record.extend(address.to_be_bytes());
        record.push(0);
        record.extend(chunk);
        let sum = record.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
        record.push(sum.wrapping_neg());
        text.push(':');
        text.extend(record.iter().map(|byte| format!("{byte:02X}")));
        text.push('\n');
    }
    text + ":00000001FF\n"
}

/// Starts the program with `arguments`, nothing to read, and both outputs to be read by the test.
///
/// # Panics
/// It does not start.
#[must_use]
pub fn start(arguments: &[&str]) -> Child {
    Command::new(cardan())
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts")
}

/// Waits for `sought` in what `child` says on standard error, and returns the rest of the line.
///
/// # Panics
/// It ends without.
pub fn announced(child: &mut Child, sought: &str) -> String {
    let mut said = String::new();
    let mut from = child.stderr.take().expect("piped");
    let mut byte = [0];
    while from.read(&mut byte).expect("readable") == 1 {
        if byte[0] == b'\n' {
            if let Some(rest) = said.strip_prefix(sought) {
                child.stderr = Some(from);
                return rest.to_owned();
            }
            said.clear();
        } else {
            said.push(char::from(byte[0]));
        }
    }
    panic!("{sought} is never said");
}
