//! The committed firmware images: what their sources make, and what they do.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::Path;

use cardan_emulator::{ATMEGA328P, AnalogInput, Environment, Image, Machine, Memory, Stop};
use cardan_tests::{root, run, stderr};
use tempfile::tempdir;
use toml::Table;

/// Folder of the committed images.
const IMAGES: &str = "firmware/boards/atmega328p/images";
/// Symbol of the tap table.
const TAPS: &str = "CARDAN_TAPS";
/// Serial bytes that a behaviour is judged by: 60 frames.
const BYTES: usize = 60 * 22;
/// Conversions of a solution.
const CONVERSIONS: u64 = 64;
/// Far more cycles than 60 frames take.
const LIMIT: u64 = 40_000_000;

fn record(folder: &Path) -> Table {
    let file = folder.join("toolchain.toml");
    let text =
        fs::read_to_string(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    text.parse().expect("the record is TOML")
}

fn bytes(folder: &Path, name: &str) -> Vec<u8> {
    fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// The toolchain without Cargo, which leaves no mark in an image.
fn compilers(record: &Table) -> Table {
    let mut toolchain = record["toolchain"].as_table().expect("a table").clone();
    toolchain.remove("cargo");
    toolchain
}

/// Builds both images from source into `folder`.
fn rebuild(folder: &Path) {
    let out = folder.to_str().expect("a path in UTF-8");
    let output = run(&["build", "--target", "atmega328p", "--quiet", "--out", out]);
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn the_images_hold_no_panic_and_no_floating_point() {
    use object::{Object as _, ObjectSymbol as _};
    // Names of what compilers call for them: core's panics, libgcc's and compiler-builtins' floats.
    let forbidden = [
        "panic", "__addsf3", "__mulsf3", "__divsf3", "__adddf3", "__muldf3",
    ];
    for name in ["plain.elf", "tapped.elf"] {
        let bytes = bytes(&root().join(IMAGES), name);
        let elf = object::File::parse(&*bytes).expect("an ELF");
        let symbols: Vec<&str> = elf
            .symbols()
            .filter_map(|symbol| symbol.name().ok())
            .collect();
        // A control: what an image without symbols holds cannot be seen.
        assert!(
            symbols
                .iter()
                .any(|symbol| symbol.contains("square_root16")),
            "{name}"
        );
        for symbol in symbols {
            assert!(
                !forbidden.iter().any(|part| symbol.contains(part)),
                "{name}: {symbol}"
            );
        }
    }
}

#[test]
fn the_committed_images_are_what_their_sources_make() {
    let committed = root().join(IMAGES);
    let fresh = tempdir().expect("a temporary folder");
    rebuild(fresh.path());
    let (old, new) = (record(&committed), record(fresh.path()));
    assert_eq!(
        old["sources"], new["sources"],
        "the firmware has changed since its images were built: run `cargo xtask images`"
    );
    let shown = if compilers(&old) == compilers(&new) {
        for name in ["plain.elf", "tapped.elf"] {
            let is_equal = bytes(&committed, name) == bytes(fresh.path(), name);
            assert!(
                is_equal,
                "{name}: the same sources and toolchain give other bytes"
            );
        }
        "the recorded toolchain: the bytes are equal"
    } else {
        for name in ["plain.elf", "tapped.elf"] {
            let (old, new) = (bytes(&committed, name), bytes(fresh.path(), name));
            assert_eq!(
                Behaviour::of(&old),
                Behaviour::of(&new),
                "{name} behaves otherwise"
            );
        }
        "another toolchain than the recorded one: frames and taps are equal"
    };
    // Past the test harness, which would keep it to itself.
    let _ = writeln!(std::io::stderr(), "images rebuilt with {shown}");
}

#[test]
fn the_record_names_the_committed_images() {
    let committed = root().join(IMAGES);
    let record = record(&committed);
    let formats = record["sources"]["formats"].as_str().expect("a text");
    assert_eq!(formats.len(), 16, "the hash of the formats");
    for name in ["plain", "tapped"] {
        let elf = bytes(&committed, &format!("{name}.elf"));
        let size = record["images"][name]["bytes"]
            .as_integer()
            .expect("a number");
        assert_eq!(size, elf.len() as i64, "{name}");
        assert!(elf.len() < 100_000, "{name} holds debug information");
        // Where this checkout and this user's files lie, and what every compiler's paths hold.
        let home = std::env::var("HOME").expect("HOME is set");
        let checkout = root().display().to_string();
        for part in [
            checkout.as_str(),
            &home,
            "/home/",
            "/rustlib/",
            "registry/src",
        ] {
            let is_there = elf
                .windows(part.len())
                .any(|window| window == part.as_bytes());
            assert!(!is_there, "{name} holds a path: {part}");
        }
    }
}

#[test]
fn plain_and_tapped_images_send_the_same_frames() {
    let committed = root().join(IMAGES);
    let plain = Behaviour::of(&bytes(&committed, "plain.elf"));
    let tapped = Behaviour::of(&bytes(&committed, "tapped.elf"));
    assert_eq!(plain.frames, tapped.frames);
    assert!(plain.nodes.is_empty());
    assert!(tapped.nodes.len() > 20, "{} nodes", tapped.nodes.len());
}

#[test]
fn a_behaviour_shows_a_single_changed_constant() {
    let committed = bytes(&root().join(IMAGES), "tapped.elf");
    let behaviour = Behaviour::of(&committed);
    assert_eq!(behaviour, Behaviour::of(&committed));
    let other = Behaviour::with_voltages(&committed, |solution, channel| {
        if (solution, channel) == (30, 2) {
            2.6
        } else {
            voltage(solution, channel)
        }
    });
    assert_ne!(behaviour, other);
}

/// What an image does with given voltages: its frames, and the values of each node in order.
#[derive(Debug, PartialEq)]
struct Behaviour {
    frames: Vec<u8>,
    nodes: BTreeMap<u8, Vec<i32>>,
}

impl Behaviour {
    fn of(elf: &[u8]) -> Self {
        Self::with_voltages(elf, voltage)
    }

    fn with_voltages(elf: &[u8], volts: fn(u64, u8) -> f64) -> Self {
        let image = Image::parse("image", elf, &ATMEGA328P).expect("an image");
        let symbol = image
            .symbol(TAPS)
            .filter(|symbol| symbol.memory == Memory::Data);
        let taps = symbol.map(|symbol| symbol.address as usize);
        let mut desk = Desk {
            volts,
            taps,
            conversions: 0,
            frames: Vec::new(),
            nodes: BTreeMap::new(),
        };
        let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
        machine.load(&image);
        assert_eq!(machine.run(&mut desk, LIMIT), Stop::Requested, "no frames");
        // How far the sample interrupt has come when the last byte leaves is a matter of timing.
        for values in desk.nodes.values_mut() {
            let per_solution = values.len() / 60;
            values.truncate(per_solution.max(1) * 58);
        }
        Self {
            frames: desk.frames,
            nodes: desk.nodes,
        }
    }
}

/// The world around the chip. Voltages go by the number of the conversion, not by the cycle: images
/// of different compilers start at different cycles.
struct Desk {
    volts: fn(u64, u8) -> f64,
    taps: Option<usize>,
    conversions: u64,
    frames: Vec<u8>,
    nodes: BTreeMap<u8, Vec<i32>>,
}

impl Environment for Desk {
    fn analog(&mut self, _cycle: u64, input: AnalogInput) -> f64 {
        let AnalogInput::Pin(channel) = input else {
            return 0.0;
        };
        let solution = self.conversions / CONVERSIONS;
        self.conversions += 1;
        (self.volts)(solution, channel)
    }

    fn uart_tx(&mut self, _cycle: u64, byte: u8) {
        self.frames.push(byte);
    }

    fn strobe(&mut self, _cycle: u64, value: u8, data: &[u8]) {
        let Some(taps) = self.taps else { return };
        let at = taps + 4 * usize::from(value);
        let word = [data[at], data[at + 1], data[at + 2], data[at + 3]];
        self.nodes
            .entry(value)
            .or_default()
            .push(i32::from_le_bytes(word));
    }

    fn stop_requested(&self) -> bool {
        self.frames.len() >= BYTES
    }
}

/// Voltages between the rails that differ from solution to solution.
fn voltage(solution: u64, channel: u8) -> f64 {
    let step = (solution * 37 + u64::from(channel) * 101) % 251;
    0.1 + 4.8 * step as f64 / 250.0
}
