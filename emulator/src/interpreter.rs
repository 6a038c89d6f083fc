//! The interpreter: executes predecoded instructions until the next event is due or until one
//! needs more than the core, an I/O register, sleep, a change of the interrupt enable. It then
//! returns *before* that instruction, and the machine carries it out ([`crate::execute`]). So the
//! loop is small, knows no peripheral and keeps its state in host registers.

use crate::alu::{self, Flags};
use crate::core::{Core, flash_byte, pair, pop_pc, push_pc, set_pair};
use crate::engine::{Arrivals, Exit, Unwatched};
use crate::isa::Code;
use crate::observer::{Moment, Nobody, Observer};

impl Core {
    /// Executes until `next_event` or an instruction that needs the machine.
    pub fn run(&mut self) -> Exit {
        self.run_observed(&mut Unwatched, &mut Nobody)
    }

    /// The same, and asks `arrivals` after each jump, branch taken, call and return, and at each
    /// instruction, whether to return there.
    pub fn run_watched<A: Arrivals>(&mut self, arrivals: &mut A) -> Exit {
        self.run_observed(arrivals, &mut Nobody)
    }

    /// The same, and shows `observer` every instruction before it is executed.
    // One match arm per operation: the table of the instruction set, kept in one place.
    pub(crate) fn run_observed<A: Arrivals, O: Observer>(
        &mut self,
        arrivals: &mut A,
        observer: &mut O,
    ) -> Exit {
        let ops = &*self.ops;
        let data = &mut *self.data;
        let flash = &self.flash[..];
        // Addresses outside the window are left to the machine: I/O, and what a debugger watches.
        let (ram_start, ram_bytes) = (self.window_start, self.window_bytes);
        let (next_event, lpm_in_machine) = (self.next_event, self.lpm_in_machine);
        let (mut pc, mut sp, mut flags) = (self.pc, self.sp, self.flags);
        // Cycles left until the event: counted down, so that the test is part of the subtraction.
        let budget = next_event.saturating_sub(self.cycle).min(i64::MAX as u64) as i64;
        let mut left = budget;
        let mut instructions = self.instructions;
        let mut lowest_sp = self.lowest_sp;

        macro_rules! show {
            ($op:expr) => {{
                if O::IS_WATCHING {
                    observer.instruction(&Moment {
                        pc,
                        code: $op.code,
                        cycle: next_event.wrapping_sub(left as u64),
                        sp,
                        lowest_sp,
                        flags,
                        data,
                    });
                }
            }};
        }
        macro_rules! reg {
            ($i:expr) => {
                data[$i as usize]
            };
        }
        macro_rules! next {
            ($cycles:expr) => {{
                pc = pc.wrapping_add(1);
                left -= $cycles;
            }};
        }
        // An operation with a result for the destination register.
        macro_rules! result {
            ($op:expr, $value:expr) => {{
                reg!($op.d) = $value;
                next!(1);
            }};
        }
        // The instruction just executed has jumped to `pc`.
        macro_rules! arrived {
            () => {{
                if A::IS_WATCHING && arrivals.stops_at(pc) {
                    instructions += 1;
                    break Exit::Arrival;
                }
            }};
        }
        // A branch taken on a condition.
        macro_rules! branch_if {
            ($op:expr, $condition:expr) => {{
                let taken = $condition;
                pc = if taken { $op.k } else { pc.wrapping_add(1) };
                left -= 1 + i64::from(taken);
                if A::IS_WATCHING && taken {
                    arrived!();
                }
            }};
        }
        macro_rules! skip_if {
            ($op:expr, $condition:expr) => {{
                let words = if $condition { u16::from($op.n) } else { 0 };
                pc = pc.wrapping_add(1 + words);
                left -= 1 + i64::from(words);
            }};
        }
        macro_rules! multiply {
            ($product:expr) => {{
                let product: u16 = $product;
                set_pair(data, 0, flags.product(product));
                next!(2);
            }};
        }
        macro_rules! multiply_fractional {
            ($product:expr) => {{
                let product: u16 = $product;
                set_pair(data, 0, flags.fractional(product));
                next!(2);
            }};
        }
        let in_ram = |address: u16| address.wrapping_sub(ram_start) < ram_bytes;
        let fits_call = |sp: u16| in_ram(sp) && in_ram(sp.wrapping_sub(1));
        let pc_mask = (flash.len() - 1) as u16;

        // The instructions that also occur in pairs.
        macro_rules! instruction {
            (Add $op:ident) => {{ result!($op, flags.add(reg!($op.d), reg!($op.r))) }};
            (Adc $op:ident) => {{ result!($op, flags.adc(reg!($op.d), reg!($op.r))) }};
            (Sub $op:ident) => {{ result!($op, flags.sub(reg!($op.d), reg!($op.r))) }};
            (Sbc $op:ident) => {{ result!($op, flags.sbc(reg!($op.d), reg!($op.r))) }};
            (Subi $op:ident) => {{ result!($op, flags.sub(reg!($op.d), $op.r)) }};
            (Sbci $op:ident) => {{ result!($op, flags.sbc(reg!($op.d), $op.r)) }};
            (Cp $op:ident) => {{
                flags.sub(reg!($op.d), reg!($op.r));
                next!(1);
            }};
            (Cpc $op:ident) => {{
                flags.sbc(reg!($op.d), reg!($op.r));
                next!(1);
            }};
            (Cpi $op:ident) => {{
                flags.sub(reg!($op.d), $op.r);
                next!(1);
            }};
            (Eor $op:ident) => {{ result!($op, flags.logic(reg!($op.d) ^ reg!($op.r))) }};
            (Movw $op:ident) => {{
                let value = pair(data, $op.r);
                set_pair(data, $op.d, value);
                next!(1);
            }};
            (Ldi $op:ident) => {{
                reg!($op.d) = $op.r;
                next!(1);
            }};
            (Asr $op:ident) => {{ result!($op, flags.asr(reg!($op.d))) }};
            (Lsr $op:ident) => {{ result!($op, flags.lsr(reg!($op.d))) }};
            (Ror $op:ident) => {{ result!($op, flags.ror(reg!($op.d))) }};
            (Dec $op:ident) => {{ result!($op, flags.dec(reg!($op.d))) }};
            (Sbiw $op:ident) => {{
                let value = flags.sbiw(pair(data, $op.d), $op.r);
                set_pair(data, $op.d, value);
                next!(2);
            }};
            (Brne $op:ident) => {{ branch_if!($op, !flags.is_zero()) }};
            (Breq $op:ident) => {{ branch_if!($op, flags.is_zero()) }};
            (Brcs $op:ident) => {{ branch_if!($op, flags.is_carry()) }};
            (Brcc $op:ident) => {{ branch_if!($op, !flags.is_carry()) }};
            (Brpl $op:ident) => {{ branch_if!($op, !flags.is_negative()) }};
            (Ldd $op:ident) => {{
                let address = pair(data, $op.r).wrapping_add(u16::from($op.n));
                if !in_ram(address) {
                    break Exit::Machine;
                }
                reg!($op.d) = data[address as usize];
                next!(2);
            }};
            (Std $op:ident) => {{
                let address = pair(data, $op.r).wrapping_add(u16::from($op.n));
                if !in_ram(address) {
                    break Exit::Machine;
                }
                data[address as usize] = reg!($op.d);
                next!(2);
            }};
            (Lds $op:ident) => {{
                if !in_ram($op.k) {
                    break Exit::Machine;
                }
                reg!($op.d) = data[$op.k as usize];
                pc = pc.wrapping_add(2);
                left -= 2;
            }};
            (Sts $op:ident) => {{
                if !in_ram($op.k) {
                    break Exit::Machine;
                }
                data[$op.k as usize] = reg!($op.d);
                pc = pc.wrapping_add(2);
                left -= 2;
            }};
            (Push $op:ident) => {{
                if !in_ram(sp) {
                    break Exit::Machine;
                }
                data[sp as usize] = reg!($op.d);
                sp = sp.wrapping_sub(1);
                lowest_sp = lowest_sp.min(sp);
                next!(2);
            }};
            (Pop $op:ident) => {{
                let top = sp.wrapping_add(1);
                if !in_ram(top) {
                    break Exit::Machine;
                }
                sp = top;
                reg!($op.d) = data[sp as usize];
                next!(2);
            }};
            (Mul $op:ident) => {{ multiply!(u16::from(reg!($op.d)) * u16::from(reg!($op.r))) }};
            (Mov $op:ident) => {{
                reg!($op.d) = reg!($op.r);
                next!(1);
            }};
        }
        // Two instructions that often follow each other, dispatched once. The event is looked for
        // in between all the same.
        macro_rules! pair {
            ($first:ident $second:ident $op:ident) => {{
                instruction!($first $op);
                instructions += 1;
                if left <= 0 {
                    break Exit::Event;
                }
                let second = ops[pc as usize];
                show!(second);
                instruction!($second second);
            }};
        }

        let exit = loop {
            if left <= 0 {
                break Exit::Event;
            }
            if A::IS_WATCHING && arrivals.is_known(pc) && instructions != self.instructions {
                break Exit::Arrival;
            }
            let op = ops[pc as usize];
            show!(op);
            match op.code {
                Code::Nop => next!(1),
                Code::Movw => instruction!(Movw op),
                Code::Mul => instruction!(Mul op),
                Code::Muls => multiply!(signed(reg!(op.d)).wrapping_mul(signed(reg!(op.r)))),
                Code::Mulsu => multiply!(signed(reg!(op.d)).wrapping_mul(u16::from(reg!(op.r)))),
                Code::Fmul => multiply_fractional!(u16::from(reg!(op.d)) * u16::from(reg!(op.r))),
                Code::Fmuls => {
                    multiply_fractional!(signed(reg!(op.d)).wrapping_mul(signed(reg!(op.r))));
                }
                Code::Fmulsu => {
                    multiply_fractional!(signed(reg!(op.d)).wrapping_mul(u16::from(reg!(op.r))));
                }
                Code::Add => instruction!(Add op),
                Code::Adc => instruction!(Adc op),
                Code::Sub => instruction!(Sub op),
                Code::Sbc => instruction!(Sbc op),
                Code::Subi => instruction!(Subi op),
                Code::Sbci => instruction!(Sbci op),
                Code::Cp => instruction!(Cp op),
                Code::Cpc => instruction!(Cpc op),
                Code::Cpi => instruction!(Cpi op),
                Code::And => result!(op, flags.logic(reg!(op.d) & reg!(op.r))),
                Code::Or => result!(op, flags.logic(reg!(op.d) | reg!(op.r))),
                Code::Eor => instruction!(Eor op),
                Code::Andi => result!(op, flags.logic(reg!(op.d) & op.r)),
                Code::Ori => result!(op, flags.logic(reg!(op.d) | op.r)),
                Code::Mov => instruction!(Mov op),
                Code::Ldi => instruction!(Ldi op),
                Code::Com => result!(op, flags.com(reg!(op.d))),
                Code::Neg => result!(op, flags.neg(reg!(op.d))),
                Code::Inc => result!(op, flags.inc(reg!(op.d))),
                Code::Dec => instruction!(Dec op),
                Code::Asr => instruction!(Asr op),
                Code::Lsr => instruction!(Lsr op),
                Code::Ror => instruction!(Ror op),
                Code::Swap => {
                    reg!(op.d) = reg!(op.d).rotate_left(4);
                    next!(1);
                }
                Code::Adiw => {
                    let value = flags.adiw(pair(data, op.d), op.r);
                    set_pair(data, op.d, value);
                    next!(2);
                }
                Code::Sbiw => instruction!(Sbiw op),
                Code::Bset => {
                    match op.r {
                        alu::T => flags.set_t(true),
                        mask => flags = Flags::from_sreg(flags.sreg() | mask),
                    }
                    next!(1);
                }
                Code::Bclr => {
                    match op.r {
                        alu::T => flags.set_t(false),
                        alu::I => flags.enable_interrupts(false),
                        mask => flags = Flags::from_sreg(flags.sreg() & !mask),
                    }
                    next!(1);
                }
                Code::Bld => {
                    let bit = if flags.t() { op.r } else { 0 };
                    reg!(op.d) = reg!(op.d) & !op.r | bit;
                    next!(1);
                }
                Code::Bst => {
                    flags.set_t(reg!(op.d) & op.r != 0);
                    next!(1);
                }
                Code::Brcs => instruction!(Brcs op),
                Code::Brcc => instruction!(Brcc op),
                Code::Breq => instruction!(Breq op),
                Code::Brne => instruction!(Brne op),
                Code::Brmi => branch_if!(op, flags.is_negative()),
                Code::Brpl => instruction!(Brpl op),
                Code::Brlt => branch_if!(op, flags.is_less()),
                Code::Brge => branch_if!(op, !flags.is_less()),
                Code::Brbs => branch_if!(op, flags.sreg() & op.r != 0),
                Code::Brbc => branch_if!(op, flags.sreg() & op.r == 0),
                Code::Cpse => skip_if!(op, reg!(op.d) == reg!(op.r)),
                Code::Sbrc => skip_if!(op, reg!(op.d) & op.r == 0),
                Code::Sbrs => skip_if!(op, reg!(op.d) & op.r != 0),
                Code::Jump => {
                    pc = op.k;
                    left -= i64::from(op.n);
                    arrived!();
                }
                Code::Ijmp => {
                    let target = pair(data, 30);
                    if target > pc_mask {
                        break Exit::Machine;
                    }
                    pc = target;
                    left -= 2;
                    arrived!();
                }
                Code::Call => {
                    if !fits_call(sp) {
                        break Exit::Machine;
                    }
                    push_pc(data, &mut sp, pc.wrapping_add(u16::from(op.r)) & pc_mask);
                    lowest_sp = lowest_sp.min(sp);
                    pc = op.k;
                    left -= i64::from(op.n);
                    arrived!();
                }
                Code::Icall => {
                    let target = pair(data, 30);
                    if !fits_call(sp) || target > pc_mask {
                        break Exit::Machine;
                    }
                    push_pc(data, &mut sp, pc.wrapping_add(1) & pc_mask);
                    lowest_sp = lowest_sp.min(sp);
                    pc = target;
                    left -= 3;
                    arrived!();
                }
                Code::Ret => {
                    let bottom = sp.wrapping_add(1);
                    if !in_ram(bottom) || !in_ram(bottom.wrapping_add(1)) {
                        break Exit::Machine;
                    }
                    let mut after = sp;
                    let target = pop_pc(data, &mut after);
                    if target > pc_mask {
                        break Exit::Machine;
                    }
                    sp = after;
                    pc = target;
                    left -= 4;
                    arrived!();
                }
                Code::Push => instruction!(Push op),
                Code::Pop => instruction!(Pop op),
                Code::Lds => instruction!(Lds op),
                Code::Sts => instruction!(Sts op),
                Code::Ldd => instruction!(Ldd op),
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
                Code::Std => instruction!(Std op),
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
                    reg!(op.d) = flags.sreg();
                    next!(1);
                }
                Code::OutSreg => {
                    let value = reg!(op.d);
                    if value & alu::I != 0 && !flags.interrupts_enabled() {
                        break Exit::Machine;
                    }
                    flags = Flags::from_sreg(value);
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
                Code::AddAdc => pair!(Add Adc op),
                Code::AdcAdc => pair!(Adc Adc op),
                Code::SubSbc => pair!(Sub Sbc op),
                Code::SbcSbc => pair!(Sbc Sbc op),
                Code::SubiSbci => pair!(Subi Sbci op),
                Code::SbciSbci => pair!(Sbci Sbci op),
                Code::CpCpc => pair!(Cp Cpc op),
                Code::CpcCpc => pair!(Cpc Cpc op),
                Code::RorRor => pair!(Ror Ror op),
                Code::AsrRor => pair!(Asr Ror op),
                Code::LsrRor => pair!(Lsr Ror op),
                Code::EorEor => pair!(Eor Eor op),
                Code::MovwMovw => pair!(Movw Movw op),
                Code::LdiLdi => pair!(Ldi Ldi op),
                Code::LddLdd => pair!(Ldd Ldd op),
                Code::StdStd => pair!(Std Std op),
                Code::LdsLds => pair!(Lds Lds op),
                Code::StsSts => pair!(Sts Sts op),
                Code::PushPush => pair!(Push Push op),
                Code::PopPop => pair!(Pop Pop op),
                Code::DecBrne => pair!(Dec Brne op),
                Code::DecBrpl => pair!(Dec Brpl op),
                Code::SbiwBrne => pair!(Sbiw Brne op),
                Code::CpiBreq => pair!(Cpi Breq op),
                Code::CpiBrne => pair!(Cpi Brne op),
                Code::CpcBrne => pair!(Cpc Brne op),
                Code::CpcBreq => pair!(Cpc Breq op),
                Code::CpcBrcs => pair!(Cpc Brcs op),
                Code::CpcBrcc => pair!(Cpc Brcc op),
                Code::MulAdd => pair!(Mul Add op),
                Code::MulMovw => pair!(Mul Movw op),
                Code::MovwMul => pair!(Movw Mul op),
                Code::MovMov => pair!(Mov Mov op),
                Code::Wrap => {
                    // Only the fall-through from the last word comes here; it costs nothing.
                    pc &= pc_mask;
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
                | Code::Breakpoint
                | Code::Invalid => break Exit::Machine,
            }
            instructions += 1;
        };
        self.pc = pc;
        self.sp = sp;
        self.flags = flags;
        self.cycle += (budget - left) as u64;
        self.instructions = instructions;
        self.lowest_sp = lowest_sp;
        exit
    }
}

/// A register as a sign-extended 16-bit factor.
#[inline(always)]
fn signed(value: u8) -> u16 {
    value as i8 as i16 as u16
}
