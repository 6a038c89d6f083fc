//! USART, SPI and TWI by the data sheet (sections 18, 19, 21).

mod common;

use cardan_emulator::{Environment, Pin, SerialByte, Stop};
use common::{Bench, program};

fn byte(start_cycle: u64, byte: u8) -> SerialByte {
    SerialByte {
        start_cycle,
        byte,
        ninth: false,
    }
}

#[test]
fn frames_have_start_data_parity_and_stop_bits() {
    // UCSR0C, U2X, expected bits per frame and cycles per bit at UBRR = 3.
    for (name, control, status, bits, bit) in [
        ("8n1", 0x06, 0x02, 10, 32),
        ("8n1_slow", 0x06, 0x00, 10, 64),
        ("8e2", 0x2E, 0x02, 12, 32),
        ("5n1", 0x00, 0x02, 7, 32),
        ("7o1", 0x34, 0x02, 10, 32),
    ] {
        let source = format!(
            "start: set UBRR0L, 3
             set UCSR0A, {status}
             set UCSR0C, {control}
             set UCSR0B, 8
             set UDR0, 0x55
          1: lds r18, UCSR0A
             sbrs r18, 5
             rjmp 1b
             set UDR0, 0x33
          2: lds r18, UCSR0A
             sbrs r18, 5
             rjmp 2b
             set UDR0, 0x0F
          3: rjmp 3b"
        );
        let mut bench = Bench::default();
        let mut machine = program(&format!("usart_{name}"), &source);
        assert_eq!(machine.run(&mut bench, 20_000), Stop::Halt);
        let ends: Vec<u64> = bench.sent.iter().map(|sent| sent.0).collect();
        let gaps: Vec<u64> = ends.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let all = gaps.iter().all(|&gap| gap == bits * bit);
        // Two bytes fit back to back: one in the shift register, one in the buffer.
        assert!(all && gaps.len() == 2, "{name}: {ends:?}");
        let mask = [0x1F, 0x3F, 0x7F, 0xFF][control >> 1 & 3];
        let sent: Vec<u8> = bench.sent.iter().map(|sent| sent.1).collect();
        assert_eq!(sent, [0x55, 0x33, 0x0F].map(|byte| byte & mask), "{name}");
    }
}

#[test]
fn the_transmitter_takes_two_bytes_at_once_and_ignores_a_third() {
    let mut machine = program(
        "usart_double",
        "start: set UBRR0L, 0
         set UCSR0B, 8
         set UDR0, 1
         set UDR0, 2
         set UDR0, 3
      1: rjmp 1b",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
    let bytes: Vec<u8> = bench.sent.iter().map(|sent| sent.1).collect();
    assert_eq!(bytes, [1, 2]);
    // The halt is reported at its first arrival, long before the bytes have left.
    assert!(
        machine.cycle() < 25 && bench.sent[1].0 > 320,
        "{}",
        machine.cycle()
    );
}

#[test]
fn txc_waits_for_the_buffer_and_is_cleared_by_its_vector() {
    let mut machine = program(
        "usart_txc",
        "vector 20, isr
         start: set UBRR0L, 1
         set UCSR0B, 0x48
         sei
         set UDR0, 1
         set UDR0, 2
      1: rjmp 1b
      isr: mark 1
         lds r20, UCSR0A
         reti",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 5_000), Stop::Limit);
    assert_eq!(bench.marks().len(), 1);
    let latency = bench.marks()[0] - bench.sent[1].0;
    // Entry 4, JMP 3, LDI, OUT 2, and at most one cycle of the loop's RJMP.
    assert!((9..=10).contains(&latency), "{latency}");
    assert_eq!(
        machine.registers()[20] & 0x60,
        0x20,
        "TXC cleared, UDRE set"
    );
}

#[test]
fn received_bytes_come_at_the_middle_of_the_stop_bit() {
    let mut machine = program(
        "usart_rx",
        "vector 18, isr
         start: set UBRR0L, 1
         set UCSR0B, 0x90
         sei
      1: rjmp 1b
      isr: lds r20, UDR0
         out 0x1e, r20
         reti",
    );
    let mut bench = Bench::default();
    // The third one lies in the past: it follows the second directly.
    bench
        .serial_in
        .extend([byte(1000, 0x41), byte(3000, 0x42), byte(3001, 0x43)]);
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Limit);
    let values: Vec<u8> = bench.strobes.iter().map(|strobe| strobe.1).collect();
    assert_eq!(values, [0x41, 0x42, 0x43]);
    let bit = 32;
    let times = bench.marks();
    // Entry 4, JMP 3, LDS 2, OUT 1, and up to one cycle of RJMP.
    let latency = times[0] - (1000 + 9 * bit + bit / 2);
    assert!((10..=11).contains(&latency), "{latency}");
    assert!((times[2] - times[1]).abs_diff(10 * bit) <= 1);
}

#[test]
fn the_fifo_holds_two_and_a_third_waits_until_a_fourth_overruns_it() {
    let mut machine = program(
        "usart_overrun",
        "start: set UBRR0L, 0
         set UCSR0B, 0x10
         ldi r24, 250
      1: nops 10
         dec r24
         brne 1b
         lds r18, UCSR0A
         lds r19, UDR0
         lds r20, UDR0
         lds r21, UCSR0A
         lds r22, UDR0
         lds r23, UCSR0A
         cli
      2: rjmp 2b",
    );
    let mut bench = Bench::default();
    bench.serial_in.extend((1..=4).map(|n| byte(100, n)));
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
    let registers = machine.registers();
    assert_eq!(registers[18] & 0x88, 0x88, "data, and overrun");
    assert_eq!(&registers[19..=20], [1, 2]);
    assert_eq!(
        registers[21] & 0x88,
        0x80,
        "the last frame took the shift register"
    );
    assert_eq!(registers[22], 4);
    assert_eq!(registers[23] & 0x80, 0);
}

#[test]
fn nine_bit_frames_carry_the_ninth_bit() {
    let mut machine = program(
        "usart_nine",
        "start: set UBRR0L, 0
         set UCSR0B, 0x14
      1: lds r18, UCSR0A
         sbrs r18, 7
         rjmp 1b
         lds r19, UCSR0B
         lds r20, UDR0
         cli
      2: rjmp 2b",
    );
    let mut bench = Bench::default();
    bench.serial_in.push_back(SerialByte {
        start_cycle: 50,
        byte: 0x7E,
        ninth: true,
    });
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
    assert_eq!(
        (machine.registers()[19] & 2, machine.registers()[20]),
        (2, 0x7E)
    );
}

#[test]
fn the_spi_master_clocks_sixteen_edges_and_exchanges_a_byte() {
    // SCK = clk / 4, mode 0, most significant bit first.
    let mut machine = program(
        "spi",
        "vector 17, isr
         start: set DDRB, 0x2C
         set SPCR, 0xD0
         sei
         mark 1
         set SPDR, 0xB1
         set SPDR, 0x00
      1: rjmp 1b
      isr: mark 2
         lds r20, SPDR
         lds r21, SPSR
         cli
      2: rjmp 2b",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 10_000), Stop::Halt);
    let begin = bench.spi[0].0;
    assert_eq!(bench.spi, [(begin, 0xB1)], "the second write collides");
    let clock = bench.edges_of(Pin::b(5));
    let expected: Vec<(u64, bool)> = (0..16).map(|i| (begin + 2 + 2 * i, i % 2 == 0)).collect();
    assert_eq!(clock, expected);
    let data = bench.edges_of(Pin::b(3));
    // 1011 0001 from the top: changes at bits 7, 6, 5, 3, 0.
    let at: Vec<u64> = data.iter().map(|edge| edge.0 - begin).collect();
    assert_eq!(at, [0, 4, 8, 16, 28]);
    assert_eq!(machine.registers()[20], !0xB1);
    assert_eq!(
        machine.registers()[21] & 0xC0,
        0x40,
        "WCOL; the vector cleared SPIF"
    );
    let latency = bench.marks()[1] - (begin + 32);
    assert!((9..=10).contains(&latency), "{latency}");
}

#[test]
fn the_twi_master_writes_and_reads_with_the_status_codes_of_the_data_sheet() {
    // TWBR = 12: SCL period 16 + 2 * 12 = 40 cycles.
    let mut machine = program(
        "twi",
        ".macro op value
            set TWCR, \\value
         9: lds r18, TWCR
            sbrs r18, 7
            rjmp 9b
            lds r18, TWSR
            out 0x1e, r18
         .endm
         start: set TWBR, 12
         op 0xA4
         set TWDR, 0xA0
         op 0x84
         set TWDR, 0x12
         op 0x84
         op 0xA4
         set TWDR, 0xA1
         op 0x84
         op 0xC4
         op 0x84
         lds r20, TWDR
         set TWCR, 0x94
      1: lds r18, TWCR
         sbrc r18, 4
         rjmp 1b
         op 0xA4
         set TWDR, 0x30
         op 0x84
         cli
      2: rjmp 2b",
    );
    let mut bench = Bench::default();
    assert_eq!(machine.run(&mut bench, 20_000), Stop::Halt);
    let status: Vec<u8> = bench.strobes.iter().map(|strobe| strobe.1).collect();
    assert_eq!(
        status,
        [0x08, 0x18, 0x28, 0x10, 0x40, 0x50, 0x58, 0x08, 0x20]
    );
    let expected = [
        "start",
        "address a0",
        "write 12",
        "start",
        "address a1",
        "read true",
        "read false",
        "stop",
        "start",
        "address 30",
    ];
    assert_eq!(bench.twi, expected);
    assert_eq!(machine.registers()[20], 0xA5);
    let byte_time = bench.marks()[2] - bench.marks()[1];
    assert!(
        (360..385).contains(&byte_time),
        "nine periods of 40: {byte_time}"
    );
}

/// Wants to see the bits on TXD.
#[derive(Default)]
struct Oscilloscope(Vec<(u64, bool)>);

impl Environment for Oscilloscope {
    const SERIAL_EDGES: bool = true;

    fn pin_edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        assert_eq!(pin, Pin::d(1));
        self.0.push((cycle, level));
    }
}

#[test]
fn the_bits_on_txd_are_start_data_parity_and_stop() {
    // 0x35 with odd parity: start 0, data 1 0 1 0 1 1 0 0, parity 1, stop 1; 16 cycles per bit.
    let mut machine = program(
        "usart_bits",
        "start: set UCSR0C, 0x36
         set UCSR0B, 8
         set UDR0, 0x35
      1: rjmp 1b",
    );
    let mut scope = Oscilloscope::default();
    assert_eq!(machine.run(&mut scope, 1_000), Stop::Halt);
    // The pin goes high when the transmitter is enabled; the start bit is the first low.
    let start = scope.0[1].0;
    let edges: Vec<(u64, bool)> = scope.0[1..]
        .iter()
        .map(|e| ((e.0 - start) / 16, e.1))
        .collect();
    let expected = [
        (0, false),
        (1, true),
        (2, false),
        (3, true),
        (4, false),
        (5, true),
        (7, false),
        (9, true),
    ];
    assert_eq!(edges, expected);
}
