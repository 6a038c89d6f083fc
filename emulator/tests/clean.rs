//! No false alarm: the handlers of a compiler's programs give back what they found. Handlers written
//! by hand that do not are named here, with what they change.

mod common;

use std::path::{Path, PathBuf};

use cardan_emulator::{ATMEGA328P, AnalogInput, Image, Machine, SerialByte, Unconnected};
use common::{Bench, compile_file};

/// Cycles of each run.
const CYCLES: u64 = 20_000_000;

/// The C programs and images of this repository that run on the chip by themselves.
fn programs() -> Vec<PathBuf> {
    let home = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folders = [
        "tests/programs",
        "translator/benches/programs",
        "../tests/programs",
        "../firmware/boards/atmega328p/images",
    ];
    let mut files = Vec::new();
    for folder in folders {
        let entries = std::fs::read_dir(home.join(folder)).expect("a folder of this repository");
        let before = files.len();
        files.extend(entries.map(|entry| entry.expect("an entry of a folder").path()));
        files.retain(|file| {
            file.extension()
                .is_some_and(|end| end == "c" || end == "elf")
        });
        assert!(files.len() > before, "no programs in {folder}");
    }
    files
}

fn machine(file: &Path) -> Machine {
    let elf = match file.extension().is_some_and(|end| end == "c") {
        true => compile_file(file),
        false => file.to_owned(),
    };
    let image = Image::read(&elf, &ATMEGA328P).expect("a good ELF file");
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    machine
}

/// Vector and registers of the naked handlers that change something on purpose.
fn known_damage(file: &Path) -> &'static [(&'static str, u32)] {
    match file.file_stem().and_then(|stem| stem.to_str()) {
        // Uses r25, which its main program leaves to it.
        Some("probes") => &[("USART_UDRE", 1 << 25)],
        Some("spoiled") => &[("TIMER0_OVF", 1 << 2)],
        _ => &[],
    }
}

#[test]
fn no_handler_of_a_compiled_program_is_reported() {
    let mut checked = Vec::new();
    for file in programs() {
        for is_connected in [false, true] {
            let mut machine = machine(&file);
            if is_connected {
                let mut bench = Bench {
                    volts: Some(|cycle: u64, _: AnalogInput| (cycle % 4999) as f64 / 1000.0),
                    ..Bench::default()
                };
                bench.serial_in.extend((0..200u8).map(|byte| SerialByte {
                    start_cycle: u64::from(byte) * 50_000,
                    byte,
                    ninth: false,
                }));
                machine.run(&mut bench, CYCLES);
            } else {
                machine.run(&mut Unconnected, CYCLES);
            }
            let damage = machine.interrupt_damage().iter();
            let found: Vec<_> = damage
                .map(|damage| (damage.name, damage.registers_ever))
                .collect();
            assert_eq!(found, known_damage(&file), "{}", file.display());
            let vectors = machine.statistics().vectors;
            checked.push(vectors.iter().map(|vector| vector.returns).sum::<u64>());
        }
    }
    // The test is about something: programs with and without interrupts were among them.
    checked.sort_unstable();
    assert_eq!(checked.first(), Some(&0));
    assert!(checked.last() > Some(&10_000), "{checked:?}");
}
