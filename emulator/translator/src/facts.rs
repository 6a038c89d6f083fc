//! What each operation reads and writes, and what may follow it.

use cardan_emulator::engine::{Code, Op};

/// Sets of state as bits: registers 0 to 31, then flags and stack pointer.
pub(crate) mod bit {
    pub(crate) const REGISTERS: u64 = 0xFFFF_FFFF;
    pub(crate) const CARRY: u64 = 1 << 32;
    pub(crate) const ZERO: u64 = 1 << 33;
    /// N, V and S.
    pub(crate) const SIGNS: u64 = 1 << 34;
    pub(crate) const HALF: u64 = 1 << 35;
    /// T and I.
    pub(crate) const ENABLES: u64 = 1 << 36;
    /// Stack pointer and its lowest value.
    pub(crate) const STACK: u64 = 1 << 37;
    /// The flags of which translated code computes only those that somebody reads.
    pub(crate) const LAZY: u64 = CARRY | ZERO | SIGNS | HALF;
}

use bit::{CARRY, ENABLES, HALF, LAZY, SIGNS, STACK, ZERO};

/// What may follow an operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Follows {
    /// The instruction this many words on.
    Next(u16),
    /// The jump target `k`.
    Jump,
    /// `k` if the branch is taken, which costs a cycle, else the next word.
    Branch,
    /// `n` more words on if the condition holds, which costs as many cycles, else the next word.
    Skip,
    Call,
    Return,
    /// IJMP and ICALL: anything.
    Anywhere,
    /// The machine executes it.
    Machine,
}

pub(crate) fn follows(op: Op) -> Follows {
    match op.code {
        Code::Lds | Code::Sts => Follows::Next(2),
        Code::Jump => Follows::Jump,
        Code::Brcs
        | Code::Brcc
        | Code::Breq
        | Code::Brne
        | Code::Brmi
        | Code::Brpl
        | Code::Brlt
        | Code::Brge
        | Code::Brbs
        | Code::Brbc => Follows::Branch,
        Code::Cpse | Code::Sbrc | Code::Sbrs => Follows::Skip,
        Code::Call => Follows::Call,
        Code::Ret => Follows::Return,
        Code::Ijmp | Code::Icall => Follows::Anywhere,
        code if is_plain(code) => Follows::Next(1),
        _ => Follows::Machine,
    }
}

/// Operations that neither branch nor need the machine and have one word.
fn is_plain(code: Code) -> bool {
    // The order of the operations is that of the decoder: all others come after these.
    (code as u8) < Code::AddAdc as u8 && !matches!(code, Code::Lds | Code::Sts)
}

/// Cycles, not counting those of a taken branch or skip.
pub(crate) fn cycles(op: Op) -> i64 {
    match op.code {
        Code::Jump | Code::Call => i64::from(op.n),
        Code::Ret => 4,
        Code::Icall | Code::Lpm | Code::LpmInc => 3,
        Code::Mul
        | Code::Muls
        | Code::Mulsu
        | Code::Fmul
        | Code::Fmuls
        | Code::Fmulsu
        | Code::Adiw
        | Code::Sbiw
        | Code::Ldd
        | Code::LdInc
        | Code::LdDec
        | Code::Std
        | Code::StInc
        | Code::StDec
        | Code::Lds
        | Code::Sts
        | Code::Push
        | Code::Pop
        | Code::Ijmp => 2,
        _ => 1,
    }
}

/// Registers, as bits.
fn reg(i: u8) -> u64 {
    1 << i
}

fn pair(i: u8) -> u64 {
    3 << i
}

/// What an operation writes.
pub(crate) fn writes(op: Op) -> u64 {
    let d = op.d;
    match op.code {
        Code::Add | Code::Adc | Code::Sub | Code::Sbc | Code::Subi | Code::Sbci | Code::Neg => {
            reg(d) | LAZY
        }
        Code::Cp | Code::Cpc | Code::Cpi => LAZY,
        Code::And | Code::Or | Code::Eor | Code::Andi | Code::Ori | Code::Inc | Code::Dec => {
            reg(d) | ZERO | SIGNS
        }
        Code::Com | Code::Asr | Code::Lsr | Code::Ror => reg(d) | CARRY | ZERO | SIGNS,
        Code::Adiw | Code::Sbiw => pair(d) | CARRY | ZERO | SIGNS,
        Code::Mul | Code::Muls | Code::Mulsu | Code::Fmul | Code::Fmuls | Code::Fmulsu => {
            pair(0) | CARRY | ZERO
        }
        Code::Movw => pair(d),
        Code::Mov | Code::Ldi | Code::Swap | Code::Bld | Code::Ldd | Code::Lds | Code::Lpm => {
            reg(d)
        }
        Code::InSreg | Code::InSpl | Code::InSph => reg(d),
        Code::LdInc | Code::LdDec => reg(d) | pair(op.r),
        Code::StInc | Code::StDec => pair(op.r),
        Code::LpmInc => reg(d) | pair(30),
        Code::Pop => reg(d) | STACK,
        Code::Push | Code::Call | Code::Icall | Code::Ret | Code::OutSpl | Code::OutSph => STACK,
        Code::Bst => ENABLES,
        Code::Bset | Code::Bclr | Code::OutSreg => LAZY | ENABLES,
        _ => 0,
    }
}

/// Which lazy flags an operation reads. One that may leave the translated code reads them all.
pub(crate) fn reads_flags(op: Op, is_checked: bool) -> u64 {
    if is_checked {
        return LAZY;
    }
    match op.code {
        Code::Adc | Code::Ror | Code::Brcs | Code::Brcc => CARRY,
        Code::Sbc | Code::Sbci | Code::Cpc => CARRY | ZERO,
        Code::Breq | Code::Brne => ZERO,
        Code::Brmi | Code::Brpl | Code::Brlt | Code::Brge => SIGNS,
        Code::Brbs | Code::Brbc => SIGNS | HALF,
        Code::Bset | Code::Bclr | Code::InSreg => LAZY,
        _ => 0,
    }
}

/// Whether an operation may leave the translated code because an address or the stack pointer
/// lies outside SRAM, because it sets I, or because LPM may read the signature.
pub(crate) fn is_checked(op: Op) -> bool {
    matches!(
        op.code,
        Code::Ldd
            | Code::LdInc
            | Code::LdDec
            | Code::Std
            | Code::StInc
            | Code::StDec
            | Code::Push
            | Code::Pop
            | Code::Call
            | Code::Icall
            | Code::Ijmp
            | Code::Ret
            | Code::OutSreg
            | Code::Lpm
            | Code::LpmInc
    )
}
