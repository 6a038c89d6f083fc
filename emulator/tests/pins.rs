//! What comes in and goes out through pins: external interrupts, capture, clock inputs, compare
//! outputs, levels read back.

mod common;

use cardan_emulator::{AnalogInput, Conversion, Environment, Pin, Stop};
use common::{Bench, program};

#[test]
fn int0_counts_the_selected_edges_and_a_low_level_repeats() {
    for (sense, expected) in [(1, 4), (2, 2), (3, 2)] {
        let source = format!(
            "vector 1, isr
             start: set EICRA, {sense}
             set EIMSK, 1
             sei
          1: rjmp 1b
          isr: mark 1
             reti"
        );
        let d2 = Pin::d(2);
        let inputs = vec![
            (0, d2, false),
            (100, d2, true),
            (200, d2, false),
            (300, d2, true),
            (400, d2, false),
        ];
        let mut bench = Bench {
            inputs,
            ..Bench::default()
        };
        program(&format!("int0_{sense}"), &source).run(&mut bench, 1000);
        assert_eq!(bench.marks().len(), expected, "sense {sense}");
        // Synchroniser 3, entry 4, JMP 3, LDI, OUT 2; up to one cycle of RJMP.
        let first = if sense == 2 { 200 } else { 100 };
        assert!(
            (12..=13).contains(&(bench.marks()[0] - first)),
            "{:?}",
            bench.marks()
        );
    }
    let mut bench = Bench {
        inputs: vec![(0, Pin::d(2), true), (100, Pin::d(2), false)],
        ..Bench::default()
    };
    let mut machine = program(
        "int0_level",
        "vector 1, isr
         start: set EIMSK, 1
         sei
      1: inc r20
         rjmp 1b
      isr: mark 1
         reti",
    );
    machine.run(&mut bench, 500);
    // Entry 4 + JMP 3 + LDI 1 + OUT 1 + RETI 4, and one instruction of 1 or 2 cycles.
    let marks = bench.marks();
    assert!(marks.len() > (500 - 100) / 15 - 2, "{marks:?}");
    assert!(
        marks
            .windows(2)
            .all(|pair| (14..=15).contains(&(pair[1] - pair[0]))),
        "{marks:?}"
    );
}

#[test]
fn a_pin_change_interrupt_sees_inputs_and_the_chips_own_outputs() {
    let mut machine = program(
        "pcint",
        "vector 3, isr
         vector 5, isr2
         start: set PCMSK0, 0x03
         set PCMSK2, 0x10
         set PCICR, 0x05
         set DDRB, 0x02
         sei
         sbi _SFR_IO_ADDR(PINB), 1
      1: rjmp 1b
      isr: mark 1
         reti
      isr2: mark 2
         reti",
    );
    let inputs = vec![
        (0, Pin::b(0), false),
        (200, Pin::b(0), true),
        (300, Pin::d(4), true),
    ];
    let mut bench = Bench {
        inputs,
        ..Bench::default()
    };
    machine.run(&mut bench, 1000);
    let values: Vec<u8> = bench.strobes.iter().map(|strobe| strobe.1).collect();
    assert_eq!(values, [1, 1, 2]);
}

#[test]
fn input_capture_takes_the_count_of_the_edge_and_the_noise_canceler_adds_four() {
    for (control, delay, glitch) in [(0x41, 3, false), (0xC1, 7, false), (0xC1, 7, true)] {
        let source = format!(
            "start: set TCCR1B, {control}
             mark 1
          1: in r18, _SFR_IO_ADDR(TIFR1)
             sbrs r18, 5
             rjmp 1b
             lds r20, ICR1L
             lds r21, ICR1H
             cli
          2: rjmp 2b"
        );
        let mut inputs = vec![(0, Pin::b(0), false), (500, Pin::b(0), true)];
        if glitch {
            // Three cycles long: rejected.
            inputs = vec![
                (300, Pin::b(0), true),
                (303, Pin::b(0), false),
                (500, Pin::b(0), true),
            ];
        }
        let mut bench = Bench {
            inputs,
            ..Bench::default()
        };
        let mut machine = program(&format!("capture_{control}"), &source);
        assert_eq!(machine.run(&mut bench, 2000), Stop::Halt);
        let start = bench.marks()[0] - 2;
        let captured = u16::from_le_bytes([machine.registers()[20], machine.registers()[21]]);
        assert_eq!(u64::from(captured), 500 + delay - start);
    }
}

#[test]
fn timer0_counts_edges_of_its_clock_pin() {
    let inputs: Vec<(u64, Pin, bool)> = (0..40)
        .map(|i| (100 + 10 * i, Pin::d(4), i % 2 == 0))
        .collect();
    let mut bench = Bench {
        inputs,
        ..Bench::default()
    };
    let mut machine = program(
        "t0_pin",
        "vector 16, isr
         start: set TCNT0, 250
         set TCCR0B, 7
         set TIMSK0, 1
         sei
      1: rjmp 1b
      isr: mark 1
         reti",
    );
    machine.run(&mut bench, 1000);
    // Rising edges at 100 + 20 k; the sixth wraps 255 to 0, three cycles after it.
    assert!(
        (bench.marks()[0] - (100 + 5 * 20 + 3)).abs_diff(9) <= 1,
        "{:?}",
        bench.marks()
    );
    assert_eq!(bench.marks().len(), 1);
}

#[test]
fn compare_outputs_drive_their_pins_at_the_true_cycle() {
    let mut machine = program(
        "oc",
        "start: set DDRB, 2
         set TCCR1A, 0x40
         set16 OCR1AL, 99
         mark 1
         set TCCR1B, 0x09
      1: rjmp 1b",
    );
    machine.set_sreg(0x80);
    let mut bench = Bench::default();
    machine.run(&mut bench, 1000);
    let start = bench.marks()[0] + 3;
    let edges = bench.edges_of(Pin::b(1));
    let expected: Vec<(u64, bool)> = (0..edges.len() as u64)
        .map(|i| (start + 100 * (i + 1), i % 2 == 0))
        .collect();
    assert_eq!(edges, expected);
    assert_eq!(edges.len(), 9);
}

#[test]
fn pins_read_back_with_pull_ups_toggle_and_disabled_buffers() {
    let mut machine = program(
        "pins",
        "start: set PORTC, 0x03
         nop
         in r20, _SFR_IO_ADDR(PINC)
         set DIDR0, 0x01
         nop
         in r21, _SFR_IO_ADDR(PINC)
         set MCUCR, 0x10
         nop
         in r22, _SFR_IO_ADDR(PINC)
         set PINC, 0x06
         in r23, _SFR_IO_ADDR(PORTC)
         cli
      1: rjmp 1b",
    );
    let mut bench = Bench {
        inputs: vec![(0, Pin::c(4), true)],
        ..Bench::default()
    };
    assert_eq!(machine.run(&mut bench, 1000), Stop::Halt);
    assert_eq!(&machine.registers()[20..=23], [0x13, 0x12, 0x10, 0x05]);
}

/// Writes down in order whatever the chip shows or asks.
#[derive(Default)]
struct Log(Vec<(u64, String)>);

impl Environment for Log {
    fn pin_edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        self.0.push((cycle, format!("{pin} {level}")));
    }
    fn analog(&mut self, cycle: u64, input: AnalogInput) -> f64 {
        self.0.push((cycle, format!("{input:?}")));
        (cycle % 5) as f64
    }
    fn conversion(&mut self, event: Conversion) {
        let text = format!("code {}", event.code);
        self.0.push((event.done_cycle, text));
    }
    fn uart_tx(&mut self, cycle: u64, byte: u8) {
        self.0.push((cycle, format!("byte {byte}")));
    }
    fn strobe(&mut self, cycle: u64, value: u8, _: &[u8]) {
        self.0.push((cycle, format!("strobe {value}")));
    }
}

#[test]
fn a_run_shows_in_the_same_order_what_single_steps_show() {
    // All timers toggle, at periods of their own; a conversion follows each match of OCR1B; the
    // program works, sends, and sleeps. With PCINT1 the chip itself looks at OC1A.
    for (name, pin_change) in [("quiet_outputs", 0), ("watched_outputs", 2)] {
        let source = format!(
            "vector 3, change
             vector 21, converted
             start: set DDRB, 0x0E
             set DDRD, 0x6A
             set PCMSK0, {pin_change}
             set PCICR, 1
             set UCSR0B, 0x08
             set OCR0A, 96
             set OCR0B, 30
             set TCCR0A, 0x52
             set OCR2A, 96
             set OCR2B, 96
             set TCCR2A, 0x52
             set ADMUX, 0x41
             set ADCSRB, 5
             set ADCSRA, 0xAA
             set OCR1AH, 1
             set OCR1AL, 0xF3
             set OCR1BH, 0
             set OCR1BL, 249
             set TCCR1A, 0x50
             set SMCR, 1
             set TCCR0B, 1
             set TCCR1B, 0x09
             set TCCR2B, 1
             sei
          1: sleep
             mark 7
             sts UDR0, r20
             rjmp 1b
          change: inc r21
             reti
          converted: set TIFR1, 4
             lds r20, ADCL
             lds r20, ADCH
             inc r22
             in r23, _SFR_IO_ADDR(PINB)
             reti"
        );
        let machine = program(name, &source);
        let (mut whole, mut steps) = (machine.clone(), machine);
        let (mut shown, mut expected) = (Log::default(), Log::default());
        whole.run(&mut shown, 100_000);
        while steps.cycle() < whole.cycle() {
            steps.step(&mut expected);
        }
        assert_eq!(shown.0, expected.0, "{name}");
        assert!(shown.0.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        for what in [
            "PB1 true",
            "PB3 false",
            "PD6 true",
            "Pin(1)",
            "strobe 7",
            "code ",
            "byte ",
        ] {
            let is_there = shown.0.iter().any(|(_, text)| text.starts_with(what));
            assert!(is_there, "{name}: no {what}");
        }
        // Both go on alike.
        whole.run(&mut shown, 120_000);
        steps.run(&mut expected, 120_000);
        assert_eq!(shown.0, expected.0, "{name}");
        assert_eq!(whole.statistics(), steps.statistics(), "{name}");
        assert_eq!((whole.pc(), whole.data()), (steps.pc(), steps.data()));
    }
}

#[test]
fn a_stop_for_the_sake_of_an_edge_is_heard_though_the_chip_sleeps_for_ever() {
    struct Third(u32);
    impl Environment for Third {
        fn pin_edge(&mut self, _: u64, _: Pin, _: bool) {
            self.0 += 1;
        }
        fn stop_requested(&self) -> bool {
            self.0 >= 3
        }
    }
    let mut machine = program(
        "sleeping_toggle",
        "start: set DDRB, 2
         set OCR1AL, 99
         set TCCR1A, 0x40
         set TCCR1B, 0x09
         set SMCR, 1
         sei
      1: sleep
         rjmp 1b",
    );
    let stop = machine.run(&mut Third(0), u64::MAX);
    assert_eq!(stop, Stop::Requested);
    // The third edge comes after about 300 cycles.
    assert!(machine.cycle() < 5_000, "{}", machine.cycle());
}
