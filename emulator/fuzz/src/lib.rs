//! What the fuzz targets do with their bytes. The workspace's tests do the same with every file of
//! the corpus, without libFuzzer (`emulator/tests/corpus.rs`).

use cardan_emulator::{
    ATMEGA328P, AnalogInput, Cause, Crash, Debugger, Environment, Fuses, Image, Machine, Pin,
    SerialByte, State, Stimulus, Stop, Unconnected, disassemble,
};

/// Words of a program, little endian.
fn words(data: &[u8]) -> Vec<u16> {
    let pairs = data.chunks_exact(2);
    pairs
        .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
        .collect()
}

/// Any file is an image within the device's memories, which then runs, or an error that names it.
pub fn loader(data: &[u8]) {
    match Image::parse("fuzzed", data, &ATMEGA328P) {
        Ok(image) => {
            assert!(image.flash.len() <= ATMEGA328P.flash_bytes);
            assert!(image.eeprom.len() <= ATMEGA328P.eeprom_bytes);
            let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
            machine.load(&image);
            machine.run(&mut Unconnected, 2_000);
        }
        Err(error) => assert!(error.to_string().starts_with("fuzzed: ")),
    }
}

/// Any file is a stimulus, whose values may be asked for at any cycle and whose changes come in
/// order, or an error that names it.
pub fn stimulus(data: &[u8]) {
    match Stimulus::parse("fuzzed", data, 16_000_000) {
        Ok(stimulus) => {
            let mut cycle = 0;
            for _ in 0..100 {
                for pin in (0..3).flat_map(|port| (0..8).filter_map(move |bit| Pin::new(port, bit)))
                {
                    stimulus.level(pin, cycle);
                }
                let volts: Vec<f64> = (0..=8)
                    .map(|channel| stimulus.volts(channel, cycle))
                    .collect();
                assert!(volts.iter().all(|volts| volts.is_finite()), "{volts:?}");
                match stimulus.next_change(cycle) {
                    Some(next) => assert!(std::mem::replace(&mut cycle, next) < next),
                    None => break,
                }
            }
        }
        Err(error) => assert!(error.to_string().starts_with("fuzzed: ")),
    }
}

/// Every word: executing and disassembling agree on whether it is an instruction, how long it is
/// shows in the program counter, and nothing costs no cycle.
pub fn decoder(data: &[u8]) {
    let mut words = words(data);
    words.truncate(64);
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.write_flash(0, &words);
    for (index, &word) in words.iter().enumerate() {
        let second = words.get(index + 1).copied().unwrap_or(0xFFFF);
        let text = disassemble(&[word, second]);
        assert_eq!(machine.disassemble_at(2 * index as u32), text);
        machine.set_pc(2 * index as u32);
        machine.set_sp(0x400);
        // LPM, IJMP and the like go somewhere.
        let before = (machine.cycle(), machine.statistics().instructions);
        let stop = machine.run(&mut Unconnected, before.0 + 1);
        let cause = match &stop {
            Stop::Crash(Crash { cause, .. }) => Some(cause),
            _ => None,
        };
        // An interrupt that an earlier instruction has left pending comes first.
        let has_executed = machine.statistics().instructions > before.1;
        if cause.is_none() && stop == Stop::Limit && !has_executed {
            continue;
        }
        let is_data = text.starts_with(".word");
        let is_invalid = matches!(cause, Some(Cause::InvalidOpcode { .. }));
        assert_eq!(is_data, is_invalid, "{word:#06x} `{text}`: {stop:?}");
        let stays = cause.is_some() || stop == Stop::Halt;
        assert!(stays || machine.cycle() > before.0, "{text}");
        if machine.is_sleeping() {
            return;
        }
    }
}

/// Bytes for the server: lines are packets, which get their checksums here; a line that begins with
/// `!` is sent as it is. The first line is the program.
pub fn packets(data: &[u8]) {
    const LIMIT: u64 = 20_000;
    let mut lines = data.split(|&byte| byte == b'\n');
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.write_flash(0, &words(lines.next().unwrap_or_default()));
    let Ok(mut debugger) = Debugger::new(machine, Unconnected) else {
        panic!("a session begins");
    };
    for line in lines {
        let sent = match line.strip_prefix(b"!") {
            Some(raw) => debugger.receive(raw),
            None => debugger.receive(&frame(line)),
        };
        sent.unwrap_or_else(|error| panic!("{error}"));
        let until = debugger.machine().cycle() + 1_000;
        let ran = debugger.run(until, LIMIT);
        ran.unwrap_or_else(|error| panic!("{error}"));
        check_frames(&debugger.take_output());
        if matches!(debugger.state(), State::Detached | State::Killed) {
            break;
        }
    }
    let (mut machine, mut env, _) = debugger.into_parts();
    machine.run(&mut env, LIMIT);
}

fn frame(body: &[u8]) -> Vec<u8> {
    let sum = body.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte));
    [b"$", body, format!("#{sum:02x}").as_bytes()].concat()
}

/// What the server says is acknowledgements and packets whose checksums are right.
fn check_frames(mut said: &[u8]) {
    while let Some((&first, rest)) = said.split_first() {
        said = rest;
        if first != b'$' {
            assert!(matches!(first, b'+' | b'-'), "{first:#04x} between packets");
            continue;
        }
        let end = said.iter().position(|&byte| byte == b'#');
        let body = &said[..end.expect("a packet has an end")];
        let (whole, after) = (frame(body), said.get(body.len() + 3..));
        assert!(said.starts_with(&whole[1..]), "a wrong checksum");
        said = after.expect("a checksum");
    }
}

/// Any program with inputs that never rest gets on, and comes to the same twice. Returns the cycles
/// that it ran. The first byte is the high fuse.
pub fn random_flash(data: &[u8]) -> u64 {
    const LIMIT: u64 = 100_000;
    let (&high, program) = data.split_first().unwrap_or((&0xD9, &[]));
    let words = words(program);
    let mut machine = Machine::new(&ATMEGA328P, 8_000_000);
    machine.write_flash(0, &words);
    // A second copy at the boot section, from which self-programming works.
    machine.write_flash(0x3800, &words);
    machine.set_fuses(Fuses {
        high,
        ..Fuses::default()
    });
    let stop = machine.run(&mut Restless(0), LIMIT);
    assert!(stop != Stop::Limit || machine.cycle() >= LIMIT);
    machine.cycle()
}

/// Pins, voltages and serial bytes that change all the time.
struct Restless(u64);

impl Environment for Restless {
    fn pin_level(&mut self, cycle: u64, pin: Pin) -> Option<bool> {
        Some((cycle >> 4).wrapping_mul(pin.index() as u64 + 3) & 4 != 0)
    }

    fn analog(&mut self, cycle: u64, _: AnalogInput) -> f64 {
        (cycle % 500) as f64 / 100.0
    }

    fn uart_rx(&mut self, cycle: u64) -> Option<SerialByte> {
        self.0 += 1;
        (self.0 < 50).then_some(SerialByte {
            start_cycle: cycle + 100,
            byte: self.0 as u8,
            ninth: self.0.is_multiple_of(3),
        })
    }

    fn next_input(&self, cycle: u64) -> Option<u64> {
        Some(cycle + 37)
    }
}
