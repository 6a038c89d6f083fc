//! ELF and Intel HEX images: what avr-gcc and avr-objcopy write, and what is broken.

mod common;

use std::path::Path;
use std::sync::OnceLock;

use cardan_emulator::{ATMEGA328P, Image, LoadProblem, Memory};
use proptest::prelude::*;

const SOURCE: &str = "
#include <avr/eeprom.h>
#include <avr/io.h>
#include <avr/fuse.h>
FUSES = {.low = 0xE2, .high = 0xD9, .extended = 0xFF};
uint16_t EEMEM stored = 0x1234;
volatile uint8_t data[3] = {1, 2, 3};
volatile uint8_t zeros[5];
int main(void) { zeros[0] = data[1]; return eeprom_read_word(&stored); }
";

/// A good ELF file, compiled once.
fn good_elf() -> &'static [u8] {
    static ELF: OnceLock<Vec<u8>> = OnceLock::new();
    ELF.get_or_init(|| {
        let file = common::compile("loader", "c", SOURCE, &["-Os"]);
        std::fs::read(file).expect("just written")
    })
}

fn problem(bytes: &[u8]) -> LoadProblem {
    let error = Image::parse("a.elf", bytes, &ATMEGA328P).expect_err("a bad image");
    assert!(error.to_string().starts_with("a.elf: "), "{error}");
    error.problem
}

#[test]
fn an_elf_file_fills_flash_eeprom_fuses_and_symbols() {
    let image = Image::parse("a.elf", good_elf(), &ATMEGA328P).expect("a good image");
    assert_eq!(image.eeprom, [0x34, 0x12]);
    assert_eq!(image.fuses, Some([0xE2, 0xD9, 0xFF]));
    // Initial values of .data follow the code at their load address.
    assert!(image.flash.windows(3).any(|bytes| bytes == [1, 2, 3]));
    let symbol = |name: &str| {
        let symbol = image
            .symbol(name)
            .unwrap_or_else(|| panic!("no symbol {name}"));
        (symbol.memory, symbol.size)
    };
    assert_eq!(symbol("data"), (Memory::Data, 3));
    assert_eq!(symbol("zeros"), (Memory::Data, 5));
    assert_eq!(symbol("stored"), (Memory::Eeprom, 2));
    assert_eq!(symbol("main").0, Memory::Flash);
    assert_eq!(image.symbol("data").map(|s| s.address), Some(0x100));
}

#[test]
fn a_hex_file_holds_the_same_flash_as_its_elf_file() {
    let file = common::compile("loader_hex", "c", SOURCE, &["-Os"]);
    let hex = file.with_extension("hex");
    let path = |path: &Path| path.to_str().expect("UTF-8").to_owned();
    let arguments = [
        "-O",
        "ihex",
        "-R",
        ".eeprom",
        "-R",
        ".fuse",
        &path(&file),
        &path(&hex),
    ];
    common::tool("avr-objcopy", &arguments);
    let from_hex = Image::read(&hex, &ATMEGA328P).expect("a good image");
    let from_elf = Image::read(&file, &ATMEGA328P).expect("a good image");
    assert_eq!(from_hex.flash, from_elf.flash);
}

#[test]
fn broken_elf_files_say_what_is_wrong() {
    let good = good_elf();
    let patched = |offset: usize, byte: u8| {
        let mut bytes = good.to_vec();
        bytes[offset] = byte;
        problem(&bytes)
    };
    assert_eq!(problem(b""), LoadProblem::Empty);
    assert_eq!(
        problem(b"\x7fELF"),
        LoadProblem::BadElf("the file ends within its header".into())
    );
    assert!(matches!(problem(&good[..100]), LoadProblem::BadElf(_)));
    assert!(matches!(
        problem(&good[..good.len() / 2]),
        LoadProblem::BadElf(_)
    ));
    assert_eq!(patched(18, 62), LoadProblem::WrongMachine(62));
    assert_eq!(patched(16, 1), LoadProblem::NotExecutable(1));
    assert_eq!(patched(4, 2), LoadProblem::WrongClass);
    assert_eq!(problem(b"plain text"), LoadProblem::UnknownFormat);
    assert_eq!(problem(&[0xFF, 0xFE, 0x00]), LoadProblem::UnknownFormat);
}

#[test]
fn broken_hex_files_name_the_line() {
    let end = ":00000001FF\n";
    let check = |text: &str, line: usize, word: &str| match problem(text.as_bytes()) {
        LoadProblem::BadHex {
            line: found,
            reason,
        } => {
            assert_eq!(found, line, "{reason}");
            assert!(reason.to_lowercase().contains(word), "{reason}");
        }
        other => panic!("{other:?}"),
    };
    check(
        &format!(":0100000000FF\n:0100010000FD\n{end}"),
        2,
        "checksum",
    );
    check(&format!(":0100000000FF\n:01000\n{end}"), 2, "too short");
    check(&format!(":0100000000FF\nxyz\n{end}"), 2, "start code");
    check(&format!(":0100000000FF\n{end}:0100010000FE\n"), 3, "after");
    assert_eq!(problem(b":0100000000FF\n"), LoadProblem::HexNotEnded);
    assert_eq!(problem(end.as_bytes()), LoadProblem::NoProgram);
    assert_eq!(problem(b"\n  \n"), LoadProblem::Empty);
    // One byte at 0x8000: beyond the flash.
    let large = format!(":020000040000FA\n:018000000178\n{}", end).replace("0178", "017E");
    assert!(matches!(
        problem(large.as_bytes()),
        LoadProblem::TooLarge { end: 0x8001, .. }
    ));
}

#[test]
fn a_file_that_does_not_exist_is_an_error_with_its_name() {
    let error = Image::read(Path::new("no/such.elf"), &ATMEGA328P).expect_err("no file");
    assert!(matches!(error.problem, LoadProblem::Unreadable(_)));
    assert!(error.to_string().contains("no/such.elf"));
}

proptest! {
    #[test]
    fn no_bytes_make_the_loader_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = Image::parse("random", &bytes, &ATMEGA328P);
        let mut elf = b"\x7fELF\x01\x01\x01".to_vec();
        elf.extend(&bytes);
        let _ = Image::parse("random", &elf, &ATMEGA328P);
    }

    #[test]
    fn a_damaged_elf_file_never_panics(at in 0usize..2000, value in any::<u8>()) {
        let mut bytes = good_elf().to_vec();
        let at = at % bytes.len();
        bytes[at] = value;
        let _ = Image::parse("damaged", &bytes, &ATMEGA328P);
    }
}
