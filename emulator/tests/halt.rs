//! A jump to itself with interrupts disabled: the end of a run, or time that passes.

mod common;

use cardan_emulator::{Machine, Pin, Stop};
use common::{Bench, program};

/// Fast PWM on OC1A, 64 of 256 cycles high, and two bytes to send; then nothing more to do.
fn machine(name: &str) -> Machine {
    program(
        name,
        "start: set DDRB, 2
         set OCR1AL, 63
         set TCCR1A, 0x81
         set UCSR0B, 8
         set UDR0, 1
         set UDR0, 2
         set TCCR1B, 0x09
      1: rjmp 1b",
    )
}

#[test]
fn peripherals_go_on_at_a_halt_that_does_not_end_the_run() {
    let mut machine = machine("halt_pwm");
    machine.set_end_at_halt(false);
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 1_000_000), Stop::Limit);
    // The loop's two cycles may carry the last jump over the limit.
    assert!((1_000_000..=1_000_001).contains(&machine.cycle()));
    let edges = bench.edges_of(Pin::b(1));
    let rises: Vec<u64> = edges
        .iter()
        .filter(|edge| edge.1)
        .map(|edge| edge.0)
        .collect();
    assert!(
        rises.len().abs_diff(1_000_000 / 256) <= 1,
        "{}",
        rises.len()
    );
    assert!(rises.windows(2).all(|pair| pair[1] - pair[0] == 256));
    let high = edges.windows(2).filter(|pair| pair[0].1);
    assert!(high.clone().all(|pair| pair[1].0 - pair[0].0 == 64));
    let sent: Vec<u8> = bench.sent.iter().map(|sent| sent.1).collect();
    assert_eq!(sent, [1, 2]);
    assert!(
        machine.statistics().instructions > 400_000,
        "each jump counts"
    );
}

#[test]
fn small_steps_through_a_halt_give_the_same_as_one() {
    let (mut whole, mut steps) = (machine("halt_whole"), machine("halt_steps"));
    let (mut one, mut other) = (Bench::default(), Bench::default());
    for machine in [&mut whole, &mut steps] {
        machine.set_end_at_halt(false);
    }
    whole.run(&mut one, 30_000);
    while steps.cycle() < 30_000 {
        let until = (steps.cycle() + 77).min(30_000);
        steps.run(&mut other, until);
    }
    assert_eq!(whole.cycle(), steps.cycle());
    assert_eq!(one.edges, other.edges);
    assert_eq!(one.sent, other.sent);
}

#[test]
fn without_that_the_run_ends_at_the_first_arrival() {
    let mut machine = machine("halt_end");
    assert_eq!(machine.run(&mut Bench::default(), 1_000_000), Stop::Halt);
    assert!(machine.cycle() < 30, "{}", machine.cycle());
    // It may be told later to go on.
    machine.set_end_at_halt(false);
    assert_eq!(machine.run(&mut Bench::default(), 5_000), Stop::Limit);
}
