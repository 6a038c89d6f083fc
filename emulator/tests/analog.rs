//! The converter and the comparator by the data sheet (sections 23 and 24).

mod common;

use cardan_emulator::{AnalogInput, Pin, Stop, Supply};
use common::{Bench, program};

/// A voltage that tells the cycle: 1 mV per 16 cycles.
fn ramp(cycle: u64, _input: AnalogInput) -> f64 {
    (cycle / 16) as f64 * 1e-3
}

#[test]
fn a_conversion_starts_at_the_next_adc_clock_and_holds_after_one_and_a_half() {
    // ADC clock /16: rising edges 8 + 16 k cycles after ADEN; 13.5 and 25 clocks the first time.
    let mut machine = program(
        "adc_single",
        "start: set ADMUX, 0x43
         set ADCSRA, 0x84
         nops 37
         set ADCSRA, 0xC4
      1: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 1b
         set ADCSRA, 0xD4
      2: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 2b
         cli
      3: rjmp 3b",
    );
    let mut bench = Bench {
        volts: Some(ramp),
        ..Bench::default()
    };
    assert_eq!(machine.run(&mut bench, 100_000), Stop::Halt);
    let [first, second] = bench.conversions[..] else {
        panic!("{:?}", bench.conversions)
    };
    // jmp 3, ldi+sts 3, ldi+sts 3: ADEN takes effect at cycle 9.
    assert_eq!((first.start_cycle - 9) % 16, 8);
    assert!(first.start_cycle > first.trigger_cycle);
    assert!(first.start_cycle <= first.trigger_cycle + 16);
    assert_eq!(first.hold_cycle, first.start_cycle + 27 * 8);
    assert_eq!(first.done_cycle, first.start_cycle + 25 * 16);
    assert_eq!((second.start_cycle - 9) % 16, 8);
    assert_eq!(second.hold_cycle, second.start_cycle + 24);
    assert_eq!(second.done_cycle, second.start_cycle + 13 * 16);
    let asked: Vec<u64> = bench.asked.iter().map(|ask| ask.0).collect();
    assert_eq!(asked, [first.hold_cycle, second.hold_cycle]);
    assert_eq!(bench.asked[0].1, AnalogInput::Pin(3));
}

#[test]
fn a_timer_trigger_holds_two_adc_clocks_and_three_cycles_after_the_flag() {
    // Timer1 CTC, period 2000, compare B at 500: OCF1B sets 501 cycles after each clear.
    let mut machine = program(
        "adc_trigger",
        "start: set ADMUX, 0x40
         set ADCSRB, 5
         set ADCSRA, 0xA3
         set16 OCR1AL, 1999
         set16 OCR1BL, 500
         set TCCR1B, 0x09
         mark 1
         ldi r20, 4
      1: lds r18, TIFR1
         sbrs r18, 2
         rjmp 1b
         set TIFR1, 4
         dec r20
         brne 1b
         mark 2
         cli
      2: rjmp 2b",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 100_000), Stop::Halt);
    let conversions = &bench.conversions;
    // mark takes effect 2 cycles after TCCR1B: the timer counts from two cycles before.
    let timer_start = bench.marks()[0] - 2;
    assert!(conversions.len() >= 3);
    for (i, conversion) in conversions.iter().enumerate() {
        let trigger = timer_start + 501 + 2000 * i as u64;
        assert_eq!(conversion.trigger_cycle, trigger);
        let (hold, done) = if i == 0 {
            (8 * 14, 8 * 51 / 2)
        } else {
            (8 * 2, 8 * 27 / 2)
        };
        assert_eq!(conversion.hold_cycle, trigger + 3 + hold, "conversion {i}");
        assert_eq!(conversion.done_cycle, trigger + 3 + done, "conversion {i}");
    }
}

#[test]
fn a_flag_that_is_not_cleared_triggers_only_once_and_a_busy_converter_ignores_triggers() {
    let source = |clear: &str| {
        format!(
            "start: set ADCSRB, 3
             set ADCSRA, 0xA4
             set OCR0A, 99
             set TCCR0A, 2
             set TCCR0B, 1
             ldi r20, 200
          1: lds r18, TIFR0
             sbrs r18, 1
             rjmp 1b
             {clear}
             dec r20
             brne 1b
             cli
          2: rjmp 2b"
        )
    };
    let mut bench = Bench::default();
    program("adc_once", &source("nop")).run(&mut bench, 5000);
    assert_eq!((bench.conversions.len(), bench.ignored.len()), (1, 0));
    let mut bench = Bench::default();
    program("adc_busy", &source("set TIFR0, 2")).run(&mut bench, 5000);
    assert!(bench.ignored.len() > 20, "{:?}", bench.ignored);
    assert_eq!(bench.ignored[1] - bench.ignored[0], 100);
}

#[test]
fn free_running_has_a_period_of_exactly_13_adc_clocks() {
    let mut machine = program("adc_free", "start: set ADCSRA, 0xE5\n 1: rjmp 1b\n");
    machine.set_sreg(0x80);
    let mut bench = Bench::default();
    machine.run(&mut bench, 30_000);
    let holds: Vec<u64> = bench.conversions.iter().map(|c| c.hold_cycle).collect();
    assert!(holds.len() > 50);
    assert!(
        holds[1..]
            .windows(2)
            .all(|pair| pair[1] - pair[0] == 13 * 32),
        "{holds:?}"
    );
    // The first one took 25 clocks and sampled 13.5 after its start.
    assert_eq!(holds[1] - holds[0], (25 * 2 - 27 + 3) * 16);
}

#[test]
fn the_multiplexer_is_locked_from_the_start_of_a_conversion() {
    let mut machine = program(
        "adc_mux",
        "start: set ADMUX, 0x41
         set ADCSRA, 0xC2
         nops 6
         set ADMUX, 0x42
      1: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 1b
         set ADCSRA, 0xC2
      2: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 2b
         cli
      3: rjmp 3b",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
    let inputs: Vec<AnalogInput> = bench.conversions.iter().map(|c| c.input).collect();
    assert_eq!(inputs, [AnalogInput::Pin(1), AnalogInput::Pin(2)]);
}

#[test]
fn reading_adcl_locks_the_result_until_adch_is_read() {
    let mut machine = program(
        "adc_lock",
        "start: set ADMUX, 0x40
         set ADCSRA, 0xC1
      1: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 1b
         lds r20, ADCL
         set ADCSRA, 0xC1
      2: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 2b
         lds r21, ADCH
         set ADCSRA, 0xC1
      3: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 3b
         set ADCSRA, 0xC1
      4: lds r18, ADCSRA
         sbrc r18, 6
         rjmp 4b
         cli
      5: rjmp 5b",
    );
    let volts = |cycle: u64, _| if cycle < 70 { 1.0 } else { 4.0 };
    let mut bench = Bench {
        volts: Some(volts),
        ..Bench::default()
    };
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
    let fates: Vec<_> = bench
        .conversions
        .iter()
        .map(|c| (c.discarded, c.overwrote_unread))
        .collect();
    assert_eq!(
        fates,
        [(false, false), (true, false), (false, false), (false, true)]
    );
    // 1 V of 5 V is code 204; the bytes read belong to one result.
    assert_eq!((machine.registers()[20], machine.registers()[21]), (204, 0));
    assert_eq!(machine.statistics().conversions_lost, 2);
}

#[test]
fn the_code_is_floor_of_1024_v_over_vref_and_the_references_are_selected() {
    let run = |admux: u8, volts: fn(u64, AnalogInput) -> f64| {
        let source = format!(
            "start: set ADMUX, {admux}\n set ADCSRA, 0xC0\n 1: lds r18, ADCSRA\n sbrc r18, 6\n
             rjmp 1b\n lds r20, ADCL\n lds r21, ADCH\n cli\n 2: rjmp 2b"
        );
        let mut machine = program(&format!("adc_code_{admux}"), &source);
        machine.set_supply(Supply {
            avcc_volts: 4.0,
            aref_volts: 2.0,
            bandgap_volts: 1.1,
        });
        let mut bench = Bench {
            volts: Some(volts),
            ..Bench::default()
        };
        assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
        u16::from_le_bytes([machine.registers()[20], machine.registers()[21]])
    };
    assert_eq!(run(0x40, |_, _| 1.0), 256);
    assert_eq!(run(0x41, |_, _| 1.0 - 1e-9), 255);
    assert_eq!(run(0x02, |_, _| 1.0), 512);
    assert_eq!(run(0x03, |_, _| 2.0), 1023, "clipped");
    assert_eq!(run(0x04, |_, _| -1.0), 0);
    assert_eq!(run(0x4E, |_, _| 9.0), 281, "bandgap 1.1 V of 4 V");
    assert_eq!(run(0x4F, |_, _| 9.0), 0, "ground");
    assert_eq!(
        run(0xC8, |_, input| f64::from(
            input == AnalogInput::Temperature
        ) * 0.55),
        512
    );
    assert_eq!(run(0x60, |_, _| 1.0), 256 << 6, "left adjusted");
}

#[test]
fn noise_reduction_sleep_starts_a_conversion_and_wakes_with_its_end() {
    let mut machine = program(
        "adc_sleep",
        "vector 21, isr
         start: set ADCSRA, 0x8C
         set SMCR, 3
         sei
         sleep
         mark 2
         cli
      1: rjmp 1b
      isr: mark 1
         reti",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
    let done = bench.conversions[0].done_cycle;
    // Wake-up 4, entry 4, JMP 3, LDI 1, OUT 1.
    assert_eq!(bench.marks()[0], done + 4 + 4 + 3 + 2);
}

#[test]
fn the_comparator_flags_edges_triggers_the_converter_and_captures() {
    let mut bench = Bench {
        inputs: vec![(1000, Pin::b(7), true), (2000, Pin::b(7), false)],
        volts: Some(|cycle, input| match input {
            AnalogInput::Ain0 if (1000..2000).contains(&cycle) => 3.0,
            AnalogInput::Ain1 => 2.0,
            _ => 1.0,
        }),
        ..Bench::default()
    };
    let mut machine = program(
        "comparator",
        "start: set TCCR1B, 0x41
         set ACSR, 0x07
         set ADCSRB, 1
         set ADCSRA, 0xA2
      1: lds r18, ACSR
         sbrs r18, 4
         rjmp 1b
         mark 1
         lds r20, ICR1L
         lds r21, ICR1H
         lds r22, TIFR1
         cli
      2: rjmp 2b",
    );
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
    assert!(
        (1000..1012).contains(&bench.marks()[0]),
        "{:?}",
        bench.marks()
    );
    let captured = u16::from_le_bytes([machine.registers()[20], machine.registers()[21]]);
    // Timer1 counts from cycle 6 on.
    assert_eq!(captured, 1000 - 6);
    assert_eq!(machine.registers()[22] & 0x20, 0x20);
    machine.run(&mut bench, 10_000);
    assert_eq!(
        machine.statistics().conversions,
        0,
        "halted before the conversion's end"
    );
}
