//! The processor core: registers and memories.

use std::collections::BTreeSet;
use std::mem::offset_of;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::alu::Flags;
use crate::engine::Exit;
use crate::fusion::{fuse, unfuse};
use crate::isa::{Code, Op, decode, is_two_words};

/// Words the operation table holds: the whole range of the program counter, so that indexing
/// with a `u16` needs no check.
const OPS: usize = 0x1_0000;
/// Bytes of the data space, likewise.
pub(crate) const DATA: usize = 0x1_0000;

/// Names one state of the program memory of one core and its clones: two cores with the same stamp
/// hold the same program. It tells where contents come from, not what they are, so it takes no
/// part in comparisons.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FlashStamp(u64);

impl FlashStamp {
    fn new() -> FlashStamp {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        FlashStamp(NEXT.fetch_add(1, Ordering::Relaxed))
    }
}

impl PartialEq for FlashStamp {
    fn eq(&self, _: &FlashStamp) -> bool {
        true
    }
}

/// Where translated code finds the state of a [`Core`]: byte offsets from its beginning. All
/// fields are in the byte order of the host; `alu.rs` tells how flags are kept apart.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "the names are those of the fields")]
pub struct Layout {
    /// `u16`, word address.
    pub pc: usize,
    /// `u16`.
    pub sp: usize,
    /// `u8`: 0 or 1.
    pub carry: usize,
    /// `u8`: 0 if the flag is set.
    pub zero: usize,
    /// `u32`: N in bit 7, V in bit 15, S is their exclusive or with bit 23.
    pub signs: usize,
    /// `u8`: bit 4.
    pub half: usize,
    /// `u8`: T in bit 6, I in bit 7.
    pub enables: usize,
    /// `u64`.
    pub cycle: usize,
    /// `u64`: no instruction begins at or after this cycle.
    pub next_event: usize,
    /// `u64`.
    pub instructions: usize,
    /// `u16`.
    pub lowest_sp: usize,
    /// `bool`: LPM is the machine's at present.
    pub lpm_in_machine: usize,
}

/// Processor state. `data[0..32]` are the general registers, SRAM lies at `ram_start`.
#[derive(Clone, Debug, PartialEq)]
pub struct Core {
    pub(crate) ops: Box<[Op; OPS]>,
    pub(crate) data: Box<[u8; DATA]>,
    pub(crate) flash: Vec<u16>,
    pub(crate) flash_stamp: FlashStamp,
    /// Word address of the next instruction.
    pub(crate) pc: u16,
    pub(crate) sp: u16,
    pub(crate) flags: Flags,
    /// Processor cycles since reset.
    pub(crate) cycle: u64,
    /// [`Core::run`] returns at the first instruction boundary at or after this cycle.
    pub(crate) next_event: u64,
    pub(crate) instructions: u64,
    /// Lowest stack pointer seen.
    pub(crate) lowest_sp: u16,
    pub(crate) ram_start: u16,
    pub(crate) ram_bytes: u16,
    /// The part of SRAM that the interpreter accesses by itself: all of it, unless a debugger
    /// watches some of it.
    pub(crate) window_start: u16,
    pub(crate) window_bytes: u16,
    /// Word addresses of breakpoints.
    breakpoints: BTreeSet<u16>,
    /// LPM may have to read fuses or signature: leave it to the machine.
    pub(crate) lpm_in_machine: bool,
}

pub(crate) fn boxed<T: Clone, const LEN: usize>(value: T) -> Box<[T; LEN]> {
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
            flash_stamp: FlashStamp::new(),
            pc: 0,
            sp: ram_start + (ram_bytes - 1),
            flags: Flags::from_sreg(0),
            cycle: 0,
            next_event: 0,
            instructions: 0,
            lowest_sp: ram_start + (ram_bytes - 1),
            ram_start,
            ram_bytes,
            window_start: ram_start,
            window_bytes: ram_bytes,
            breakpoints: BTreeSet::new(),
            lpm_in_machine: false,
        };
        core.decode_words(0, flash_words);
        core
    }

    /// Registers, SP and SREG as after a reset; memory and counters stay.
    pub(crate) fn reset(&mut self) {
        self.pc = 0;
        self.flags = Flags::from_sreg(0);
        self.sp = self.ram_start + (self.ram_bytes - 1);
        self.data[0x20..0x100].fill(0);
    }

    /// Writes flash words and decodes them, and the two before them (skip distance, pairs).
    pub(crate) fn write_flash(&mut self, word_address: usize, words: &[u16]) {
        let mask = self.flash.len() - 1;
        for (i, &word) in words.iter().enumerate() {
            self.flash[(word_address + i) & mask] = word;
        }
        self.decode_words(word_address.wrapping_sub(2), words.len() + 2);
    }

    fn decode_words(&mut self, first: usize, count: usize) {
        self.flash_stamp = FlashStamp::new();
        let mask = self.flash.len() - 1;
        // Backwards, so that the instruction behind is known.
        for i in (0..count).rev() {
            let pc = first.wrapping_add(i) & mask;
            let mut op = decode(&self.flash, pc);
            let behind = pc + 1 + usize::from(is_two_words(self.flash[pc]));
            op.code = fuse(op.code, unfuse(self.ops[behind].code));
            if self.breakpoints.contains(&(pc as u16)) {
                op.code = Code::Breakpoint;
            }
            self.ops[pc] = op;
        }
    }

    /// Sets or removes a breakpoint: a code in the place of the instruction's own, so that it
    /// costs nothing until it is reached. No pair is fused across it.
    pub(crate) fn set_breakpoint(&mut self, word_address: u16, is_set: bool) {
        let pc = word_address & self.pc_mask();
        if is_set {
            self.breakpoints.insert(pc);
        } else {
            self.breakpoints.remove(&pc);
        }
        self.decode_words(usize::from(pc).wrapping_sub(2), 3);
    }

    /// Removes all breakpoints.
    pub(crate) fn clear_breakpoints(&mut self) {
        while let Some(pc) = self.breakpoints.first().copied() {
            self.set_breakpoint(pc, false);
        }
    }

    /// Whether the program counter stands at a breakpoint.
    pub(crate) fn is_at_breakpoint(&self) -> bool {
        self.ops[self.pc as usize].code == Code::Breakpoint
    }

    /// Executes the instruction that a breakpoint hides, unless it needs the machine.
    pub(crate) fn run_past_breakpoint(&mut self) -> Exit {
        let at = usize::from(self.pc);
        let plain = self.op();
        let hidden = std::mem::replace(&mut self.ops[at], plain);
        self.next_event = self.cycle + 1;
        let exit = self.run();
        self.ops[at] = hidden;
        exit
    }

    /// The predecoded instruction at the program counter.
    #[inline]
    pub(crate) fn op(&self) -> Op {
        self.op_at(self.pc)
    }

    /// Word addresses wrap with this mask.
    pub fn pc_mask(&self) -> u16 {
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
}

/// What an [`crate::engine::Engine`] may ask of the core.
impl Core {
    /// Where translated code finds the state.
    pub const LAYOUT: Layout = Layout {
        pc: offset_of!(Core, pc),
        sp: offset_of!(Core, sp),
        carry: offset_of!(Core, flags.c),
        zero: offset_of!(Core, flags.z),
        signs: offset_of!(Core, flags.nv),
        half: offset_of!(Core, flags.h),
        enables: offset_of!(Core, flags.ti),
        cycle: offset_of!(Core, cycle),
        next_event: offset_of!(Core, next_event),
        instructions: offset_of!(Core, instructions),
        lowest_sp: offset_of!(Core, lowest_sp),
        lpm_in_machine: offset_of!(Core, lpm_in_machine),
    };

    /// The predecoded instruction at a word address, never a pair.
    #[inline]
    pub fn op_at(&self, pc: u16) -> Op {
        let op = self.ops[usize::from(pc)];
        match op.code {
            Code::Breakpoint => decode(&self.flash, usize::from(pc)),
            code => Op {
                code: unfuse(code),
                ..op
            },
        }
    }

    /// Word address of the next instruction.
    pub fn pc(&self) -> u16 {
        self.pc
    }

    /// Program memory as words, a power of two of them.
    pub fn flash(&self) -> &[u16] {
        &self.flash
    }

    /// A number that changes whenever program memory is written, and is the same only for clones
    /// with the same program memory.
    pub fn flash_stamp(&self) -> u64 {
        self.flash_stamp.0
    }

    /// Data space of 64 KiB, of which general registers (from 0) and SRAM are kept here.
    pub fn data_mut(&mut self) -> &mut [u8; 0x1_0000] {
        &mut self.data
    }

    /// Whether a debugger has set traps, which only the interpreter springs.
    pub fn has_traps(&self) -> bool {
        self.window_bytes != self.ram_bytes || !self.breakpoints.is_empty()
    }

    /// Whether the next event is due.
    pub fn is_due(&self) -> bool {
        self.cycle >= self.next_event
    }

    /// First data address of the SRAM and its size in bytes.
    pub fn ram(&self) -> (u16, u16) {
        (self.ram_start, self.ram_bytes)
    }
}

#[inline(always)]
pub(crate) fn pair(data: &[u8; DATA], register: u8) -> u16 {
    u16::from_le_bytes([data[register as usize], data[register as usize + 1]])
}

#[inline(always)]
pub(crate) fn set_pair(data: &mut [u8; DATA], register: u8, value: u16) {
    let [low, high] = value.to_le_bytes();
    data[register as usize] = low;
    data[register as usize + 1] = high;
}

#[inline(always)]
pub(crate) fn push_pc(data: &mut [u8; DATA], sp: &mut u16, pc: u16) {
    let [low, high] = pc.to_le_bytes();
    data[*sp as usize] = low;
    data[sp.wrapping_sub(1) as usize] = high;
    *sp = sp.wrapping_sub(2);
}

#[inline(always)]
pub(crate) fn pop_pc(data: &[u8; DATA], sp: &mut u16) -> u16 {
    let high = data[sp.wrapping_add(1) as usize];
    let low = data[sp.wrapping_add(2) as usize];
    *sp = sp.wrapping_add(2);
    u16::from_le_bytes([low, high])
}

#[inline(always)]
pub(crate) fn flash_byte(flash: &[u16], z: u16) -> u8 {
    let word = flash[usize::from(z >> 1) & (flash.len() - 1)];
    word.to_le_bytes()[usize::from(z & 1)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Any word, often one that depends on its neighbours: LDS, STS, JMP, ADD, ADC, SBRC.
    fn word() -> impl Strategy<Value = u16> {
        let related = vec![0x9000, 0x9000, 0x9200, 0x940C, 0x0C00, 0x1C00, 0xFC00];
        prop_oneof![any::<u16>(), prop::sample::select(related)]
    }

    proptest! {
        #[test]
        fn flash_written_in_pieces_is_decoded_as_if_written_at_once(
            words in prop::collection::vec(word(), 64),
            pieces in prop::collection::vec((0usize..64, 1usize..9), 1..40),
        ) {
            let mut whole = Core::new(64, 0x100, 0x100);
            whole.write_flash(0, &words);
            let mut patched = Core::new(64, 0x100, 0x100);
            // Something else first, then pieces in any order, then what they left out.
            patched.write_flash(0, &[0x900F; 64]);
            for (start, length) in pieces {
                let end = (start + length).min(64);
                patched.write_flash(start, &words[start..end]);
            }
            for i in 0..64 {
                patched.write_flash(i, &words[i..=i]);
            }
            prop_assert_eq!(&whole.ops[..64], &patched.ops[..64]);
        }

        #[test]
        fn breakpoints_leave_no_trace_whatever_is_written_meanwhile(
            words in prop::collection::vec(word(), 64),
            changes in prop::collection::vec((0usize..64, prop::option::of(word())), 1..40),
        ) {
            let mut plain = Core::new(64, 0x100, 0x100);
            plain.write_flash(0, &words);
            let mut debugged = plain.clone();
            for (at, change) in changes {
                match change {
                    Some(word) => {
                        plain.write_flash(at, &[word]);
                        debugged.write_flash(at, &[word]);
                    }
                    None => {
                        let is_set = !debugged.breakpoints.contains(&(at as u16));
                        debugged.set_breakpoint(at as u16, is_set);
                    }
                }
                for pc in 0..64 {
                    debugged.pc = pc;
                    plain.pc = pc;
                    prop_assert_eq!(debugged.op(), plain.op());
                    let is_set = debugged.breakpoints.contains(&pc);
                    prop_assert_eq!(debugged.is_at_breakpoint(), is_set);
                }
            }
            debugged.clear_breakpoints();
            prop_assert_eq!(&plain.ops[..64], &debugged.ops[..64]);
        }
    }
}
