//! The transmitter by the data sheet's sections on enabling, disabling and the data register: what
//! happens to bytes written before TXEN, behind its clearing, and while the bit rate changes.

mod common;

use cardan_emulator::{Environment, Pin, ReportKind, Stop};
use common::{Bench, program};

/// Cycles per frame of 8N1 at UBRR = 1: ten bits of 32 cycles.
const FRAME: u64 = 320;

fn run(name: &str, source: &str) -> (cardan_emulator::Machine, Bench) {
    let source = format!("start: set UBRR0L, 1\n{source}\n break");
    let mut machine = program(&format!("usart_{name}"), &source);
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 50_000), Stop::Break);
    (machine, bench)
}

fn bytes(bench: &Bench) -> Vec<u8> {
    bench.sent.iter().map(|sent| sent.1).collect()
}

#[test]
fn a_byte_written_before_txen_waits_in_the_buffer_and_is_the_first_sent() {
    let (machine, bench) = run(
        "before",
        "set UDR0, 0x48
         lds r20, UCSR0A
         set UDR0, 0x77
         nops 200
         set UCSR0B, 8
         mark 1
         nops 4
         lds r21, UCSR0A
         set UDR0, 0x65
         nops 1000",
    );
    assert_eq!(
        bytes(&bench),
        [0x48, 0x65],
        "the second was ignored: UDRE was clear"
    );
    assert_eq!(
        (
            machine.registers()[20] & 0x20,
            machine.registers()[21] & 0x20
        ),
        (0, 0x20)
    );
    // From the write to UCSR0B two cycles before the mark: at most one tick, and the frame.
    let delay = bench.sent[0].0 - (bench.marks()[0] - 2);
    assert!((FRAME..=FRAME + 2).contains(&delay), "{delay}");
    let kinds: Vec<_> = machine.reports().iter().map(|report| report.kind).collect();
    assert_eq!(
        kinds,
        [ReportKind::TransmitterOff; 2],
        "once for each place"
    );
}

#[test]
fn a_byte_that_never_gets_a_transmitter_is_not_sent_and_keeps_no_module_busy() {
    let (machine, bench) = run(
        "never",
        "set UDR0, 0x48\n set PRR, 2\n set PRR, 0\n nops 500\n lds r20, UCSR0A",
    );
    assert_eq!(bytes(&bench), []);
    assert_eq!(machine.registers()[20] & 0x60, 0, "neither UDRE nor TXC");
}

#[test]
fn the_frame_format_is_that_at_the_start_of_the_frame() {
    // Nine bits are kept; the format says how many are sent.
    let (_, bench) = run(
        "format",
        "set UDR0, 0xff\n set UCSR0C, 0\n set UCSR0B, 8\n nops 400",
    );
    assert_eq!(bytes(&bench), [0x1F]);
}

#[test]
fn clearing_txen_takes_effect_when_buffer_and_shift_register_are_empty() {
    let (machine, bench) = run(
        "off",
        "sbi _SFR_IO_ADDR(DDRD), 1
         set UCSR0B, 8
         set UDR0, 1
         nops 40
         set UDR0, 2
         set UCSR0B, 0
         mark 1
         nops 700
         lds r20, UCSR0A
         set UDR0, 3
         lds r21, UCSR0A
         nops 400
         mark 2
         set UCSR0B, 8
         nops 400",
    );
    assert_eq!(bytes(&bench), [1, 2, 3]);
    let [cleared, again] = bench.marks()[..] else {
        panic!("{:?}", bench.strobes)
    };
    assert!(bench.sent[0].0 > cleared && bench.sent[1].0 - bench.sent[0].0 == FRAME);
    assert!(bench.sent[2].0 > again + FRAME, "the third waits for TXEN");
    assert_eq!(
        (
            machine.registers()[20] & 0x60,
            machine.registers()[21] & 0x60
        ),
        (0x60, 0x40)
    );
    // TXD is high while the transmitter has the pin; then PORTD1, which is 0, drives it.
    let levels: Vec<bool> = bench
        .edges_of(Pin::d(1))
        .iter()
        .map(|edge| edge.1)
        .collect();
    assert_eq!(levels, [true, false, true]);
    let released = bench.edges_of(Pin::d(1))[1].0;
    assert_eq!(released, bench.sent[1].0);
}

#[test]
fn txen_cleared_and_set_again_within_a_frame_changes_nothing() {
    let (_, bench) = run(
        "again",
        "set UCSR0B, 8
         set UDR0, 1
         nops 40
         set UCSR0B, 0
         nops 40
         set UCSR0B, 8
         set UDR0, 2
         nops 900",
    );
    assert_eq!(bytes(&bench), [1, 2]);
    assert_eq!(bench.sent[1].0 - bench.sent[0].0, FRAME);
}

/// Wants to see the bits on TXD.
#[derive(Default)]
struct Oscilloscope {
    edges: Vec<(u64, bool)>,
    sent: Vec<u64>,
}

impl Environment for Oscilloscope {
    const SERIAL_EDGES: bool = true;

    fn pin_edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        if pin == Pin::d(1) {
            self.edges.push((cycle, level));
        }
    }

    fn uart_tx(&mut self, cycle: u64, _byte: u8) {
        self.sent.push(cycle);
    }
}

#[test]
fn a_change_of_the_bit_rate_stretches_the_rest_of_the_frame() {
    // 0x55: every bit is an edge. Bits of 32 cycles, then, from within the fourth on, of 64.
    let mut machine = program(
        "usart_rate",
        "start: set UBRR0L, 1
         set UCSR0B, 8
         set UDR0, 0x55
         nops 107
         set UBRR0L, 3
         nops 1000
         break",
    );
    let mut scope = Oscilloscope::default();
    assert_eq!(machine.run(&mut scope, 50_000), Stop::Break);
    let edges: Vec<u64> = scope.edges[1..].iter().map(|edge| edge.0).collect();
    let bits: Vec<u64> = edges.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert_eq!(bits.len(), 9);
    assert!(bits[..3].iter().all(|&bit| bit == 32), "{bits:?}");
    assert!(32 < bits[3] && bits[3] < 64, "{bits:?}");
    assert!(bits[4..].iter().all(|&bit| bit == 64), "{bits:?}");
    // The stop bit has the new length too.
    assert_eq!(scope.sent, [edges[9] + 64]);
}
