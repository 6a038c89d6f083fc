//! Random programs one after the other: `random_flash CYCLES [SEED]`. Panics if one does.

#[path = "../fuzz/src/lib.rs"]
#[allow(
    dead_code,
    unreachable_pub,
    missing_docs,
    reason = "one of several bodies of the fuzzer"
)]
mod bodies;

use std::process::ExitCode;

/// Bytes of a program, and the fuse before it.
const BYTES: usize = 601;

fn main() -> ExitCode {
    let numbers: Option<Vec<u64>> = std::env::args()
        .skip(1)
        .map(|text| text.parse().ok())
        .collect();
    let (wanted, mut state) = match numbers.as_deref() {
        Some(&[cycles]) => (cycles, 1),
        Some(&[cycles, seed]) => (cycles, seed.max(1)),
        _ => {
            eprintln!("usage: random_flash CYCLES [SEED]");
            return ExitCode::from(2);
        }
    };
    let (mut cycles, mut programs) = (0, 0u64);
    while cycles < wanted {
        cycles += bodies::random_flash(&program(&mut state));
        programs += 1;
    }
    println!("{programs} programs, {cycles} cycles, no panic");
    ExitCode::SUCCESS
}

/// Random words, half of them accesses to I/O registers: LDI and STS.
fn program(state: &mut u64) -> Vec<u8> {
    let mut bytes = vec![next(state) as u8];
    while bytes.len() < BYTES {
        let random = next(state);
        let word = random as u16;
        let words = match random >> 60 {
            0..6 => vec![word],
            6..14 => {
                let (register, value) = (word & 15, word >> 4 & 0xFF);
                let ldi = 0xE000 | register << 4 | (value & 0xF0) << 4 | value & 15;
                let address = 0x20 + (random >> 20) as u16 % 0xE0;
                vec![ldi, 0x9300 | register << 4, address]
            }
            14 => vec![0x9478],
            _ => vec![0x9588],
        };
        bytes.extend(words.iter().flat_map(|word: &u16| word.to_le_bytes()));
    }
    bytes
}

/// Xorshift64*.
fn next(state: &mut u64) -> u64 {
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    state.wrapping_mul(0x2545_F491_4F6C_DD1D)
}
