//! The debugger's server, packet by packet, without a debugger; and the law that whatever a
//! debugger does while the program runs changes no cycle and no bit of it.

use cardan_emulator::{
    ATMEGA328P, Debugger, Environment, Machine, SerialByte, State, Stop, Unconnected,
};
use proptest::prelude::*;

/// No limit.
const ENDLESS: u64 = u64::MAX;

fn packet(body: &str) -> Vec<u8> {
    let sum = body.bytes().fold(0u8, |sum, byte| sum.wrapping_add(byte));
    format!("${body}#{sum:02x}").into_bytes()
}

/// The body of the last packet in what the server says.
fn reply(said: &[u8]) -> String {
    let text = String::from_utf8_lossy(said).into_owned();
    let body = text.rsplit('$').next().unwrap_or_default();
    body.split('#').next().unwrap_or_default().to_owned()
}

fn debugger<E: Environment>(words: &[u16], env: E) -> Debugger<E> {
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.write_flash(0, words);
    Debugger::new(machine, env).expect("it starts")
}

/// Sends a request and returns the reply; a running chip runs until it halts.
fn ask<E: Environment>(debugger: &mut Debugger<E>, body: &str) -> String {
    debugger.receive(&packet(body)).expect("a session");
    for _ in 0..1000 {
        if debugger.state() != State::Running {
            break;
        }
        let until = debugger.machine().cycle() + 10_000;
        debugger.run(until, ENDLESS).expect("a session");
    }
    reply(&debugger.take_output())
}

/// `ldi r16, 5`; `sts 0x0100, r16`; `inc r16`; `push r16`; `pop r17`; `sbi PORTB, 0`; `rjmp .-2`.
const PROGRAM: [u16; 8] = [
    0xE005, 0x9300, 0x0100, 0x9503, 0x930F, 0x911F, 0x9A28, 0xCFFF,
];

#[test]
fn registers_have_the_layout_of_avr_gdb() {
    let mut debugger = debugger(&PROGRAM, Unconnected);
    assert_eq!(ask(&mut debugger, "s"), "S05");
    let all = ask(&mut debugger, "g");
    assert_eq!(all.len(), 2 * 39);
    assert_eq!(&all[32..34], "05", "r16");
    assert_eq!(&all[64..66], "00", "SREG");
    assert_eq!(&all[66..70], "ff08", "SP");
    assert_eq!(&all[70..78], "02000000", "PC");
    assert_eq!(ask(&mut debugger, "p22"), "02000000");
    assert_eq!(ask(&mut debugger, "P11=2a"), "OK");
    assert_eq!(ask(&mut debugger, "m800011,1"), "2a");
    let changed = all.replacen("05", "77", 1);
    assert_eq!(ask(&mut debugger, &format!("G{changed}")), "OK");
    assert_eq!(debugger.machine().registers()[16], 0x77);
}

#[test]
fn breakpoints_halt_before_and_watchpoints_after_the_instruction() {
    let mut debugger = debugger(&PROGRAM, Unconnected);
    assert_eq!(ask(&mut debugger, "Z0,6,2"), "OK");
    assert!(ask(&mut debugger, "c").contains("swbreak:;"));
    assert_eq!(
        (debugger.machine().pc(), debugger.machine().cycle()),
        (6, 3)
    );
    // The byte that PUSH stores and POP loads.
    assert_eq!(ask(&mut debugger, "Z2,8008ff,1"), "OK");
    assert!(ask(&mut debugger, "c").contains("watch:8008ff;"));
    assert_eq!(debugger.machine().pc(), 10);
    assert_eq!(ask(&mut debugger, "z2,8008ff,1"), "OK");
    assert_eq!(ask(&mut debugger, "Z3,8008ff,1"), "OK");
    assert!(ask(&mut debugger, "c").contains("rwatch:8008ff;"));
    assert_eq!(debugger.machine().pc(), 12);
    // PORTB, which SBI reads and writes.
    assert_eq!(ask(&mut debugger, "Z4,800025,1"), "OK");
    assert!(ask(&mut debugger, "c").contains("awatch:800025;"));
    assert_eq!(ask(&mut debugger, "m800025,1"), "01");
    // The end, twice.
    assert_eq!(ask(&mut debugger, "c"), "S0f");
    assert_eq!(ask(&mut debugger, "c"), "S0f");
    // Registers, SP and SREG are watched by stepping, so they are refused.
    for place in ["800010", "80005d", "80005f", "800900", "100"] {
        assert_eq!(
            ask(&mut debugger, &format!("Z2,{place},1")),
            "E16",
            "{place}"
        );
    }
    assert_eq!(ask(&mut debugger, "Z0,8000,2"), "E16");
}

#[test]
fn memories_lie_where_the_tool_chain_puts_them() {
    let mut debugger = debugger(&PROGRAM, Unconnected);
    assert_eq!(ask(&mut debugger, "m0,6"), "05e000930001");
    assert_eq!(ask(&mut debugger, "m1,2"), "e000");
    assert_eq!(ask(&mut debugger, "m7fff,1"), "ff");
    assert_eq!(ask(&mut debugger, "m8000,1"), "E0e");
    // A breakpoint shows nowhere, and flash may be written below it.
    assert_eq!(ask(&mut debugger, "Z0,0,2"), "OK");
    assert_eq!(ask(&mut debugger, "M0,3:0ae000"), "OK");
    assert_eq!(ask(&mut debugger, "m0,4"), "0ae00093");
    assert_eq!(ask(&mut debugger, "z0,0,2"), "OK");
    assert_eq!(ask(&mut debugger, "s"), "S05");
    assert_eq!(debugger.machine().registers()[16], 0x0A);
    assert_eq!(ask(&mut debugger, "M810003,1:5c"), "OK");
    assert_eq!(ask(&mut debugger, "m810002,2"), "ff5c");
    assert_eq!(ask(&mut debugger, "m8103ff,1"), "ff");
    assert_eq!(ask(&mut debugger, "m810400,1"), "E0e");
    assert_eq!(ask(&mut debugger, "M8008ff,1:11"), "OK");
    assert_eq!(ask(&mut debugger, "m8008ff,1"), "11");
    assert_eq!(ask(&mut debugger, "M800900,1:11"), "E0e");
    // DDRB, PORTB and, as the pin follows, PINB.
    assert_eq!(ask(&mut debugger, "M800024,2:f00f"), "OK");
    assert_eq!(ask(&mut debugger, "s"), "S05");
    assert_eq!(ask(&mut debugger, "m800023,3"), "0ff00f");
}

/// Sends one byte to the chip.
struct OneByte(Option<u8>);

impl Environment for OneByte {
    fn uart_rx(&mut self, cycle: u64) -> Option<SerialByte> {
        self.0.take().map(|byte| SerialByte {
            start_cycle: cycle + 1000,
            byte,
            ninth: false,
        })
    }
}

#[test]
fn looking_at_a_register_changes_nothing() {
    // ldi r16, 0x10; sts UCSR0B, r16; lds r17, UCSR0A; sbrs r17, 7; rjmp .-8; lds r18, UDR0; rjmp .-2
    let words = [
        0xE100, 0x9300, 0x00C1, 0x9110, 0x00C0, 0xFF17, 0xCFFC, 0x9120, 0x00C6, 0xCFFF,
    ];
    let mut debugger = debugger(&words, OneByte(Some(0x5A)));
    assert_eq!(ask(&mut debugger, "Z0,e,2"), "OK");
    assert!(ask(&mut debugger, "c").contains("swbreak"));
    for _ in 0..3 {
        assert_eq!(ask(&mut debugger, "m8000c0,1"), "a0", "UCSR0A: RXC, UDRE");
        assert_eq!(ask(&mut debugger, "m8000c6,1"), "5a", "UDR0");
        // Registers that the chip does not have read 0 and are not reported.
        assert_eq!(ask(&mut debugger, "m8000c3,1"), "00");
    }
    assert_eq!(ask(&mut debugger, "s"), "S05");
    assert_eq!(debugger.machine().registers()[18], 0x5A);
    assert_eq!(ask(&mut debugger, "m8000c0,1"), "20");
    assert_eq!(debugger.machine().reports(), []);
}

#[test]
fn damaged_and_unknown_packets_do_not_end_the_session() {
    let mut debugger = debugger(&PROGRAM, Unconnected);
    debugger.receive(b"$g#00").expect("a session");
    assert_eq!(debugger.take_output(), b"-");
    assert_eq!(ask(&mut debugger, "p0"), "00");
    debugger.receive(b"-").expect("a session");
    assert_eq!(reply(&debugger.take_output()), "00");
    for odd in [
        "", "q", "mxyz,2", "m0", "Zq,1,1", "vCont;", "vCont;x", "X", "Hx", "z9,0,0",
    ] {
        let answer = ask(&mut debugger, odd);
        assert!(
            answer.is_empty() || answer.starts_with('E'),
            "{odd}: {answer}"
        );
        assert_eq!(ask(&mut debugger, "m0,2"), "05e0", "after {odd}");
    }
}

#[test]
fn an_interrupt_halts_an_endless_program_and_detaching_lets_it_go() {
    // nop; rjmp .-4
    let mut debugger = debugger(&[0x0000, 0xCFFE], Unconnected);
    debugger.receive(&packet("c")).expect("a session");
    debugger.run(1_000, ENDLESS).expect("a session");
    assert_eq!(debugger.state(), State::Running);
    debugger.receive(b"\x03").expect("a session");
    assert_eq!(reply(&debugger.take_output()), "S02");
    assert_eq!(debugger.state(), State::Halted);
    assert_eq!(ask(&mut debugger, "D"), "OK");
    assert_eq!(debugger.state(), State::Detached);
    let (mut machine, mut env, end) = debugger.into_parts();
    assert_eq!(end, None);
    assert_eq!(machine.run(&mut env, 5_000), Stop::Limit);
}

#[test]
fn the_cycle_limit_and_a_crash_are_signals_and_kill_ends_the_session() {
    let mut endless = debugger(&[0x0000, 0xCFFE], Unconnected);
    endless.receive(&packet("c")).expect("a session");
    endless.run(500, 100).expect("a session");
    assert_eq!(reply(&endless.take_output()), "S18");
    let mut invalid = debugger(&[0x0000, 0x0001], Unconnected);
    assert_eq!(ask(&mut invalid, "c"), "S04");
    invalid.receive(&packet("k")).expect("a session");
    assert_eq!(invalid.state(), State::Killed);
    assert!(matches!(invalid.into_parts().2, Some(Stop::Crash(_))));
}

#[test]
fn after_break_the_program_may_go_on() {
    // ldi r16, 1; break; ldi r16, 2; rjmp .-2
    let mut debugger = debugger(&[0xE001, 0x9598, 0xE002, 0xCFFF], Unconnected);
    assert_eq!(ask(&mut debugger, "c"), "S05");
    assert_eq!(debugger.machine().pc(), 4);
    assert_eq!(ask(&mut debugger, "c"), "S0f");
    assert_eq!(debugger.machine().registers()[16], 2);
}

/// What a debugger does to a running program.
#[derive(Clone, Debug)]
enum Action {
    Step,
    Continue {
        slice: u64,
    },
    Leave {
        start: u16,
        length: u16,
    },
    Breakpoint {
        word: u16,
        is_set: bool,
    },
    Watch {
        address: u16,
        bytes: u16,
        kind: u8,
        is_set: bool,
    },
    Look,
}

/// Words of the random body: from here on, behind the vectors and the start.
const BODY: u16 = 64;
const LENGTH: u16 = 48;

fn action() -> impl Strategy<Value = Action> {
    let word = || BODY..BODY + LENGTH + 2;
    prop_oneof![
        3 => Just(Action::Step),
        4 => (1u64..400).prop_map(|slice| Action::Continue { slice }),
        2 => (word(), 1u16..12).prop_map(|(start, length)| Action::Leave { start, length }),
        2 => (word(), any::<bool>()).prop_map(|(word, is_set)| Action::Breakpoint { word, is_set }),
        1 => (prop_oneof![0x100u16..0x110, 0x8E0u16..0x900, Just(0x46u16), Just(0x3E)],
              1u16..4, 2u8..5, any::<bool>())
            .prop_map(|(address, bytes, kind, is_set)| Action::Watch { address, bytes, kind, is_set }),
        1 => Just(Action::Look),
    ]
}

/// An instruction of the body; jumps stay within it.
fn instruction() -> impl Strategy<Value = Vec<u16>> {
    let register = 0u16..32;
    let one = |word: u16| Just(vec![word]);
    prop_oneof![
        // Pairs that are fused, skips, branches.
        4 => (prop::sample::select(vec![0x0C00u16, 0x1C00, 0x0800, 0x1400, 0x0400, 0x2400, 0x2C00,
              0x9C00, 0x1000]), register.clone(), register.clone())
            .prop_map(|(code, d, r)| vec![code | d << 4 | r & 15 | (r & 16) << 5]),
        2 => (prop::sample::select(vec![0x3000u16, 0x4000, 0x5000, 0xE000]), 0u16..8, any::<u8>())
            .prop_map(|(code, d, k)| vec![code | d << 4 | u16::from(k & 15) | u16::from(k >> 4) << 8]),
        1 => (prop::sample::select(vec![0x9503u16, 0x940A, 0x9407, 0x920F, 0x900F]), 0u16..16)
            .prop_map(|(code, d)| vec![code | d << 4]),
        1 => (0u16..16, 0x100u16..0x110).prop_map(|(d, k)| vec![0x9200 | d << 4, k]),
        1 => (0u16..16, 0x100u16..0x110).prop_map(|(d, k)| vec![0x9000 | d << 4, k]),
        1 => (prop::sample::select(vec![0xFC00u16, 0xFE00]), register, 0u16..8)
            .prop_map(|(code, d, bit)| vec![code | d << 4 | bit]),
        1 => (prop::sample::select(vec![0xF000u16, 0xF400]), 0u16..8, 1u16..6)
            .prop_map(|(code, flag, offset)| vec![code | offset << 3 | flag]),
        // CALL of the routine before the body; SEI, CLI; timer and strobe.
        1 => Just(vec![0x940E, BODY - 2]),
        1 => one(0x9478),
        1 => one(0x94F8),
        1 => (0u16..16).prop_map(|d| vec![0xB406 | 0x0020 | d << 4]),
        1 => (0u16..16).prop_map(|d| vec![0xBA0E | d << 4]),
        1 => one(0x9588),
    ]
}

/// A program: vectors that return, a start that sets Timer0 to interrupt every 64 cycles, a
/// subroutine, a random body, and around again.
fn program(body: &[Vec<u16>]) -> Vec<u16> {
    let mut words = vec![0x9518; usize::from(BODY)];
    words[0] = 0xC033; // rjmp to word 52
    let setup = [
        0xE30F, // ldi r16, 63
        0xBD07, // out OCR0A, r16
        0xE002, // ldi r16, 2 (CTC; OCIE0A)
        0xBD04, // out TCCR0A, r16
        0x9300, // sts TIMSK0, r16
        0x006E, //
        0xE001, // ldi r16, 1
        0xBD05, // out TCCR0B, r16
        0xBF03, // out SMCR, r16
        0xC002, // rjmp to the body
        0x9508, // word 62, the subroutine: ret
        0x9508,
    ];
    words[52..].copy_from_slice(&setup);
    words.extend(body.iter().flatten().take(usize::from(LENGTH)));
    words.resize(usize::from(BODY + LENGTH), 0);
    // Branches reach a few words beyond the end, and a skip may step over the first jump.
    let end = BODY + LENGTH;
    for from in end + 8..end + 10 {
        words.resize(usize::from(from), 0);
        words.push(0xC000 | (BODY.wrapping_sub(from + 1) & 0xFFF));
    }
    words
}

fn carry_out(debugger: &mut Debugger<Unconnected>, action: &Action, limit: u64) {
    let send = |debugger: &mut Debugger<Unconnected>, body: String| {
        debugger.receive(&packet(&body)).expect("a session");
    };
    let slice = match action {
        Action::Step => {
            send(debugger, "s".to_owned());
            64
        }
        Action::Continue { slice } => {
            send(debugger, "c".to_owned());
            *slice
        }
        Action::Leave { start, length } => {
            let (start, end) = (start * 2, (start + length) * 2);
            send(debugger, format!("vCont;r{start:x},{end:x}:1"));
            200
        }
        Action::Breakpoint { word, is_set } => {
            let verb = if *is_set { 'Z' } else { 'z' };
            return send(debugger, format!("{verb}0,{:x},2", word * 2));
        }
        Action::Watch {
            address,
            bytes,
            kind,
            is_set,
        } => {
            let verb = if *is_set { 'Z' } else { 'z' };
            return send(debugger, format!("{verb}{kind},80{address:04x},{bytes:x}"));
        }
        Action::Look => {
            send(debugger, "g".to_owned());
            return send(debugger, "m800020,e0".to_owned());
        }
    };
    let until = debugger.machine().cycle() + slice;
    debugger.run(until, limit).expect("a session");
    // Whether it has halted or not: the client gets impatient.
    if debugger.state() == State::Running {
        debugger.receive(b"\x03").expect("a session");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn a_debugged_run_is_the_run_without_a_debugger(
        body in prop::collection::vec(instruction(), 8..40),
        actions in prop::collection::vec(action(), 1..120),
    ) {
        const LIMIT: u64 = 20_000;
        let words = program(&body);
        let mut plain = Machine::new(&ATMEGA328P, 16_000_000);
        plain.write_flash(0, &words);
        let mut debugger = Debugger::new(plain.clone(), Unconnected).expect("it starts");
        let plain_stop = plain.run(&mut Unconnected, LIMIT);
        for action in &actions {
            carry_out(&mut debugger, action, LIMIT);
        }
        let (mut debugged, mut env, end) = debugger.into_parts();
        let stop = end.unwrap_or_else(|| debugged.run(&mut env, LIMIT));
        prop_assert_eq!(&stop, &plain_stop);
        prop_assert_eq!(debugged.cycle(), plain.cycle());
        if stop == Stop::Limit {
            // What lies ahead is the same as well: schedule, flags, delays.
            debugged.run(&mut Unconnected, 2 * LIMIT);
            plain.run(&mut Unconnected, 2 * LIMIT);
            prop_assert!(debugged == plain, "the machines differ after the run");
        }
        prop_assert_eq!(debugged.statistics(), plain.statistics());
        prop_assert_eq!(debugged.data(), plain.data());
        prop_assert_eq!(
            (debugged.pc(), debugged.sp(), debugged.sreg()),
            (plain.pc(), plain.sp(), plain.sreg())
        );
    }
}
