//! The translator against the interpreter: two machines with the same program run side by side,
//! one on each engine, and stop at the same random cycles. There everything about them must be
//! equal (registers, memories, flags, counters, every peripheral, the schedule), and so must all
//! that their environments have seen, with its cycles.

#[path = "../../tests/common/mod.rs"]
mod common;

use std::cell::Cell;
use std::path::Path;

use cardan_emulator::{ATMEGA328P, AnalogInput, Image, Machine, Pin, SerialByte, Stop};
use cardan_translator::{Limits, Translator};
use common::Bench;
use common::random::{self, FLASH_WORDS, RAM_BYTES, RAM_START};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

/// Arrivals after which a place is translated: everything at once, nearly, and while it runs.
const THRESHOLDS: [u32; 4] = [0, 1, 3, 50];

fn translator(threshold: u32) -> Translator {
    let limits = Limits {
        threshold,
        ..Limits::default()
    };
    Translator::with_limits(limits).expect("tests run where the translator works")
}

/// Cases from a fixed seed, so that every run is the same.
fn runner(cases: u32) -> TestRunner {
    TestRunner::new_with_rng(
        ProptestConfig {
            cases,
            failure_persistence: None,
            ..ProptestConfig::default()
        },
        TestRng::deterministic_rng(RngAlgorithm::ChaCha),
    )
}

/// A sequence of pseudo-random numbers (xorshift).
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % limit
    }
}

/// A world with changing voltages, pin levels and serial bytes.
fn world() -> Bench {
    let pin = |name: &str| name.parse::<Pin>().expect("a pin of the chip");
    let inputs = (1..400).map(|i| {
        (
            i * 977,
            pin(["PD2", "PD3", "PB0"][i as usize % 3]),
            i % 2 == 0,
        )
    });
    let serial_in = (1..100u8).map(|i| SerialByte {
        start_cycle: u64::from(i) * 20_011,
        byte: i,
        ninth: false,
    });
    Bench {
        inputs: inputs.collect(),
        serial_in: serial_in.collect(),
        volts: Some(|cycle: u64, _: AnalogInput| (cycle % 4999) as f64 / 1000.0),
        ..Bench::default()
    }
}

/// What an environment has seen.
fn seen(bench: &Bench) -> String {
    format!(
        "{:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}",
        bench.edges,
        bench.asked,
        bench.conversions,
        bench.ignored,
        bench.sent,
        bench.strobes,
        bench.spi,
        bench.twi,
        bench.clocks,
        bench.resets
    )
}

/// Where two machines differ, for people.
fn difference(ours: &Machine, theirs: &Machine) -> String {
    let part = |machine: &Machine| {
        format!(
            "pc {:#06x} sp {:#06x} sreg {:#04x} {:02x?}\n{:?}",
            machine.pc(),
            machine.sp(),
            machine.sreg(),
            machine.registers(),
            machine.statistics()
        )
    };
    let sram = (RAM_START..RAM_START + RAM_BYTES).find(|&i| ours.data()[i] != theirs.data()[i]);
    format!(
        "translator: {}\ninterpreter: {}\nfirst difference in SRAM: {sram:x?}",
        part(ours),
        part(theirs)
    )
}

/// Runs both to the end of `cycles`, or to where the program stops, in steps of up to `stride`.
fn run_both(
    start: &Machine,
    engine: &mut Translator,
    cycles: u64,
    stride: u64,
    seed: u64,
) -> Result<(), TestCaseError> {
    let (mut ours, mut theirs) = (start.clone(), start.clone());
    let (mut our_world, mut their_world) = (world(), world());
    let mut numbers = Numbers(seed | 1);
    let end = start.cycle() + cycles;
    while ours.cycle() < end {
        let until = ours.cycle() + 1 + numbers.below(stride);
        let our_stop = ours.run_with(engine, &mut our_world, until);
        let their_stop = theirs.run(&mut their_world, until);
        if ours != theirs {
            return Err(TestCaseError::fail(difference(&ours, &theirs)));
        }
        prop_assert_eq!(&our_stop, &their_stop);
        if our_stop != Stop::Limit {
            break;
        }
    }
    prop_assert_eq!(seen(&our_world), seen(&their_world));
    Ok(())
}

/// The same for a program with all thresholds, fresh translators and small and large strides.
fn agrees(machine: &Machine, cycles: u64) {
    for (i, threshold) in THRESHOLDS.into_iter().enumerate() {
        let mut engine = translator(threshold);
        for stride in [37, 1000, 100_000] {
            let cycles = if stride < 100 { cycles / 20 } else { cycles };
            let seed = 0x9E37_79B9 + i as u64 * 977 + stride;
            if let Err(error) = run_both(machine, &mut engine, cycles, stride, seed) {
                panic!("threshold {threshold}, stride {stride}: {error}");
            }
        }
        if threshold < 50 {
            assert!(engine.work().entries > 0, "nothing was translated");
        }
    }
}

fn machine_with(image: &Image) -> Machine {
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(image);
    machine
}

#[test]
fn random_programs_leave_the_same_state_on_both_engines() {
    let entries = Cell::new(0);
    let result = runner(1_500).run(
        &(
            random::case(),
            prop::sample::select(THRESHOLDS.to_vec()),
            any::<u64>(),
        ),
        |(case, threshold, seed)| {
            let machine = random::machine(&case);
            // Twice: once while translating, once with what has been translated.
            let mut engine = translator(threshold);
            run_both(&machine, &mut engine, 600, 200, seed)?;
            run_both(&machine, &mut engine, 600, 60, seed ^ 0x5555)?;
            entries.set(entries.get() + engine.work().entries);
            Ok(())
        },
    );
    if let Err(error) = result {
        panic!("{error}");
    }
    assert!(
        entries.get() > 1_500,
        "little was translated: {}",
        entries.get()
    );
}

#[test]
fn programs_from_the_bench_leave_the_same_state_on_both_engines() {
    for name in ["sieve", "cordic", "interrupts", "sleeper"] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("benches/programs")
            .join(format!("{name}.c"));
        let elf = common::compile_file(&file);
        let image = Image::read(&elf, &ATMEGA328P).expect("avr-gcc writes a good ELF file");
        agrees(&machine_with(&image), 200_000);
    }
}

#[test]
fn library_calls_leave_the_same_state_on_both_engines() {
    let source = include_str!("../../tests/programs/library.c");
    agrees(&common::compiled("library", source), 200_000);
}

#[test]
fn the_reference_firmware_leaves_the_same_state_on_both_engines() {
    for name in ["plain", "tapped"] {
        let file = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../firmware/boards/atmega328p/images")
            .join(format!("{name}.elf"));
        let image = Image::read(&file, &ATMEGA328P).expect("the image is in the repository");
        agrees(&machine_with(&image), 400_000);
    }
}

#[test]
fn an_interrupt_comes_at_the_same_cycle_wherever_in_a_loop_it_falls() {
    // A loop with calls, stack, memory and multiplications, interrupted after 1 to 400 cycles by a
    // Timer1 match that is moved by one cycle each time.
    for offset in 1..400 {
        let source = format!(
            "{}
            jmp start
            vector 11, handler
            .org 0x100
            handler:
                push r16
                in r16, 0x3f
                push r16
                lds r16, 0x84
                sts 0x300, r16
                mark 1
                pop r16
                out 0x3f, r16
                pop r16
                reti
            leaf:
                mul r20, r21
                add r22, r0
                adc r23, r1
                ret
            start:
                ldi r28, 0x00
                ldi r29, 0x02
                set16 0x88, {offset}
                set 0x6f, 2
                set 0x81, 9
                sei
            again:
                ldi r24, 7
            1:  ldi r26, 0x00
                ldi r27, 0x04
                st X+, r22
                st X+, r23
                ldd r20, Y+1
                subi r20, 0xfb
                std Y+1, r20
                push r24
                rcall leaf
                pop r24
                lsr r23
                ror r22
                sbrc r22, 3
                sbiw r28, 0
                dec r24
                brne 1b
                rjmp again",
            common::PRELUDE
        );
        let machine = common::assembled("offsets", &source);
        let mut engine = translator(offset % 3);
        if let Err(error) = run_both(&machine, &mut engine, 6_000, 3_000, u64::from(offset)) {
            panic!("offset {offset}: {error}");
        }
        assert!(engine.work().entries > 0, "nothing was translated");
    }
}

#[test]
fn a_program_that_reprograms_itself_executes_its_new_instructions() {
    // From the boot section, rewrites the page of `victim` again and again with another constant,
    // and calls it in between.
    let source = format!(
        "{}
        jmp start
        .org 0x400
        victim:
            ldi r24, 0
            add r20, r24
            ret
        .org 0x7e00
        start:
            ldi r25, 1
        again:
            ldi r18, 60
        1:  call victim
            dec r18
            brne 1b
            sts 0x200, r20
            ldi r30, lo8(victim)
            ldi r31, hi8(victim)
            ldi r16, 3
            rcall operation
            inc r25
            mov r16, r25
            andi r16, 0x0f
            ori r16, 0x80
            mov r0, r16
            ldi r16, 0xe0
            mov r1, r16
            ldi r16, 1
            rcall operation
            subi r30, 0xfe
            ldi r16, 0x48
            mov r0, r16
            ldi r16, 0x0f
            mov r1, r16
            ldi r16, 1
            rcall operation
            subi r30, 0xfe
            ldi r16, 0x08
            mov r0, r16
            ldi r16, 0x95
            mov r1, r16
            ldi r16, 1
            rcall operation
            ldi r30, lo8(victim)
            ldi r16, 5
            rcall operation
            ldi r16, 0x11
            rcall operation
            rjmp again
        operation:
            in r17, 0x37
            sbrc r17, 0
            rjmp operation
            out 0x37, r16
            spm
            ret",
        common::PRELUDE
    );
    let mut machine = common::assembled("reprogram", &source);
    agrees(&machine, 1_000_000);
    // The test is about something: the victim has run with several constants.
    machine.run(&mut world(), 3_000_000);
    assert!(machine.data()[0x200] > 60, "{}", machine.data()[0x200]);
    assert_ne!(machine.flash()[0x200], 0xE080);
}

#[test]
fn program_memory_written_from_outside_is_executed_as_it_is() {
    let words: Vec<u16> = (0..64)
        .map(|i| [0x0F00, 0x1F11, 0x9503, 0x0F20][i % 4])
        .collect();
    let strategy = prop::collection::vec((0usize..60, random::instruction(), 1u64..300), 1..30);
    let entries = Cell::new(0);
    let result = runner(300).run(&strategy, |patches| {
        let mut ours = Machine::new(&ATMEGA328P, 16_000_000);
        ours.write_flash(0, &vec![0xCFFF; FLASH_WORDS]);
        ours.write_flash(0, &words);
        ours.write_flash(64, &[0xCFBF]);
        let mut theirs = ours.clone();
        let mut engine = translator(2);
        for (at, instruction, cycles) in patches {
            let until = ours.cycle() + cycles;
            let our_stop = ours.run_with(&mut engine, &mut world(), until);
            prop_assert_eq!(our_stop, theirs.run(&mut world(), until));
            prop_assert!(ours == theirs, "{}", difference(&ours, &theirs));
            for machine in [&mut ours, &mut theirs] {
                machine.write_flash(at, &instruction);
                machine.set_pc(0);
            }
        }
        entries.set(entries.get() + engine.work().entries);
        Ok(())
    });
    if let Err(error) = result {
        panic!("{error}");
    }
    assert!(
        entries.get() > 300,
        "little was translated: {}",
        entries.get()
    );
}

#[test]
fn one_translator_serves_machines_with_different_programs_in_turn() {
    let loops: Vec<Machine> = [0x9403u16, 0x950A, 0x0F00]
        .into_iter()
        .map(|word| {
            let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
            // r16 (or r16 itself) changes until it is zero, for ever.
            machine.write_flash(0, &[0xE10F, word, 0xF7F1, 0xCFFC]);
            machine
        })
        .collect();
    let mut engine = translator(2);
    for round in 0..20u64 {
        for machine in &loops {
            if let Err(error) = run_both(machine, &mut engine, 500 + round, 90, round) {
                panic!("round {round}: {error}");
            }
        }
    }
    assert!(engine.work().entries > 60, "little was translated");
}

#[test]
fn a_translator_without_room_for_code_interprets() {
    let source = include_str!("../../tests/programs/library.c");
    let machine = common::compiled("no_room", source);
    let limits = Limits {
        threshold: 2,
        code_bytes: 0,
    };
    let mut engine = Translator::with_limits(limits).expect("tests run where the translator works");
    if let Err(error) = run_both(&machine, &mut engine, 100_000, 30_000, 5) {
        panic!("{error}");
    }
    assert_eq!((engine.work().regions, engine.work().entries), (0, 0));
}
