//! The core against simavr, instruction by instruction, on random programs.
//!
//! After every instruction program counter, cycles, stack pointer, SREG and all registers must
//! agree, and SRAM at the end. Excused are only what the generator leaves out or `Excuse` names,
//! each with its reason.

mod common;

use std::collections::BTreeMap;
use std::io::{BufReader, BufWriter, Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, OnceLock};

use cardan_emulator::{ATMEGA328P, Image, Machine, Unconnected, disassemble};
use proptest::prelude::*;

const RAM_START: usize = 0x100;
const RAM_BYTES: usize = 0x800;
const FLASH_WORDS: usize = 0x4000;

/// State after one instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
struct State {
    pc: u32,
    cycle: u64,
    sp: u16,
    sreg: u8,
    registers: [u8; 32],
}

/// A program and the state it starts from.
#[derive(Clone)]
struct Case {
    address: usize,
    words: Vec<u16>,
    registers: [u8; 32],
    sp: u16,
    sreg: u8,
    sram: Vec<u8>,
    steps: usize,
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

/// simavr in a child process.
struct Oracle {
    _child: Child,
    stdin: BufWriter<ChildStdin>,
    stdout: BufReader<ChildStdout>,
}

impl Oracle {
    fn start() -> Oracle {
        let program = common::oracle("core_oracle.c");
        let mut child = Command::new(program)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the oracle was just compiled");
        let stdin = BufWriter::new(child.stdin.take().expect("piped"));
        let stdout = BufReader::with_capacity(1 << 20, child.stdout.take().expect("piped"));
        Oracle {
            _child: child,
            stdin,
            stdout,
        }
    }

    /// States after each instruction, and SRAM at the end.
    fn run(&mut self, case: &Case, steps: usize) -> (Vec<State>, Vec<u8>) {
        let mut request = Vec::new();
        request.extend((case.address as u32).to_le_bytes());
        request.extend((case.words.len() as u32).to_le_bytes());
        request.extend(case.words.iter().flat_map(|word| word.to_le_bytes()));
        request.extend((case.address as u32 * 2).to_le_bytes());
        request.extend(case.sp.to_le_bytes());
        request.push(case.sreg);
        request.extend(case.registers);
        request.extend(&case.sram);
        request.extend((steps as u32).to_le_bytes());
        self.stdin.write_all(&request).expect("the oracle reads");
        self.stdin.flush().expect("the oracle reads");
        let mut states = Vec::new();
        while self.take::<1>()[0] == 1 {
            states.push(State {
                pc: u32::from_le_bytes(self.take()),
                cycle: u64::from_le_bytes(self.take()),
                sp: u16::from_le_bytes(self.take()),
                sreg: self.take::<1>()[0],
                registers: self.take(),
            });
        }
        (states, self.take::<RAM_BYTES>().to_vec())
    }

    fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut bytes = [0; N];
        self.stdout
            .read_exact(&mut bytes)
            .expect("the oracle answers");
        bytes
    }
}

fn oracle() -> &'static Mutex<Oracle> {
    static ORACLE: OnceLock<Mutex<Oracle>> = OnceLock::new();
    ORACLE.get_or_init(|| Mutex::new(Oracle::start()))
}

fn machine(case: &Case) -> Machine {
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

fn state(machine: &Machine) -> State {
    State {
        pc: machine.pc(),
        cycle: machine.cycle(),
        sp: machine.sp(),
        sreg: machine.sreg(),
        registers: machine.registers().try_into().expect("32 registers"),
    }
}

/// Why a comparison ends before the program does. None hides a difference of the core.
enum Excuse {
    /// I/O registers: the peripherals differ by design (other tests cover them).
    Io,
    /// The program counter or LPM passes the end of flash: simavr stops there or invents a word,
    /// the chip's counter of 14 bits wraps (covered by tests of their own).
    FlashEnd,
    /// simavr takes some ADIW and SBIW for two-word instructions when it skips them (it masks the
    /// opcode with 0xFC0F where JMP and CALL need 0xFE0E).
    SkippedAdiw,
}

/// Effective data address of a load or store at the program counter, worked out here from the
/// opcode so that the test does not trust the decoder.
fn data_address(machine: &Machine, word: u16, next: u16) -> Option<u16> {
    let pair =
        |low: usize| u16::from_le_bytes([machine.registers()[low], machine.registers()[low + 1]]);
    let q = word >> 8 & 0x20 | word >> 7 & 0x18 | word & 7;
    match word {
        w if w & 0xD000 == 0x8000 => Some(pair(if w & 8 != 0 { 28 } else { 30 }).wrapping_add(q)),
        w if w & 0xFC0F == 0x9000 => Some(next),
        w if w & 0xFC00 == 0x9000 => match w & 15 {
            1 => Some(pair(30)),
            2 => Some(pair(30).wrapping_sub(1)),
            9 => Some(pair(28)),
            10 => Some(pair(28).wrapping_sub(1)),
            12 | 13 => Some(pair(26)),
            14 => Some(pair(26).wrapping_sub(1)),
            _ => None,
        },
        w if w & 0xF000 == 0xB000 => Some(0x20 + (w >> 5 & 0x30 | w & 15)),
        w if w & 0xFC00 == 0x9800 => Some(0x20 + (w >> 3 & 31)),
        _ => None,
    }
}

/// CPSE, SBRC, SBRS, SBIC, SBIS.
fn is_skip(word: u16) -> bool {
    word & 0xFC00 == 0x1000 || word & 0xFC08 == 0xFC00 || word & 0xFD00 == 0x9900
}

fn excuse_before(machine: &Machine, words: &[u16]) -> Option<Excuse> {
    let pc = machine.pc() as usize / 2;
    if pc + 3 >= words.len() {
        return Some(Excuse::FlashEnd);
    }
    let next = words[pc + 1];
    if is_skip(words[pc]) && next & 0xFE00 == 0x9600 && next & 0x0C == 0x0C {
        return Some(Excuse::SkippedAdiw);
    }
    let is_lpm = words[pc] == 0x95C8 || words[pc] & 0xFE0E == 0x9004;
    if is_lpm && machine.registers()[31] >= 0x80 {
        return Some(Excuse::FlashEnd);
    }
    let address = data_address(machine, words[pc], words[pc + 1])?;
    // SPL, SPH, SREG and GPIOR1, GPIOR2 behave alike; other I/O is the peripherals' business.
    let is_core = matches!(address, 0x4A | 0x4B | 0x5D..=0x5F);
    ((0x20..0x100).contains(&address) && !is_core).then_some(Excuse::Io)
}

/// Runs a case on both and counts the operations compared.
fn compare(case: &Case, coverage: &mut BTreeMap<String, u64>) -> Result<(), TestCaseError> {
    let mut ours = machine(case);
    let flash = ours.flash().to_vec();
    let mut trace = Vec::new();
    while trace.len() < case.steps {
        let pc = ours.pc() as usize / 2;
        if excuse_before(&ours, &flash).is_some() {
            break;
        }
        let text = disassemble(&flash[pc..pc + 2]);
        let stop = ours.step(&mut Unconnected);
        if stop.is_some() {
            // A halt or a crash executes nothing, so there is nothing to compare. Crashes are
            // addresses beyond SRAM, where the chip has nothing and simavr an array.
            break;
        }
        let is_branch = flash[pc] & 0xF800 == 0xF000;
        if is_branch && pc < 0x100 && ours.pc() as usize / 2 > FLASH_WORDS - 0x100 {
            // Excused like `FlashEnd`: simavr does not wrap a branch below address 0.
            break;
        }
        trace.push((text, state(&ours)));
    }
    let (theirs, sram) = oracle()
        .lock()
        .expect("no test panics here")
        .run(case, trace.len());
    prop_assert_eq!(
        theirs.len(),
        trace.len(),
        "simavr stopped after {} instructions",
        theirs.len()
    );
    for (i, ((text, ours), theirs)) in trace.iter().zip(&theirs).enumerate() {
        prop_assert_eq!(
            ours,
            theirs,
            "instruction {}: {} (left: ours, right: simavr)",
            i,
            text
        );
        let name = text.split(' ').next().unwrap_or_default();
        *coverage.entry(name.to_owned()).or_default() += 1;
    }
    let different = (0..RAM_BYTES).find(|&i| ours.data()[RAM_START + i] != sram[i]);
    prop_assert_eq!(different, None, "SRAM differs at this offset");
    Ok(())
}

/// One random instruction as words. Left out: SLEEP, BREAK, WDR, SPM (they concern the machine
/// around the core) and X+ forms with the pointer as operand (undefined by the manual).
fn instruction() -> impl Strategy<Value = Vec<u16>> {
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

fn ldi(d: u16, value: u8) -> u16 {
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

fn case() -> impl Strategy<Value = Case> {
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
fn noise(seed: u64) -> Vec<u8> {
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

#[test]
fn random_programs_agree_with_simavr_after_every_instruction() {
    let coverage = Mutex::new(BTreeMap::new());
    let mut runner = proptest::test_runner::TestRunner::new_with_rng(
        ProptestConfig {
            cases: 12_000,
            failure_persistence: None,
            ..ProptestConfig::default()
        },
        proptest::test_runner::TestRng::deterministic_rng(
            proptest::test_runner::RngAlgorithm::ChaCha,
        ),
    );
    let result = runner.run(&case(), |case| {
        compare(&case, &mut coverage.lock().expect("no panic inside"))
    });
    if let Err(error) = result {
        panic!("{error}");
    }
    let coverage = coverage.into_inner().expect("no panic inside");
    let total: u64 = coverage.values().sum();
    println!("{total} instructions compared; operations: {coverage:?}");
    let missing: Vec<&str> = OPERATIONS
        .split(' ')
        .filter(|name| !coverage.contains_key(*name))
        .collect();
    assert!(missing.is_empty(), "operations never compared: {missing:?}");
}

/// Every operation that the generator is meant to cover.
const OPERATIONS: &str = "nop movw mul muls mulsu fmul fmuls fmulsu cpc sbc add cpse cp sub adc \
and eor or mov cpi sbci subi ori andi ldi ld ldd st std lds sts lpm push pop com neg swap inc dec \
asr lsr ror sec sez sen sev ses seh set sei clc clz cln clv cls clh clt cli brcs breq brmi brvs \
brlt brhs brts brie brcc brne brpl brvc brge brhc brtc brid bld bst sbrc sbrs rjmp rcall jmp call \
ret reti ijmp icall adiw sbiw in out";

#[test]
fn a_program_of_library_calls_agrees_with_simavr_after_every_instruction() {
    let source = include_str!("programs/library.c");
    let elf = common::compile("library", "c", source, &["-Os", "-std=gnu99", "-lm"]);
    let image = Image::read(&elf, &ATMEGA328P).expect("avr-gcc writes a good ELF file");
    let case = Case {
        address: 0,
        words: image
            .flash
            .chunks(2)
            .map(|pair| u16::from_le_bytes([pair[0], *pair.get(1).unwrap_or(&0xFF)]))
            .collect(),
        registers: [0; 32],
        sp: 0x8FF,
        sreg: 0,
        sram: vec![0; RAM_BYTES],
        steps: 2_000_000,
    };
    let mut coverage = BTreeMap::new();
    if let Err(error) = compare(&case, &mut coverage) {
        panic!("{error}");
    }
    let total: u64 = coverage.values().sum();
    println!("{total} instructions compared; operations: {coverage:?}");
    assert!(
        total > 20_000,
        "the program ended after {total} instructions"
    );
}
