//! The processor core: registers, memory and the predecoded interpreter.
//!
//! [`Core::run`] executes instructions until the next event is due or until an instruction needs
//! more than the core: an I/O register, sleep, a change of the interrupt enable. It then returns
//! *before* that instruction, and the machine carries it out ([`crate::bus`]). So this loop is
//! small, knows no peripheral and keeps its state in host registers.

use crate::alu;
use crate::isa::{Code, Op, decode};

/// Words the operation table holds: the whole range of the program counter, so that indexing
/// with a `u16` needs no check.
const OPS: usize = 0x1_0000;
/// Bytes of the data space, likewise.
const DATA: usize = 0x1_0000;

/// Why [`Core::run`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// The next event is due.
    Event,
    /// The instruction at `pc` needs the machine.
    Machine,
}

/// Processor state. `data[0..32]` are the general registers, SRAM lies at `ram_start`.
#[derive(Clone, Debug)]
pub(crate) struct Core {
    ops: Box<[Op; OPS]>,
    pub(crate) data: Box<[u8; DATA]>,
    flash: Vec<u16>,
    /// Word address of the next instruction.
    pub(crate) pc: u16,
    pub(crate) sp: u16,
    pub(crate) sreg: u8,
    /// Processor cycles since reset.
    pub(crate) cycle: u64,
    /// [`Core::run`] returns at the first instruction boundary at or after this cycle.
    pub(crate) next_event: u64,
    pub(crate) instructions: u64,
    /// Lowest stack pointer seen.
    pub(crate) lowest_sp: u16,
    pub(crate) ram_start: u16,
    pub(crate) ram_bytes: u16,
    /// LPM may have to read fuses or signature: leave it to the machine.
    pub(crate) lpm_in_machine: bool,
}

fn boxed<T: Clone, const LEN: usize>(value: T) -> Box<[T; LEN]> {
    match vec![value; LEN].into_boxed_slice().try_into() {
        Ok(array) => array,
        Err(_) => unreachable!("the vector has LEN elements"),
    }
}

impl Core {
    /// A core with erased flash; `flash_words` is a power of two.
    pub(crate) fn new(flash_words: usize, ram_start: u16, ram_bytes: u16) -> Core {
        let mut core = Core {
            ops: boxed(Op::WRAP),
            data: boxed(0),
            flash: vec![0xFFFF; flash_words],
            pc: 0,
            sp: ram_start + (ram_bytes - 1),
            sreg: 0,
            cycle: 0,
            next_event: 0,
            instructions: 0,
            lowest_sp: ram_start + (ram_bytes - 1),
            ram_start,
            ram_bytes,
            lpm_in_machine: false,
        };
        core.decode_words(0, flash_words);
        core
    }

    /// Registers, SP and SREG as after a reset; memory and counters stay.
    pub(crate) fn reset(&mut self) {
        self.pc = 0;
        self.sreg = 0;
        self.sp = self.ram_start + (self.ram_bytes - 1);
        self.data[0x20..0x100].fill(0);
    }

    pub(crate) fn flash(&self) -> &[u16] {
        &self.flash
    }

    /// Writes flash words and decodes them, and the word before them (its skip distance).
    pub(crate) fn write_flash(&mut self, word_address: usize, words: &[u16]) {
        let mask = self.flash.len() - 1;
        for (i, &word) in words.iter().enumerate() {
            self.flash[(word_address + i) & mask] = word;
        }
        self.decode_words(word_address.wrapping_sub(1), words.len() + 1);
    }

    fn decode_words(&mut self, first: usize, count: usize) {
        let mask = self.flash.len() - 1;
        for i in 0..count {
            let pc = first.wrapping_add(i) & mask;
            self.ops[pc] = decode(&self.flash, pc);
        }
    }

    /// The predecoded instruction at the program counter.
    pub(crate) fn op(&self) -> Op {
        self.ops[self.pc as usize]
    }

    pub(crate) fn pc_mask(&self) -> u16 {
        (self.flash.len() - 1) as u16
    }

    /// The byte of program memory at byte address `z`.
    pub(crate) fn flash_byte(&self, z: u16) -> u8 {
        flash_byte(&self.flash, z)
    }

    pub(crate) fn pair(&self, register: u8) -> u16 {
        pair(&self.data, register)
    }

    pub(crate) fn set_pair(&mut self, register: u8, value: u16) {
        set_pair(&mut self.data, register, value);
    }

    /// Whether `count` bytes may be pushed: SP and the bytes below it lie in SRAM.
    pub(crate) fn may_push(&self, count: u16) -> bool {
        let below = self.sp.wrapping_sub(self.ram_start);
        below < self.ram_bytes && below >= count - 1
    }

    /// Whether `count` bytes may be popped.
    pub(crate) fn may_pop(&self, count: u16) -> bool {
        let above = self.sp.wrapping_add(1).wrapping_sub(self.ram_start);
        above < self.ram_bytes && self.ram_bytes - above >= count
    }

    /// Pushes a return address; the caller has asked [`Core::may_push`].
    pub(crate) fn push_pc(&mut self, pc: u16) {
        push_pc(&mut self.data, &mut self.sp, pc);
        self.lowest_sp = self.lowest_sp.min(self.sp);
    }

    /// Pops a return address; the caller has asked [`Core::may_pop`].
    pub(crate) fn pop_pc(&mut self) -> u16 {
        pop_pc(&self.data, &mut self.sp)
    }

    /// Executes until `next_event` or an instruction that needs the machine.
    // One match arm per operation: the table of the instruction set, kept in one place.
    pub(crate) fn run(&mut self) -> Exit {
        let ops = &*self.ops;
        let data = &mut *self.data;
        let flash = &self.flash[..];
        let (ram_start, ram_bytes) = (self.ram_start, self.ram_bytes);
        let (next_event, lpm_in_machine) = (self.next_event, self.lpm_in_machine);
        let (mut pc, mut sp, mut sreg) = (self.pc, self.sp, self.sreg);
        let (mut cycle, mut instructions) = (self.cycle, self.instructions);
        let mut lowest_sp = self.lowest_sp;

        macro_rules! reg {
            ($i:expr) => {
                data[$i as usize]
            };
        }
        macro_rules! next {
            ($cycles:expr) => {{
                pc = pc.wrapping_add(1);
                cycle += $cycles;
            }};
        }
        // Binary operation with result and flags.
        macro_rules! binary {
            ($op:expr, $f:expr) => {{
                let (value, flags) = $f;
                reg!($op.d) = value;
                sreg = flags;
                next!(1);
            }};
        }
        macro_rules! skip_if {
            ($op:expr, $condition:expr) => {{
                let words = if $condition { u16::from($op.n) } else { 0 };
                pc = pc.wrapping_add(1 + words);
                cycle += 1 + u64::from(words);
            }};
        }
        macro_rules! multiply {
            ($product:expr) => {{
                let product: u16 = $product;
                set_pair(data, 0, product);
                sreg = alu::product(product, sreg);
                next!(2);
            }};
        }
        macro_rules! multiply_fractional {
            ($product:expr) => {{
                let (value, flags) = alu::fractional($product, sreg);
                set_pair(data, 0, value);
                sreg = flags;
                next!(2);
            }};
        }
        let in_ram = |address: u16| address.wrapping_sub(ram_start) < ram_bytes;

        let exit = loop {
            if cycle >= next_event {
                break Exit::Event;
            }
            let op = ops[pc as usize];
            match op.code {
                Code::Nop => next!(1),
                Code::Movw => {
                    let value = pair(data, op.r);
                    set_pair(data, op.d, value);
                    next!(1);
                }
                Code::Mul => multiply!(u16::from(reg!(op.d)) * u16::from(reg!(op.r))),
                Code::Muls => multiply!(signed(reg!(op.d)).wrapping_mul(signed(reg!(op.r)))),
                Code::Mulsu => multiply!(signed(reg!(op.d)).wrapping_mul(u16::from(reg!(op.r)))),
                Code::Fmul => multiply_fractional!(u16::from(reg!(op.d)) * u16::from(reg!(op.r))),
                Code::Fmuls => {
                    multiply_fractional!(signed(reg!(op.d)).wrapping_mul(signed(reg!(op.r))));
                }
                Code::Fmulsu => {
                    multiply_fractional!(signed(reg!(op.d)).wrapping_mul(u16::from(reg!(op.r))));
                }
                Code::Add => binary!(op, alu::add(reg!(op.d), reg!(op.r), 0, sreg)),
                Code::Adc => binary!(op, alu::add(reg!(op.d), reg!(op.r), sreg & alu::C, sreg)),
                Code::Sub => binary!(op, alu::sub(reg!(op.d), reg!(op.r), 0, sreg)),
                Code::Sbc => binary!(op, alu::sub_with_borrow(reg!(op.d), reg!(op.r), sreg)),
                Code::Subi => binary!(op, alu::sub(reg!(op.d), op.r, 0, sreg)),
                Code::Sbci => binary!(op, alu::sub_with_borrow(reg!(op.d), op.r, sreg)),
                Code::Cp => {
                    sreg = alu::sub(reg!(op.d), reg!(op.r), 0, sreg).1;
                    next!(1);
                }
                Code::Cpc => {
                    sreg = alu::sub_with_borrow(reg!(op.d), reg!(op.r), sreg).1;
                    next!(1);
                }
                Code::Cpi => {
                    sreg = alu::sub(reg!(op.d), op.r, 0, sreg).1;
                    next!(1);
                }
                Code::And => {
                    let value = reg!(op.d) & reg!(op.r);
                    binary!(op, (value, alu::logic(value, sreg)));
                }
                Code::Or => {
                    let value = reg!(op.d) | reg!(op.r);
                    binary!(op, (value, alu::logic(value, sreg)));
                }
                Code::Eor => {
                    let value = reg!(op.d) ^ reg!(op.r);
                    binary!(op, (value, alu::logic(value, sreg)));
                }
                Code::Andi => {
                    let value = reg!(op.d) & op.r;
                    binary!(op, (value, alu::logic(value, sreg)));
                }
                Code::Ori => {
                    let value = reg!(op.d) | op.r;
                    binary!(op, (value, alu::logic(value, sreg)));
                }
                Code::Mov => {
                    reg!(op.d) = reg!(op.r);
                    next!(1);
                }
                Code::Ldi => {
                    reg!(op.d) = op.r;
                    next!(1);
                }
                Code::Com => binary!(op, alu::com(reg!(op.d), sreg)),
                Code::Neg => binary!(op, alu::neg(reg!(op.d), sreg)),
                Code::Inc => binary!(op, alu::inc(reg!(op.d), sreg)),
                Code::Dec => binary!(op, alu::dec(reg!(op.d), sreg)),
                Code::Asr => binary!(op, alu::asr(reg!(op.d), sreg)),
                Code::Lsr => binary!(op, alu::lsr(reg!(op.d), sreg)),
                Code::Ror => binary!(op, alu::ror(reg!(op.d), sreg)),
                Code::Swap => {
                    reg!(op.d) = reg!(op.d).rotate_left(4);
                    next!(1);
                }
                Code::Adiw => {
                    let (value, flags) = alu::adiw(pair(data, op.d), op.r, sreg);
                    set_pair(data, op.d, value);
                    sreg = flags;
                    next!(2);
                }
                Code::Sbiw => {
                    let (value, flags) = alu::sbiw(pair(data, op.d), op.r, sreg);
                    set_pair(data, op.d, value);
                    sreg = flags;
                    next!(2);
                }
                Code::Bset => {
                    sreg |= op.r;
                    next!(1);
                }
                Code::Bclr => {
                    sreg &= !op.r;
                    next!(1);
                }
                Code::Bld => {
                    let bit = if sreg & alu::T != 0 { op.r } else { 0 };
                    reg!(op.d) = reg!(op.d) & !op.r | bit;
                    next!(1);
                }
                Code::Bst => {
                    let bit = if reg!(op.d) & op.r != 0 { alu::T } else { 0 };
                    sreg = sreg & !alu::T | bit;
                    next!(1);
                }
                Code::Brbs => {
                    let taken = sreg & op.r != 0;
                    pc = if taken { op.k } else { pc.wrapping_add(1) };
                    cycle += 1 + u64::from(taken);
                }
                Code::Brbc => {
                    let taken = sreg & op.r == 0;
                    pc = if taken { op.k } else { pc.wrapping_add(1) };
                    cycle += 1 + u64::from(taken);
                }
                Code::Cpse => skip_if!(op, reg!(op.d) == reg!(op.r)),
                Code::Sbrc => skip_if!(op, reg!(op.d) & op.r == 0),
                Code::Sbrs => skip_if!(op, reg!(op.d) & op.r != 0),
                Code::Jump => {
                    pc = op.k;
                    cycle += u64::from(op.n);
                }
                Code::Ijmp => {
                    let target = pair(data, 30);
                    if usize::from(target) >= flash.len() {
                        break Exit::Machine;
                    }
                    pc = target;
                    cycle += 2;
                }
                Code::Call | Code::Icall => {
                    let target = if op.code == Code::Call {
                        op.k
                    } else {
                        pair(data, 30)
                    };
                    let room = sp.wrapping_sub(ram_start);
                    if room >= ram_bytes || room < 1 || usize::from(target) >= flash.len() {
                        break Exit::Machine;
                    }
                    let words = if op.code == Code::Call {
                        u16::from(op.r)
                    } else {
                        1
                    };
                    push_pc(
                        data,
                        &mut sp,
                        pc.wrapping_add(words) & (flash.len() - 1) as u16,
                    );
                    lowest_sp = lowest_sp.min(sp);
                    pc = target;
                    cycle += u64::from(op.n);
                }
                Code::Ret => {
                    let bottom = sp.wrapping_add(1);
                    if !in_ram(bottom) || !in_ram(bottom.wrapping_add(1)) {
                        break Exit::Machine;
                    }
                    let mut after = sp;
                    let target = pop_pc(data, &mut after);
                    if usize::from(target) >= flash.len() {
                        break Exit::Machine;
                    }
                    sp = after;
                    pc = target;
                    cycle += 4;
                }
                Code::Push => {
                    if !in_ram(sp) {
                        break Exit::Machine;
                    }
                    data[sp as usize] = reg!(op.d);
                    sp = sp.wrapping_sub(1);
                    lowest_sp = lowest_sp.min(sp);
                    next!(2);
                }
                Code::Pop => {
                    let top = sp.wrapping_add(1);
                    if !in_ram(top) {
                        break Exit::Machine;
                    }
                    sp = top;
                    reg!(op.d) = data[sp as usize];
                    next!(2);
                }
                Code::Lds => {
                    if !in_ram(op.k) {
                        break Exit::Machine;
                    }
                    reg!(op.d) = data[op.k as usize];
                    pc = pc.wrapping_add(2);
                    cycle += 2;
                }
                Code::Sts => {
                    if !in_ram(op.k) {
                        break Exit::Machine;
                    }
                    data[op.k as usize] = reg!(op.d);
                    pc = pc.wrapping_add(2);
                    cycle += 2;
                }
                Code::Ldd => {
                    let address = pair(data, op.r).wrapping_add(u16::from(op.n));
                    if !in_ram(address) {
                        break Exit::Machine;
                    }
                    reg!(op.d) = data[address as usize];
                    next!(2);
                }
                Code::LdInc => {
                    let address = pair(data, op.r);
                    if !in_ram(address) {
                        break Exit::Machine;
                    }
                    set_pair(data, op.r, address.wrapping_add(1));
                    reg!(op.d) = data[address as usize];
                    next!(2);
                }
                Code::LdDec => {
                    let address = pair(data, op.r).wrapping_sub(1);
                    if !in_ram(address) {
                        break Exit::Machine;
                    }
                    set_pair(data, op.r, address);
                    reg!(op.d) = data[address as usize];
                    next!(2);
                }
                Code::Std => {
                    let address = pair(data, op.r).wrapping_add(u16::from(op.n));
                    if !in_ram(address) {
                        break Exit::Machine;
                    }
                    data[address as usize] = reg!(op.d);
                    next!(2);
                }
                Code::StInc => {
                    let address = pair(data, op.r);
                    if !in_ram(address) {
                        break Exit::Machine;
                    }
                    data[address as usize] = reg!(op.d);
                    set_pair(data, op.r, address.wrapping_add(1));
                    next!(2);
                }
                Code::StDec => {
                    let address = pair(data, op.r).wrapping_sub(1);
                    if !in_ram(address) {
                        break Exit::Machine;
                    }
                    data[address as usize] = reg!(op.d);
                    set_pair(data, op.r, address);
                    next!(2);
                }
                Code::Lpm => {
                    if lpm_in_machine {
                        break Exit::Machine;
                    }
                    reg!(op.d) = flash_byte(flash, pair(data, 30));
                    next!(3);
                }
                Code::LpmInc => {
                    if lpm_in_machine {
                        break Exit::Machine;
                    }
                    let z = pair(data, 30);
                    set_pair(data, 30, z.wrapping_add(1));
                    reg!(op.d) = flash_byte(flash, z);
                    next!(3);
                }
                Code::InSreg => {
                    reg!(op.d) = sreg;
                    next!(1);
                }
                Code::OutSreg => {
                    let value = reg!(op.d);
                    if value & !sreg & alu::I != 0 {
                        break Exit::Machine;
                    }
                    sreg = value;
                    next!(1);
                }
                Code::InSpl => {
                    reg!(op.d) = sp as u8;
                    next!(1);
                }
                Code::InSph => {
                    reg!(op.d) = (sp >> 8) as u8;
                    next!(1);
                }
                Code::OutSpl => {
                    sp = sp & 0xFF00 | u16::from(reg!(op.d));
                    lowest_sp = lowest_sp.min(sp);
                    next!(1);
                }
                Code::OutSph => {
                    sp = sp & 0x00FF | u16::from(reg!(op.d)) << 8;
                    next!(1);
                }
                Code::Wrap => {
                    // Only the fall-through from the last word comes here; it costs nothing.
                    pc &= (flash.len() - 1) as u16;
                    continue;
                }
                Code::Sei
                | Code::Reti
                | Code::Sleep
                | Code::Break
                | Code::Wdr
                | Code::Spm
                | Code::In
                | Code::Out
                | Code::Sbi
                | Code::Cbi
                | Code::Sbic
                | Code::Sbis
                | Code::JumpSelf
                | Code::Invalid => break Exit::Machine,
            }
            instructions += 1;
        };
        self.pc = pc;
        self.sp = sp;
        self.sreg = sreg;
        self.cycle = cycle;
        self.instructions = instructions;
        self.lowest_sp = lowest_sp;
        exit
    }
}

#[inline(always)]
fn pair(data: &[u8; DATA], register: u8) -> u16 {
    u16::from_le_bytes([data[register as usize], data[register as usize + 1]])
}

#[inline(always)]
fn set_pair(data: &mut [u8; DATA], register: u8, value: u16) {
    let [low, high] = value.to_le_bytes();
    data[register as usize] = low;
    data[register as usize + 1] = high;
}

#[inline(always)]
fn push_pc(data: &mut [u8; DATA], sp: &mut u16, pc: u16) {
    let [low, high] = pc.to_le_bytes();
    data[*sp as usize] = low;
    data[sp.wrapping_sub(1) as usize] = high;
    *sp = sp.wrapping_sub(2);
}

#[inline(always)]
fn pop_pc(data: &[u8; DATA], sp: &mut u16) -> u16 {
    let high = data[sp.wrapping_add(1) as usize];
    let low = data[sp.wrapping_add(2) as usize];
    *sp = sp.wrapping_add(2);
    u16::from_le_bytes([low, high])
}

/// A register as a sign-extended 16-bit factor.
#[inline(always)]
fn signed(value: u8) -> u16 {
    value as i8 as i16 as u16
}

#[inline(always)]
fn flash_byte(flash: &[u16], z: u16) -> u8 {
    let word = flash[usize::from(z >> 1) & (flash.len() - 1)];
    word.to_le_bytes()[usize::from(z & 1)]
}
