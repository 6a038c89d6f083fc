//! Random programs: mostly sensible instructions in an order that no compiler would choose.

#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test program uses its part of the helpers"
)]

use cardan_emulator::{ATMEGA328P, Machine, disassemble};
use proptest::prelude::*;

pub const RAM_START: usize = 0x100;
pub const RAM_BYTES: usize = 0x800;
pub const FLASH_WORDS: usize = 0x4000;

/// A program and the state it starts from.
#[derive(Clone)]
pub struct Case {
    pub address: usize,
    pub words: Vec<u16>,
    pub registers: [u8; 32],
    pub sp: u16,
    pub sreg: u8,
    pub sram: Vec<u8>,
    pub steps: usize,
}

impl std::fmt::Debug for Case {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "at {:#06x}, SP {:#06x}, SREG {:#04x}",
            self.address * 2,
            self.sp,
            self.sreg
        )?;
        writeln!(f, "r0..r31 {:02x?}", self.registers)?;
        let mut i = 0;
        while i < self.words.len() {
            let words = &self.words[i..];
            let text = disassemble(words);
            writeln!(
                f,
                "  {:#06x}: {:04x} {text}",
                (self.address + i) * 2,
                words[0]
            )?;
            i += if matches!(text.get(..3), Some("lds" | "sts" | "jmp" | "cal")) {
                2
            } else {
                1
            };
        }
        Ok(())
    }
}

/// A machine that stands at the beginning of a case.
pub fn machine(case: &Case) -> Machine {
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.write_flash(0, &vec![0xCFFF; FLASH_WORDS]);
    machine.write_flash(case.address, &case.words);
    machine.data_mut()[..32].copy_from_slice(&case.registers);
    machine.data_mut()[RAM_START..].copy_from_slice(&case.sram);
    machine.set_pc(case.address as u32 * 2);
    machine.set_sp(case.sp);
    machine.set_sreg(case.sreg);
    machine
}

/// One random instruction as words. Left out: SLEEP, BREAK, WDR, SPM (they concern the machine
/// around the core) and X+ forms with the pointer as operand (undefined by the manual).
pub fn instruction() -> impl Strategy<Value = Vec<u16>> {
    let any16 = any::<u16>();
    let sram = 0x100u16..0x900;
    prop_oneof![
        // Two registers: CPC .. MOV, and MUL.
        12 => (0x0400u16..0x3000).prop_map(|w| vec![w]),
        2 => (0x9C00u16..=0x9FFF).prop_map(|w| vec![w]),
        // MOVW, MULS, MULSU, FMUL*, NOP.
        3 => (0x0100u16..0x0400).prop_map(|w| vec![w]),
        1 => Just(vec![0]),
        // Immediates.
        8 => (0x3000u16..0x8000).prop_map(|w| vec![w]),
        4 => (0xE000u16..=0xEFFF).prop_map(|w| vec![w]),
        // Single register operations.
        5 => (0u16..32, prop::sample::select(vec![0u16, 1, 2, 3, 5, 6, 7, 10]))
            .prop_map(|(d, op)| vec![0x9400 | d << 4 | op]),
        2 => (0x9600u16..=0x97FF).prop_map(|w| vec![w]),
        // Status bits, bit transfers, skips, branches.
        2 => (0u16..16).prop_map(|b| vec![0x9408 | b << 4]),
        3 => (any16, 0u16..4).prop_map(|(w, op)| vec![0xF800 | op << 9 | w & 0x1F7]),
        4 => (0xF000u16..0xF800).prop_map(|w| vec![w & 0xFC07 | small_branch(w)]),
        // Jumps and calls, mostly forward so that programs get on.
        1 => (0u16..8).prop_map(|k| vec![0xC000 | k]),
        1 => (0u16..6).prop_map(|k| vec![0xD000 | k]),
        1 => (0u16..200).prop_map(|k| vec![0x940C, k]),
        1 => (0u16..200).prop_map(|k| vec![0x940E, k]),
        1 => prop::sample::select(vec![0x9508u16, 0x9518, 0x9409, 0x9509]).prop_map(|w| vec![w]),
        // Memory, through pointers just set up or as they are.
        6 => (pointer(), 0u16..32, any::<bool>(), sram.clone())
            .prop_map(|(form, d, store, address)| load_store(form, d, store, address)),
        2 => (any16, any::<bool>()).prop_map(|(w, s)| vec![0x8000 | w & 0x2DFF | u16::from(s) << 9]),
        2 => (0u16..32, any::<bool>(), sram).prop_map(|(d, s, k)| vec![0x9000 | u16::from(s) << 9 | d << 4, k]),
        2 => (0u16..32, any::<bool>()).prop_map(|(d, s)| vec![0x900F | u16::from(s) << 9 | d << 4]),
        1 => (0u16..32, 0u16..0x200, 0u16..2)
            .prop_map(|(d, z, inc)| vec![ldi(30, z as u8), ldi(31, (z >> 8) as u8), lpm(d, inc)]),
        1 => Just(vec![0x95C8]),
        // SREG, SP and the general purpose registers through IN and OUT.
        2 => (0u16..32, any::<bool>(), prop::sample::select(vec![0x2Au16, 0x2B, 0x3D, 0x3F]))
            .prop_map(|(d, out, a)| vec![0xB000 | u16::from(out) << 11 | (a & 0x30) << 5 | d << 4 | a & 15]),
    ]
}

fn small_branch(word: u16) -> u16 {
    // Offsets -4 .. 11.
    let offset = (word >> 3 & 15) as i16 - 4;
    (offset as u16 & 0x7F) << 3
}

pub fn ldi(d: u16, value: u8) -> u16 {
    0xE000 | (d - 16) << 4 | u16::from(value & 0xF0) << 4 | u16::from(value & 15)
}

fn lpm(d: u16, increment: u16) -> u16 {
    let d = if increment == 1 && d >= 30 { 0 } else { d };
    0x9004 | d << 4 | increment
}

/// Pointer register and addressing form: 0 plain, 1 post-increment, 2 pre-decrement.
fn pointer() -> impl Strategy<Value = (u16, u16)> {
    (prop::sample::select(vec![26u16, 28, 30]), 0u16..3)
}

fn load_store((pointer, form): (u16, u16), d: u16, store: bool, address: u16) -> Vec<u16> {
    let is_pointer = d == pointer || d == pointer + 1;
    let d = if form != 0 && is_pointer { 5 } else { d };
    let low = match (pointer, form) {
        (26, 0) => 0x100C,
        (26, 1) => 0x100D,
        (26, _) => 0x100E,
        (28, 0) => 0x0008,
        (28, 1) => 0x1009,
        (28, _) => 0x100A,
        (_, 0) => 0x0000,
        (_, 1) => 0x1001,
        (_, _) => 0x1002,
    };
    let word = 0x8000 | low | d << 4 | u16::from(store) << 9;
    vec![
        ldi(pointer, address as u8),
        ldi(pointer + 1, (address >> 8) as u8),
        word,
    ]
}

/// A program of up to 80 items.
pub fn case() -> impl Strategy<Value = Case> {
    (
        prop::collection::vec(instruction(), 1..80),
        prop::sample::select(vec![0usize, 0, 0, 0x1FE0, 0x3F00]),
        any::<[u8; 32]>(),
        0x180u16..0x8F0,
        any::<u8>(),
        any::<u64>(),
    )
        .prop_map(|(items, address, registers, sp, sreg, seed)| Case {
            address,
            words: items.concat(),
            registers,
            sp,
            sreg: sreg & 0x7F,
            sram: noise(seed),
            steps: 300,
        })
}

/// SRAM contents from a seed (xorshift), so that a case prints and shrinks well.
pub fn noise(seed: u64) -> Vec<u8> {
    let mut state = seed | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        // Small values make plausible return addresses.
        if state & 0x100 != 0 {
            0
        } else {
            (state >> 32) as u8
        }
    };
    (0..RAM_BYTES).map(|_| next()).collect()
}
