//! The watchdog by its configuration table and the description of WDTCSR (data sheet, section
//! "Watchdog Timer"): every row, with the interrupt taken and not taken.

mod common;

use cardan_emulator::{Fuses, Machine, ResetCause, Stop};
use common::{Bench, program};

/// The shortest time-out: 2048 cycles of 128 kHz, at 16 MHz.
const TIME_OUT: u64 = 256_000;
/// Cycles that a program needs around it.
const SLACK: u64 = 100;
/// Marks of the programs below.
const INTERRUPT: u8 = 0x77;

/// Writes `value` to WDTCSR in the timed sequence, then waits in a loop of two instructions with
/// interrupts enabled or not. The handler marks itself. After a reset the program ends.
fn configured(name: &str, value: u8, is_enabled: bool, wait: &str) -> Machine {
    let enable = if is_enabled { "sei" } else { "cli" };
    program(
        name,
        &format!(
            "vector 6, isr
             start: in r20, _SFR_IO_ADDR(MCUSR)
             sbrc r20, 3
             rjmp 2f
             ldi r18, 0x18
             ldi r19, {value}
             sts WDTCSR, r18
             sts WDTCSR, r19
             mark 1
             {enable}
          1: {wait}
             rjmp 1b
          2: break
          isr: mark {INTERRUPT}
             lds r21, WDTCSR
             reti"
        ),
    )
}

/// Time-outs after the configuration at which the interrupt was executed, and at which the chip was
/// reset, within a bit more than `time_outs` of them.
fn outcome(machine: &mut Machine, time_outs: u64) -> (Vec<u64>, Option<u64>) {
    let mut bench = Bench::default();
    machine.run(&mut bench, (time_outs + 1) * TIME_OUT - TIME_OUT / 2);
    let begin = bench.marks()[0];
    let in_time_outs = |at: u64| {
        let count = (at - begin + TIME_OUT / 2) / TIME_OUT;
        let late = (at - begin).abs_diff(count * TIME_OUT);
        assert!(late < SLACK, "{late} cycles beside a time-out");
        count
    };
    let marks = bench.strobes.iter().filter(|strobe| strobe.1 == INTERRUPT);
    let interrupts = marks.map(|strobe| in_time_outs(strobe.0)).collect();
    assert!(
        bench
            .resets
            .iter()
            .all(|reset| reset.1 == ResetCause::Watchdog)
    );
    (
        interrupts,
        bench.resets.first().map(|reset| in_time_outs(reset.0)),
    )
}

const ALWAYS_ON: Fuses = Fuses {
    low: 0xFF,
    high: 0xCF,
    extended: 0xFD,
};
const WDE: u8 = 0x08;
const WDIE: u8 = 0x40;

#[test]
fn each_row_of_the_configuration_table_interrupts_or_resets_as_it_says() {
    // WDTON programmed, WDE and WDIE written, I, time-outs with an interrupt, with a reset.
    type Row = (bool, u8, bool, &'static [u64], Option<u64>);
    let rows: [Row; 12] = [
        (false, 0, true, &[], None),
        (false, 0, false, &[], None),
        (false, WDIE, true, &[1, 2, 3], None),
        (false, WDIE, false, &[], None),
        (false, WDE, true, &[], Some(1)),
        (false, WDE, false, &[], Some(1)),
        (false, WDE | WDIE, true, &[1], Some(2)),
        (false, WDE | WDIE, false, &[], Some(2)),
        (true, 0, true, &[], Some(1)),
        (true, WDIE, true, &[], Some(1)),
        (true, WDE, true, &[], Some(1)),
        (true, WDE | WDIE, true, &[], Some(1)),
    ];
    for (row, (is_always_on, value, is_enabled, interrupts, reset)) in rows.into_iter().enumerate()
    {
        let mut machine = configured(&format!("wdt_row_{row}"), value, is_enabled, "nop");
        if is_always_on {
            machine.set_fuses(ALWAYS_ON);
        }
        let found = outcome(&mut machine, 3);
        assert_eq!(found, (interrupts.to_vec(), reset), "row {row}");
    }
}

#[test]
fn a_program_that_waits_for_the_reset_has_not_halted_and_does_not_sleep_for_ever() {
    for (name, wait) in [("jump", "2: rjmp 2b"), ("sleep", "set SMCR, 1\n sleep")] {
        for (mode, value) in [("reset", WDE), ("both", WDE | WDIE)] {
            let mut machine = configured(&format!("wdt_{name}_{mode}"), value, false, wait);
            let expected = if mode == "reset" { 1 } else { 2 };
            assert_eq!(outcome(&mut machine, 3).1, Some(expected), "{name} {mode}");
        }
        // In interrupt mode nothing can come any more.
        let mut machine = configured(&format!("wdt_{name}_deaf"), WDIE, false, wait);
        let stop = if name == "jump" {
            Stop::Halt
        } else {
            Stop::Sleep
        };
        assert_eq!(machine.run(&mut Bench::default(), 10 * TIME_OUT), stop);
    }
}

#[test]
fn the_vector_clears_wdie_and_setting_it_again_keeps_the_interrupt() {
    let mut machine = configured("wdt_once", WDE | WDIE, true, "nop");
    machine.run(&mut Bench::default(), TIME_OUT + TIME_OUT / 2);
    assert_eq!(
        machine.registers()[21] & 0xC8,
        WDE,
        "WDIF and WDIE are clear"
    );
    let mut machine = configured("wdt_interrupt", WDIE, true, "nop");
    machine.run(&mut Bench::default(), TIME_OUT + TIME_OUT / 2);
    assert_eq!(
        machine.registers()[21] & 0xC8,
        WDIE,
        "stays in interrupt mode"
    );
    let again = "lds r22, WDTCSR\n ori r22, 0x40\n sts WDTCSR, r22";
    let mut machine = configured("wdt_again", WDE | WDIE, true, again);
    assert_eq!(outcome(&mut machine, 4), (vec![1, 2, 3, 4], None));
}

#[test]
fn a_flag_that_the_program_clears_is_not_pending_at_the_next_time_out() {
    // WDIF is cleared by writing one; polled, never executed.
    let poll = "lds r22, WDTCSR\n sbrs r22, 7\n rjmp 1b\n inc r23\n sts WDTCSR, r22";
    let mut machine = configured("wdt_polled", WDE | WDIE, false, poll);
    assert_eq!(outcome(&mut machine, 4), (vec![], None));
    assert_eq!(machine.registers()[23], 4);
}

#[test]
fn the_time_out_is_that_of_the_prescaler_bits() {
    for (wdp, bits) in [
        (0, 0x00),
        (1, 0x01),
        (4, 0x04),
        (7, 0x07),
        (8, 0x20),
        (9, 0x21),
    ] {
        let mut machine = configured(&format!("wdt_wdp_{wdp}"), WDE | bits, false, "nop");
        let mut bench = Bench::default();
        machine.run(&mut bench, (TIME_OUT << wdp) + SLACK);
        let reset = bench.resets[0].0 - bench.marks()[0];
        assert!(
            reset.abs_diff(TIME_OUT << wdp) < SLACK,
            "WDP {wdp}: {reset}"
        );
    }
}

#[test]
fn wde_and_the_prescaler_change_only_in_the_timed_sequence() {
    // What is written after WDE was set, and WDTCSR behind it.
    let cases: [(&str, &str, u8); 6] = [
        ("alone", "sts WDTCSR, r1", WDE),
        ("sequence", "sts WDTCSR, r18\n sts WDTCSR, r1", 0),
        ("late", "sts WDTCSR, r18\n nops 3\n sts WDTCSR, r1", WDE),
        ("in_time", "sts WDTCSR, r18\n nops 2\n sts WDTCSR, r1", 0),
        (
            "with_wdce",
            "sts WDTCSR, r18\n sts WDTCSR, r19\n nops 4",
            WDE,
        ),
        ("prescaler", "sts WDTCSR, r20", WDE),
    ];
    for (name, writes, expected) in cases {
        let source = format!(
            "start: clr r1
             ldi r18, 0x18
             ldi r19, 0x10
             ldi r20, 0x0f
             ldi r21, 0x08
             sts WDTCSR, r21
             {writes}
             nops 4
             lds r22, WDTCSR
             break"
        );
        let mut machine = program(&format!("wdt_timed_{name}"), &source);
        assert_eq!(machine.run(&mut Bench::default(), 1000), Stop::Break);
        assert_eq!(machine.registers()[22], expected, "{name}");
    }
}

#[test]
fn wdrf_and_the_fuse_hold_wde() {
    // After the reset by the watchdog WDE stays until WDRF is cleared; its time-out is the shortest.
    let source = "start: clr r1
         ldi r18, 0x18
         in r20, _SFR_IO_ADDR(MCUSR)
         sbrs r20, 3
         rjmp 1f
         sts WDTCSR, r18
         sts WDTCSR, r1
         lds r21, WDTCSR
         out _SFR_IO_ADDR(MCUSR), r1
         lds r22, WDTCSR
         sts WDTCSR, r18
         sts WDTCSR, r1
         lds r23, WDTCSR
         break
      1: ldi r19, 0x0f
         sts WDTCSR, r18
         sts WDTCSR, r19
      2: rjmp 2b";
    for (name, fuses, after) in [("wdt_wdrf", None, 0), ("wdt_wdton", Some(ALWAYS_ON), WDE)] {
        let mut machine = program(name, source);
        if let Some(fuses) = fuses {
            machine.set_fuses(fuses);
        }
        assert_eq!(
            machine.run(&mut Bench::default(), 400 * TIME_OUT),
            Stop::Break
        );
        assert_eq!(machine.registers()[20] & 8, 8, "{name}");
        assert_eq!(machine.registers()[21..=23], [WDE, WDE, after], "{name}");
    }
}
