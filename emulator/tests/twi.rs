//! The two-wire interface as a master by the data sheet: what TWSTA, TWSTO, TWINT and TWWC do in
//! each state, and every status code of the two tables for master modes.

mod common;

use cardan_emulator::{Machine, Stop};
use common::{Bench, program};

/// `op value` writes TWCR and waits for TWINT, then marks the status; `gone` waits until TWSTO is
/// clear. SCL period at TWBR = 12: 16 + 2 * 12 = 40 cycles.
const MACROS: &str = "
.macro poll
 9: lds r18, TWCR
    sbrs r18, 7
    rjmp 9b
    lds r18, TWSR
    out 0x1e, r18
.endm
.macro op value
    set TWCR, \\value
    poll
.endm
.macro gone
 9: lds r18, TWCR
    sbrc r18, 4
    rjmp 9b
.endm
";
/// SCL period in cycles.
const PERIOD: u64 = 40;

/// Runs `source` to its BREAK; returns the machine, status codes with their cycles, and the bus.
fn run(name: &str, source: &str) -> (Machine, Vec<(u64, u8)>, Vec<String>) {
    let source = format!("{MACROS}\n start: set TWBR, 12\n{source}\n break");
    let mut machine = program(&format!("twi_{name}"), &source);
    let mut bench = Bench::default();
    assert_eq!(
        machine.run(&mut bench, 50_000),
        Stop::Break,
        "{name}: {:?}",
        bench.twi
    );
    (machine, bench.strobes, bench.twi)
}

fn codes(strobes: &[(u64, u8)]) -> Vec<u8> {
    strobes.iter().map(|strobe| strobe.1).collect()
}

#[test]
fn a_start_that_is_asked_for_while_the_stop_goes_out_follows_it() {
    let (_, strobes, bus) = run(
        "start_behind_stop",
        "op 0xa4
         set TWDR, 0xa0
         op 0x84
         set TWCR, 0x94
         op 0xa4
         set TWDR, 0xa0
         op 0x84",
    );
    assert_eq!(codes(&strobes), [0x08, 0x18, 0x08, 0x18]);
    assert_eq!(bus, ["start", "address a0", "stop", "start", "address a0"]);
    // One period for STOP and one for START, and up to a round of the polling loop.
    let gap = strobes[2].0 - strobes[1].0;
    assert!((2 * PERIOD..2 * PERIOD + 20).contains(&gap), "{gap}");
}

#[test]
fn stop_and_start_together_give_both_in_every_state_that_has_them() {
    // The last lines of the tables for master transmitter and receiver: 0x08 is no such state.
    let states: [(&str, &str, &[u8]); 6] = [
        ("18", "set TWDR, 0xa0\n op 0x84", &[0x18]),
        ("20", "set TWDR, 0x30\n op 0x84", &[0x20]),
        (
            "28",
            "set TWDR, 0xa0\n op 0x84\n set TWDR, 7\n op 0x84",
            &[0x18, 0x28],
        ),
        ("48", "set TWDR, 0x31\n op 0x84", &[0x48]),
        ("58", "set TWDR, 0xa1\n op 0x84\n op 0x84", &[0x40, 0x58]),
        (
            "50",
            "set TWDR, 0xa1\n op 0x84\n op 0xc4\n op 0x84",
            &[0x40, 0x50, 0x58],
        ),
    ];
    // STOP with START; repeated START; STOP, and START when it is out.
    let exits: [(&str, &str, u8, &[&str]); 3] = [
        ("both", "op 0xb4", 0x08, &["stop", "start"]),
        ("repeated", "op 0xa4", 0x10, &["start"]),
        (
            "stop",
            "set TWCR, 0x94\n gone\n op 0xa4",
            0x08,
            &["stop", "start"],
        ),
    ];
    for (state, to_state, before) in states {
        for (exit, from_state, after, on_bus) in exits {
            let name = format!("{exit}_{state}");
            let (machine, strobes, bus) = run(
                &name,
                &format!("op 0xa4\n{to_state}\n{from_state}\n lds r20, TWCR"),
            );
            let expected = [&[0x08][..], before, &[after]].concat();
            assert_eq!(codes(&strobes), expected, "{name}");
            assert_eq!(bus[bus.len() - on_bus.len()..], *on_bus, "{name}");
            assert_eq!(machine.registers()[20] & 0x10, 0, "{name}: TWSTO is clear");
        }
    }
}

#[test]
fn twint_is_not_set_behind_a_stop_and_the_status_says_nothing() {
    let (machine, strobes, bus) = run(
        "stop",
        "op 0xa4
         set TWDR, 0xa0
         op 0x84
         set TWCR, 0x94
         lds r20, TWCR
         gone
         nops 100
         lds r21, TWCR
         lds r22, TWSR",
    );
    assert_eq!(codes(&strobes), [0x08, 0x18]);
    assert_eq!(bus.last().map(String::as_str), Some("stop"));
    let registers = machine.registers();
    assert_eq!(
        (registers[20] & 0x90, registers[21] & 0x90, registers[22]),
        (0x10, 0, 0xF8)
    );
}

#[test]
fn a_start_on_a_free_bus_needs_no_one_in_twint() {
    // TWINT is clear already; the bit clears it where it is set.
    let (_, strobes, bus) = run(
        "no_twint",
        "op 0x24\n set TWDR, 0xa0\n set TWCR, 0x04\n nops 500\n poll\n op 0x84",
    );
    // Behind the START the bit must be written: without it the bus waits with its first status.
    assert_eq!(codes(&strobes), [0x08, 0x08, 0x18]);
    assert_eq!(bus, ["start", "address a0"]);
}

#[test]
fn a_stop_without_the_bus_sends_nothing_and_is_over_at_once() {
    let (machine, strobes, bus) = run(
        "idle_stop",
        "set TWCR, 0x94
         lds r20, TWCR
         op 0xb4
         set TWCR, 0x94
         gone
         set TWCR, 0x94
         lds r21, TWCR
         nops 200",
    );
    assert_eq!(codes(&strobes), [0x08]);
    assert_eq!(bus, ["start", "stop"]);
    assert_eq!(
        (
            machine.registers()[20] & 0x10,
            machine.registers()[21] & 0x10
        ),
        (0, 0)
    );
}

#[test]
fn twdr_is_writable_while_twint_is_set_and_a_collision_stays_until_then() {
    let (machine, _, bus) = run(
        "collision",
        "set TWDR, 0x11
         lds r20, TWCR
         op 0xa4
         set TWDR, 0xa0
         lds r21, TWCR
         set TWCR, 0x84
         set TWDR, 0x55
         lds r22, TWCR
         poll
         lds r23, TWCR
         set TWDR, 0x66
         lds r24, TWCR
         op 0x84",
    );
    let collided: Vec<bool> = (20..=24)
        .map(|r| machine.registers()[r] & 0x08 != 0)
        .collect();
    assert_eq!(collided, [true, false, true, true, false]);
    assert_eq!(bus, ["start", "address a0", "write 66"]);
}

#[test]
fn switching_off_ends_everything_and_a_start_begins_anew() {
    let (machine, strobes, bus) = run(
        "off",
        "op 0xa4
         set TWDR, 0xa0
         set TWCR, 0x84
         set TWCR, 0
         lds r20, TWSR
         nops 400
         op 0xa4",
    );
    assert_eq!(codes(&strobes), [0x08, 0x08]);
    assert_eq!(bus, ["start", "start"]);
    assert_eq!(machine.registers()[20], 0xF8);
}
