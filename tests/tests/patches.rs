//! Faults in the compiled image alone are caught: constants and instruction bits are patched one at
//! a time, and whatever changes an output fails the comparison and is named.

use std::fs;

use cardan_tests::{root, run, stderr};
use object::{Object, ObjectSection, ObjectSymbol};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};
use serde_json::Value;

/// Patches of each kind.
const PATCHES: usize = 20;
/// Simulated seconds: 113 solutions, which exercise every node.
const SECONDS: &str = "1";
/// Seed of the choice of places.
const SEED: u64 = 20_261_122;

/// The bundled image with its code's place in the file.
struct Image {
    bytes: Vec<u8>,
    /// File offset of flash address 0.
    start: usize,
    /// Flash addresses of the words that belong to the product's own functions.
    code: Vec<usize>,
}

impl Image {
    fn bundled() -> Self {
        let path = root().join("firmware/boards/atmega328p/images/tapped.elf");
        let bytes = fs::read(path).expect("the image is committed");
        let elf = object::File::parse(&*bytes).expect("ELF");
        let text = elf.section_by_name(".text").expect(".text");
        let (start, _) = text.file_range().expect("has bytes");
        let mut code = Vec::new();
        for symbol in elf.symbols() {
            let name = symbol.name().unwrap_or_default();
            // Text lines are not sent in this run; the rest of the product's code is.
            let of_the_product = (name.contains("cardan") || name.starts_with("__vector_"))
                && !name.contains("decimal");
            if of_the_product && symbol.kind() == object::SymbolKind::Text && symbol.size() > 0 {
                let first = (symbol.address() - text.address()) as usize;
                code.extend((first..first + symbol.size() as usize).step_by(2));
            }
        }
        code.sort_unstable();
        code.dedup();
        let start = start as usize;
        Self { bytes, start, code }
    }

    fn word(&self, address: usize) -> u16 {
        let at = self.start + address;
        u16::from_le_bytes([self.bytes[at], self.bytes[at + 1]])
    }

    fn with_word(&self, address: usize, word: u16) -> Vec<u8> {
        let mut bytes = self.bytes.clone();
        bytes[self.start + address..][..2].copy_from_slice(&word.to_le_bytes());
        bytes
    }
}

/// What the first reason of a fault in the chip begins with.
const PARTIES: [&str; 6] = [
    "node ",
    "frames: ",
    "status: ",
    "timing: ",
    "controller: ",
    "converter: ",
];

/// One patched word.
struct Patch {
    address: usize,
    before: u16,
    after: u16,
}

fn patches(image: &Image) -> Vec<Patch> {
    let mut random = ChaCha8Rng::seed_from_u64(SEED);
    let mut below = |limit: usize| random.next_u64() as usize % limit;
    // LDI Rd, K: the constants of the code; one bit of K.
    let constants: Vec<usize> = image
        .code
        .iter()
        .copied()
        .filter(|&at| image.word(at) & 0xf000 == 0xe000)
        .collect();
    let mut all = Vec::new();
    for kind in [&constants, &image.code] {
        for _ in 0..PATCHES {
            let address = kind[below(kind.len())];
            let before = image.word(address);
            let bit = if std::ptr::eq(kind, &constants) {
                [0, 1, 2, 3, 8, 9, 10, 11][below(8)]
            } else {
                below(16)
            };
            all.push(Patch {
                address,
                before,
                after: before ^ 1 << bit,
            });
        }
    }
    all
}

/// What the device puts out: all but host times and the controller's own counters.
fn outputs(document: &Value) -> Value {
    let mut document = document.clone();
    let object = document.as_object_mut().expect("an object");
    for key in ["checks", "emulator", "link", "reproduce", "seconds"] {
        object.remove(key);
    }
    document
}

/// Why a patch that passed did no harm: it changed nothing, or only how long the start-up takes. The
/// device then samples the motion at other instants, and every bit is right for what it sampled.
fn harmless(document: &Value, baseline: &Value) -> &'static str {
    let start = |document: &Value| document["emulator"]["first_conversion_cycle"].as_u64();
    if start(document) != start(baseline) {
        return " (starts at another cycle)";
    }
    assert_eq!(
        outputs(document)["nodes"],
        outputs(baseline)["nodes"],
        "an output changed"
    );
    assert_eq!(outputs(document), outputs(baseline), "an output changed");
    ""
}

#[test]
fn every_patch_that_changes_an_output_is_caught_and_named() {
    let image = Image::bundled();
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("patched.elf");
    let compare = |bytes: &[u8]| {
        fs::write(&file, bytes).expect("writes");
        let file = file.to_str().expect("a name");
        let output = run(&[
            "compare",
            "--in-process",
            "--json",
            "--quiet",
            "--seconds",
            SECONDS,
            "--firmware",
            file,
        ]);
        let document: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
        (output.status.code(), document, stderr(&output))
    };
    let (code, baseline, errors) = compare(&image.bytes);
    assert_eq!(code, Some(0), "the unpatched image passes: {errors}");
    let (mut caught, mut silent) = (0, Vec::new());
    for patch in patches(&image) {
        let Patch {
            address,
            before,
            after,
        } = patch;
        let place = format!("{address:#06x}: {before:04x} -> {after:04x}");
        let (code, document, errors) = compare(&image.with_word(address, after));
        match code {
            Some(0) => silent.push(place + harmless(&document, &baseline)),
            Some(1) => {
                let first = document["reasons"][0].as_str().expect("a reason");
                assert!(
                    PARTIES.iter().any(|party| first.starts_with(party))
                        || first.contains(" off the design's schedule"),
                    "{place}: {first}"
                );
                println!("caught {place}: {first}");
                caught += 1;
            }
            Some(3 | 4) => {
                println!(
                    "caught {place}: {}",
                    errors.lines().last().unwrap_or_default()
                );
                caught += 1;
            }
            other => panic!("{place}: exit {other:?}: {errors}"),
        }
    }
    println!(
        "{caught} of {} patches caught; these change nothing:",
        2 * PATCHES
    );
    for place in &silent {
        println!("  {place}");
    }
    assert_eq!(caught + silent.len(), 2 * PATCHES);
    assert!(caught >= PATCHES / 2, "most code matters: {caught} caught");
}

/// Exit code and first reason of the patched image's comparison.
fn verdict(bytes: &[u8]) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("patched.elf");
    fs::write(&file, bytes).expect("writes");
    let file = file.to_str().expect("a name");
    let output = run(&[
        "compare",
        "--in-process",
        "--json",
        "--quiet",
        "--seconds",
        SECONDS,
        "--firmware",
        file,
    ]);
    let document: Value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    let first = document["reasons"][0].as_str().unwrap_or_default();
    (output.status.code(), format!("{first}{}", stderr(&output)))
}

/// Faults that no node shows, since native works on the codes that they caused: each is a change of
/// every instruction of one kind in the product's own code.
#[test]
fn faults_of_the_chip_that_no_node_shows_are_caught_and_named() {
    type Change = fn(u16) -> Option<u16>;
    const NOP: u16 = 0;
    let faults: [(&str, Change, &str); 5] = [
        (
            "interrupts do not restore SREG",
            // OUT 0x3f, Rr, in handlers only.
            |word| (word & 0xfe0f == 0xbe0f).then_some(NOP),
            "controller: interrupts that return with other registers",
        ),
        (
            "the solving pin is dead",
            // SBI 0x05, 5.
            |word| (word == 0x9a2d).then_some(NOP),
            "timing: ",
        ),
        (
            "the core does not sleep",
            |word| (word == 0x9588).then_some(NOP),
            "controller: share of the time awake",
        ),
        (
            "the converter takes AREF instead of AVCC",
            // ORI Rd, 0x40: the reference bits of ADMUX.
            |word| (word & 0xff0f == 0x6400).then_some(word & !0x0400),
            "converter: ",
        ),
        (
            "the converter's clock is halved",
            // The prescaler's last bit, 128 to 64, in ADCSRA with its enable, trigger and interrupt.
            |word| (word & 0xff0f == 0xea0f).then_some(word & !0x0001),
            "timing: ",
        ),
    ];
    let image = Image::bundled();
    for (name, change, expected) in faults {
        let mut bytes = image.bytes.clone();
        let mut changed = 0;
        for &address in &image.code {
            if let Some(word) = change(image.word(address)) {
                bytes[image.start + address..][..2].copy_from_slice(&word.to_le_bytes());
                changed += 1;
            }
        }
        assert!(changed > 0, "{name}: the image has no such instruction");
        let (code, told) = verdict(&bytes);
        assert!(
            matches!(code, Some(1 | 3 | 4)),
            "{name}: exit {code:?}: {told}"
        );
        assert!(
            told.starts_with(expected),
            "{name}: expected '{expected}': {told}"
        );
    }
}
