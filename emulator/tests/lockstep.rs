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
use common::random::{Case, FLASH_WORDS, RAM_BYTES, RAM_START, case, machine};
use proptest::prelude::*;

/// State after one instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
struct State {
    pc: u32,
    cycle: u64,
    sp: u16,
    sreg: u8,
    registers: [u8; 32],
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
