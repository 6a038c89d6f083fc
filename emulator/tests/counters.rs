//! Counters of a run that a bench may judge: edges of pins, sleeps.

mod common;

use cardan_emulator::{Pin, Stop, Unconnected};
use common::{Bench, program};

#[test]
fn edges_are_counted_for_each_pin_as_the_environment_sees_them() {
    // Timer1 drives PB1, Timer2 PD3 (quiet events), the program PC0 and PB0, the SPI SCK and MOSI.
    let mut machine = program(
        "pin_edges",
        "start: set DDRB, 0x2f
         set DDRC, 1
         set DDRD, 0x08
         set TCCR1A, 0x40
         set16 OCR1AL, 99
         set TCCR1B, 0x09
         set TCCR2A, 0x23
         set OCR2B, 20
         set TCCR2B, 1
         set SPCR, 0x50
         set SPDR, 0xa5
         ldi r24, 200
      1: sbi _SFR_IO_ADDR(PINC), 0
         dec r24
         brne 1b
         sbi _SFR_IO_ADDR(PORTB), 0
         nops 50
         break",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 100_000), Stop::Break);
    let statistics = machine.statistics();
    let pins = (0..3).flat_map(|port| (0..8).filter_map(move |bit| Pin::new(port, bit)));
    for pin in pins {
        let seen = bench.edges_of(pin).len() as u64;
        assert_eq!(statistics.edges(pin), seen, "{pin}");
    }
    assert_eq!(statistics.edges(Pin::c(0)), 200);
    assert_eq!(statistics.edges(Pin::b(0)), 1);
    assert_eq!(statistics.edges(Pin::b(5)), 16, "eight periods of SCK");
    assert!(statistics.edges(Pin::b(1)) > 5 && statistics.edges(Pin::d(3)) > 5);
    // An output that never changes, and an input.
    assert_eq!(
        (statistics.edges(Pin::b(2)), statistics.edges(Pin::d(7))),
        (0, 0)
    );
    // Nobody connected: the same.
    let mut alone = program("pin_edges_alone", "start: break");
    alone.write_flash(0, machine.flash());
    alone.run(&mut Unconnected, 100_000);
    assert_eq!(alone.statistics().pin_edges, statistics.pin_edges);
}

#[test]
fn a_sleep_counts_only_where_the_processor_falls_asleep() {
    let mut machine = program(
        "sleeps",
        "vector 16, isr
         start: set TIMSK0, 1
         set TCCR0B, 1
         sei
         sleep
         sleep
         set SMCR, 1
         ldi r24, 5
      1: sleep
         dec r24
         brne 1b
         cli
         sleep
      isr: reti",
    );
    machine.run(&mut Unconnected, 9);
    assert_eq!(machine.statistics().sleeps, 0, "not executed yet");
    assert_eq!(machine.run(&mut Unconnected, 100_000), Stop::Sleep);
    // Two without SE do nothing; five are ended by the timer, the last one never.
    assert_eq!(machine.statistics().sleeps, 6);
    assert!(machine.statistics().sleeping_cycles > 4 * 200);
    assert_eq!(machine.statistics().vectors[16].returns, 5);
}
