//! Data-sheet timing probes: a C program measures itself with Timer1, as on a board.

mod common;

use std::ops::RangeInclusive;

use cardan_emulator::{ATMEGA328P, Image, Machine, Stop, Unconnected};

/// Index in `result`, what is measured, and what the data sheet says. A range is given where the
/// program's own polling loop adds up to its length.
const PROBES: &[(usize, &str, RangeInclusive<u16>)] = &[
    (0, "NOP", 1..=1),
    (1, "SBI", 2..=2),
    (2, "CBI", 2..=2),
    (3, "RCALL, RET, RJMP", 9..=9),
    (4, "LDI, MUL", 3..=3),
    (5, "SBIC skipping LDS", 3..=3),
    (6, "LPM", 3..=3),
    (7, "CPSE skipping one word", 2..=2),
    (8, "PUSH, POP", 4..=4),
    (9, "ADIW", 2..=2),
    (10, "CALL, RET, RJMP", 10..=10),
    (11, "LDI, LDI, IJMP", 4..=4),
    (12, "interrupt entry 4, JMP 3, RETI 4", 11..=11),
    (13, "flag set first, enabled later: interrupts", 1..=1),
    (14, "SEI, CLI: interrupts", 0..=0),
    (15, "SEI, two instructions: interrupts", 1..=1),
    (16, "extra latency when waking from Idle", 4..=4),
    (17, "SLEEP without SE", 1..=1),
    (18, "level interrupt UDRE: ISRs run", 10..=10),
    (19, "compare match after TCNT = OCR was written", 0..=0),
    (20, "TCNT kept over a change of CS", 48..=49),
    (21, "ticks while TSM holds the prescaler", 0..=0),
    (
        22,
        "cycles to the first tick at /64, prescaler 10 old",
        40..=60,
    ),
    (23, "OCR takes effect before BOTTOM in fast PWM", 0..=0),
    (24, "phase-correct period, 8 bit", 500..=520),
    (25, "TCCR2B = 1, NOP, TCNT2 (silicon)", 2..=2),
    (26, "TCCR2B = 1, TCCR2B = 0, TCNT2 (silicon)", 2..=2),
    (27, "TCNT0 = 0, IN TCNT0 (silicon)", 0..=0),
    (28, "PIN directly after the port write", 0..=0),
    (29, "PIN one instruction later", 1..=1),
    (30, "PORTB after SBI PINB, 0", 2..=2),
    (31, "EEPROM erase and write, microseconds", 3400..=3408),
    (32, "EEPROM byte written", 0x5A..=0x5A),
    (33, "UDRE after the first byte", 0..=80),
    (34, "one 8N1 frame at UBRR 16, U2X", 1352..=1368),
    (35, "two frames until TXC", 2720..=2760),
    (36, "UDRE after writing TXC", 1..=1),
    (37, "TXC after writing TXC", 0..=0),
    (38, "first conversion at /128", 3200..=3344),
    (39, "conversion at /128", 1664..=1808),
    (40, "conversion at /16", 208..=240),
    (41, "ADIF after writing one", 0..=0),
    (42, "free-running period at /128", 1648..=1680),
    (
        43,
        "period of conversions triggered by Timer0 compare A",
        3952..=3984,
    ),
];

#[test]
fn the_chip_measures_itself_as_the_data_sheet_says() {
    let source = include_str!("programs/probes.c");
    let elf = common::compile("probes", "c", source, &["-Os", "-std=gnu99"]);
    let image = Image::read(&elf, &ATMEGA328P).expect("avr-gcc writes a good ELF file");
    let symbol = image
        .symbol("result")
        .expect("the program has `result`")
        .address as usize;
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    assert_eq!(
        machine.run(&mut Unconnected, 10_000_000),
        Stop::Halt,
        "at {:#x}",
        machine.pc()
    );
    let result = |i: usize| {
        let at = symbol + 2 * i;
        u16::from_le_bytes([machine.data()[at], machine.data()[at + 1]])
    };
    for (i, what, _) in PROBES {
        println!("{i:2} {:5} {what}", result(*i));
    }
    let wrong: Vec<String> = PROBES
        .iter()
        .filter(|(i, _, expected)| !expected.contains(&result(*i)))
        .map(|(i, what, expected)| format!("{what}: {} instead of {expected:?}", result(*i)))
        .collect();
    assert!(
        wrong.is_empty(),
        "{} of {} probes:\n{}",
        wrong.len(),
        PROBES.len(),
        wrong.join("\n")
    );
}
