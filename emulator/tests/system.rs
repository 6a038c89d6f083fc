//! Sleep, watchdog, clocks, resets, self-programming, crashes.

mod common;

use cardan_emulator::{Cause, Fuses, Pin, ReportKind, ResetCause, Stop, Unconnected};
use common::{Bench, program};

#[test]
fn the_watchdog_interrupts_then_resets_and_leaves_its_mark_in_mcusr() {
    // 16 ms at 16 MHz: 2048 / 128 kHz = 256000 cycles.
    let mut machine = program(
        "watchdog",
        "vector 6, isr
         start: in r20, _SFR_IO_ADDR(MCUSR)
         out 0x1e, r20
         sbrc r20, 3
         rjmp 2f
         set WDTCSR, 0x18
         set WDTCSR, 0x48
         sei
      1: rjmp 1b
      2: break
      isr: mark 0x77
         reti",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 5_000_000), Stop::Break);
    let values: Vec<u8> = bench.strobes.iter().map(|strobe| strobe.1).collect();
    assert_eq!(values, [0x01, 0x77, 0x09]);
    let times = bench.marks();
    assert!((times[1] - times[0]).abs_diff(256_000) < 40, "{times:?}");
    let (at, cause) = bench.resets[0];
    assert_eq!(cause, ResetCause::Watchdog);
    assert!(at.abs_diff(times[1] + 256_000) < 40);
    // 14 clocks and 65 ms until the program starts again.
    assert!(times[2] - at >= 14 + 1_040_000);
}

#[test]
fn wdr_restarts_the_watchdog_and_a_reset_by_it_is_no_halt() {
    let mut machine = program(
        "wdr",
        "start: in r20, _SFR_IO_ADDR(MCUSR)
         sbrc r20, 3
         break
         set WDTCSR, 0x18
         set WDTCSR, 0x08
         ldi r24, 0
         ldi r25, 0
      1: wdr
         nops 20
         sbiw r24, 1
         brne 1b
         mark 1
         cli
      2: rjmp 2b",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 10_000_000), Stop::Break);
    assert!(bench.marks()[0] > 65_536 * 25, "kept alive by WDR");
    assert!(bench.resets[0].0.abs_diff(bench.marks()[0] + 256_000) < 30);
}

#[test]
fn power_down_wakes_by_pin_change_after_the_crystal_has_started() {
    let mut machine = program(
        "power_down",
        "vector 3, isr
         start: set PCMSK0, 1
         set PCICR, 1
         set TCCR1B, 1
         set SMCR, 5
         sei
         sleep
         lds r20, TCNT1L
         lds r21, TCNT1H
         cli
      1: rjmp 1b
      isr: mark 1
         reti",
    );
    let inputs = vec![(0, Pin::b(0), false), (50_000, Pin::b(0), true)];
    let mut bench = Bench {
        inputs,
        ..Bench::default()
    };
    assert_eq!(machine.run(&mut bench, 1_000_000), Stop::Halt);
    // Synchroniser 3, start-up 16384, halt 4, entry 4, JMP 3, LDI and OUT 2.
    assert_eq!(bench.marks(), [50_000 + 3 + 16_384 + 4 + 4 + 3 + 2]);
    let count = u16::from_le_bytes([machine.registers()[20], machine.registers()[21]]);
    assert!(count < 40, "Timer1 stood still: {count}");
}

#[test]
fn sleep_with_interrupts_disabled_ends_the_run_after_its_own_cycle() {
    let mut machine = program("sleep_end", "start: set SMCR, 1\n mark 1\n sleep\n nop");
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 1000), Stop::Sleep);
    assert_eq!(machine.cycle(), bench.marks()[0] + 1);
}

#[test]
fn the_clock_prescaler_changes_within_its_window_only() {
    let mut machine = program(
        "clkpr",
        "start: set CLKPR, 0x80
         nops 3
         set CLKPR, 3
         set CLKPR, 0x80
         set CLKPR, 2
         lds r20, CLKPR
         cli
      1: rjmp 1b",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 1000), Stop::Halt);
    assert_eq!(machine.registers()[20], 2);
    assert_eq!(machine.frequency_hz(), 4_000_000);
    assert_eq!(bench.clocks.len(), 1);
}

#[test]
fn power_reduction_freezes_a_timer_with_its_state() {
    let mut machine = program(
        "prr",
        "start: set TCCR0B, 1
         set PRR, 0x20
         nops 50
         set PRR, 0
         in r20, _SFR_IO_ADDR(TCNT0)
         cli
      1: rjmp 1b",
    );
    assert_eq!(machine.run(&mut Unconnected, 1000), Stop::Halt);
    // 3 cycles until PRR takes effect, and the IN itself one cycle after it is lifted.
    assert_eq!(machine.registers()[20], 3);
}

#[test]
fn the_eeprom_interrupt_is_a_level_and_programming_takes_3_4_ms() {
    let mut machine = program(
        "ee_ready",
        "vector 22, isr
         start: set EEARL, 7
         set EEDR, 0x3C
         sbi _SFR_IO_ADDR(EECR), 2
         sbi _SFR_IO_ADDR(EECR), 1
         mark 1
         sbi _SFR_IO_ADDR(EECR), 3
         sei
      1: rjmp 1b
      isr: cbi _SFR_IO_ADDR(EECR), 3
         mark 2
         break",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 1_000_000), Stop::Break);
    let marks = bench.marks();
    assert!((marks[1] - marks[0]).abs_diff(54_400) < 16, "{marks:?}");
    assert_eq!(machine.eeprom()[7], 0x3C);
}

#[test]
fn self_programming_works_from_the_boot_section_and_reads_signature_and_fuses() {
    // Boot section of 256 words at 0x7E00; the program writes `ldi r25, 0x5A; ret` at 0x1000.
    let mut machine = program(
        "spm",
        "start: jmp 0x7e00
         .org 0x7e00
         ldi r30, 0x00
         ldi r31, 0x10
         set SPMCSR, 3
         spm
      1: lds r18, SPMCSR
         sbrc r18, 0
         rjmp 1b
         ldi r16, 0x9a
         mov r0, r16
         ldi r16, 0xe5
         mov r1, r16
         set SPMCSR, 1
         spm
         ldi r30, 0x02
         ldi r16, 0x08
         mov r0, r16
         ldi r16, 0x95
         mov r1, r16
         set SPMCSR, 1
         spm
         ldi r30, 0x00
         set SPMCSR, 5
         spm
      2: lds r18, SPMCSR
         sbrc r18, 0
         rjmp 2b
         set SPMCSR, 0x11
         spm
         call 0x1000
         ldi r31, 0
         ldi r30, 4
         set SPMCSR, 0x21
         lpm r20, Z
         ldi r30, 3
         set SPMCSR, 0x09
         lpm r21, Z
         break",
    );
    machine.set_fuses(Fuses {
        low: 0xFF,
        high: 0xDF,
        extended: 0xFD,
    });
    assert_eq!(machine.run(&mut Unconnected, 1_000_000), Stop::Break);
    assert_eq!(machine.registers()[25], 0x5A);
    assert_eq!(
        (machine.registers()[20], machine.registers()[21]),
        (0x0F, 0xDF)
    );
    assert!(
        machine.cycle() > 2 * 72_000,
        "two page operations of 4.5 ms"
    );
}

#[test]
fn fuses_choose_the_reset_address_and_the_clock() {
    let mut machine = program("bootrst", "start: break\n .org 0x7800\n nop\n nop\n break");
    machine.set_fuses(Fuses {
        low: 0x7F,
        high: 0xDA,
        extended: 0xFD,
    });
    assert_eq!((machine.pc(), machine.frequency_hz()), (0x7800, 2_000_000));
    assert_eq!(machine.run(&mut Unconnected, 100), Stop::Break);
    assert_eq!(machine.cycle(), 3);
}

#[test]
fn a_reserved_address_is_reported_once_per_place() {
    let mut machine = program(
        "reserved",
        "start: ldi r20, 3
      1: lds r18, 0x65
         sts 0xEE, r18
         dec r20
         brne 1b
         break",
    );
    assert_eq!(machine.run(&mut Unconnected, 1000), Stop::Break);
    let found: Vec<_> = machine
        .reports()
        .iter()
        .map(|r| (r.address, r.kind))
        .collect();
    assert_eq!(
        found,
        [
            (0x65, ReportKind::ReadReserved),
            (0xEE, ReportKind::WriteReserved)
        ]
    );
}

#[test]
fn each_crash_names_its_cause_and_place() {
    let cases: [(&str, &str, Cause); 8] = [
        ("opcode", ".word 0x0001", Cause::InvalidOpcode { word: 1 }),
        (
            "erased",
            ".word 0xffff",
            Cause::InvalidOpcode { word: 0xFFFF },
        ),
        (
            "stack",
            "ldi r16, 0\n out 0x3e, r16\n ldi r16, 0x80\n out 0x3d, r16\n push r16",
            Cause::StackOutOfMemory { sp: 0x80 },
        ),
        (
            "call",
            "ldi r16, 1\n out 0x3e, r16\n ldi r16, 0\n out 0x3d, r16\n rcall start",
            Cause::StackOutOfMemory { sp: 0x100 },
        ),
        (
            "pc",
            "ldi r31, 0x50\n ijmp",
            Cause::PcOutOfMemory { target: 0xA000 },
        ),
        (
            "load",
            "lds r0, 0x900",
            Cause::BadAddress {
                address: 0x900,
                is_store: false,
            },
        ),
        (
            "store",
            "ldi r31, 0xff\n ldi r30, 2\n st Z, r0",
            Cause::BadAddress {
                address: 0xFF02,
                is_store: true,
            },
        ),
        (
            "async",
            "ldi r16, 0x20\n sts ASSR, r16",
            Cause::NotModelled {
                register: "ASSR",
                what: "the function of this register",
            },
        ),
    ];
    for (name, source, cause) in cases {
        let mut machine = program(&format!("crash_{name}"), &format!("start: {source}"));
        let Stop::Crash(crash) = machine.run(&mut Unconnected, 1000) else {
            panic!("{name}")
        };
        assert_eq!(crash.cause, cause, "{name}");
        assert_eq!(crash.pc, machine.pc());
        assert!(!crash.instruction.is_empty());
        // Running on crashes again at the same place.
        assert!(matches!(
            machine.run(&mut Unconnected, 1000),
            Stop::Crash(_)
        ));
    }
}

#[test]
fn the_program_counter_wraps_at_the_end_of_flash() {
    let mut machine = program("wrap", "start: break");
    machine.write_flash(0x3FFE, &[0x0000, 0x0000]);
    machine.set_pc(0x7FFC);
    assert_eq!(machine.run(&mut Unconnected, 100), Stop::Break);
    // Two NOPs, the JMP at address 0 and BREAK.
    assert_eq!(machine.cycle(), 2 + 3 + 1);
    // A skip over the last word, and a branch across the end.
    machine.write_flash(0x3FFF, &[0xFC00]);
    machine.set_pc(0x7FFE);
    machine.step(&mut Unconnected);
    assert!(machine.pc() <= 6);
}

#[test]
fn a_clone_is_a_snapshot_that_runs_on_alike() {
    let mut machine = program(
        "snapshot",
        "vector 11, isr
         start: set16 OCR1AL, 777
         set TCCR1B, 0x09
         set TIMSK1, 2
         set ADCSRA, 0xE3
         sei
      1: inc r20
         rjmp 1b
      isr: push r20
         pop r21
         reti",
    );
    machine.run(&mut Unconnected, 12_345);
    let mut copy = machine.clone();
    machine.run(&mut Unconnected, 99_999);
    // In many small steps: the result is the same.
    let mut until = copy.cycle();
    while copy.cycle() < 99_999 {
        until += 13;
        copy.run(&mut Unconnected, until.min(99_999));
    }
    assert_eq!(machine.statistics(), copy.statistics());
    assert_eq!((machine.data(), machine.pc()), (copy.data(), copy.pc()));
}

#[test]
fn moving_the_vectors_holds_interrupts_for_four_cycles() {
    // The interrupt pends when IVSEL is set; it is taken in the boot section.
    let mut machine = program(
        "ivsel",
        "vector 16, wrong
         start: set TIMSK0, 1
         set TCNT0, 0xFF
         set TCCR0B, 1
         nops 4
         ldi r20, 1
         ldi r21, 2
         sei
         out _SFR_IO_ADDR(MCUCR), r20
         out _SFR_IO_ADDR(MCUCR), r21
         nops 8
         break
      wrong: mark 1
         reti
         .org 0x7e00 + 4 * 16
         mark 2
         reti",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 1000), Stop::Break);
    assert_eq!(
        bench
            .strobes
            .iter()
            .map(|strobe| strobe.1)
            .collect::<Vec<_>>(),
        [2]
    );
}

#[test]
fn registers_of_a_module_that_is_switched_off_do_not_answer() {
    let mut machine = program(
        "prr_usart",
        "start: set PRR, 0x02
         set UCSR0B, 0x18
         lds r20, UCSR0A
         set PRR, 0
         lds r21, UCSR0B
         break",
    );
    assert_eq!(machine.run(&mut Unconnected, 1000), Stop::Break);
    assert_eq!((machine.registers()[20], machine.registers()[21]), (0, 0));
    assert_eq!(machine.reports().len(), 2);
}
