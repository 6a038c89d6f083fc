//! Decoder of the AVRe+ instruction set: one flash word to one predecoded [`Op`].
//!
//! Source: AVR Instruction Set Manual DS40002198. The decoder runs once per flash word when an
//! image is loaded (and again for a page that SPM changes), so that execution never looks at
//! opcode bits. Relative targets, skip distances and bit masks are worked out here.

/// Operation of a predecoded instruction. Operand fields are those of [`Op`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs, reason = "the names are the mnemonics of the manual")]
pub enum Code {
    Nop,
    Movw,
    Mul,
    Muls,
    Mulsu,
    Fmul,
    Fmuls,
    Fmulsu,
    Cpc,
    Sbc,
    Add,
    Cpse,
    Cp,
    Sub,
    Adc,
    And,
    Eor,
    Or,
    Mov,
    Cpi,
    Sbci,
    Subi,
    Ori,
    Andi,
    Ldi,
    /// Load `d` from pointer `r` + displacement `n`.
    Ldd,
    LdInc,
    LdDec,
    Std,
    StInc,
    StDec,
    /// Load `d` from data address `k`.
    Lds,
    Sts,
    /// Load `d` from program memory at Z.
    Lpm,
    LpmInc,
    Push,
    Pop,
    Com,
    Neg,
    Swap,
    Inc,
    Dec,
    Asr,
    Lsr,
    Ror,
    /// Set the status bits of mask `r` (not I).
    Bset,
    /// Clear the status bits of mask `r` (I included).
    Bclr,
    Ret,
    Ijmp,
    Icall,
    Adiw,
    Sbiw,
    InSreg,
    OutSreg,
    InSpl,
    InSph,
    OutSpl,
    OutSph,
    /// Jump to word address `k` in `n` cycles.
    Jump,
    /// Call word address `k` in `n` cycles; the instruction has `r` words.
    Call,
    /// Branch to `k` on C, Z, N, S set or clear.
    Brcs,
    Brcc,
    Breq,
    Brne,
    Brmi,
    Brpl,
    Brlt,
    Brge,
    /// Branch to `k` if the status bit of mask `r` is set or clear (V, H, T, I).
    Brbs,
    Brbc,
    /// Clear bit mask `r` of register `d`, then put T there.
    Bld,
    Bst,
    /// Skip `n` words if no bit of mask `r` of register `d` is set.
    Sbrc,
    Sbrs,
    // --- two instructions dispatched together, see `crate::fusion`; the fields are those of the first ---
    AddAdc,
    AdcAdc,
    SubSbc,
    SbcSbc,
    SubiSbci,
    SbciSbci,
    CpCpc,
    CpcCpc,
    RorRor,
    AsrRor,
    LsrRor,
    EorEor,
    MovwMovw,
    LdiLdi,
    LddLdd,
    StdStd,
    LdsLds,
    StsSts,
    PushPush,
    PopPop,
    DecBrne,
    DecBrpl,
    SbiwBrne,
    CpiBreq,
    CpiBrne,
    CpcBrne,
    CpcBreq,
    CpcBrcs,
    CpcBrcc,
    MulAdd,
    MulMovw,
    MovwMul,
    MovMov,
    // --- from here on the instruction needs the machine around the core ---
    Sei,
    Reti,
    Sleep,
    Break,
    Wdr,
    Spm,
    /// I/O access at data address `k`.
    In,
    Out,
    Sbi,
    Cbi,
    Sbic,
    Sbis,
    /// A jump to itself (word address `k`, `n` cycles).
    JumpSelf,
    /// A debugger wants the program to halt before the instruction here (see `crate::traps`).
    Breakpoint,
    /// Beyond the last flash word: the program counter wraps, at no cost.
    Wrap,
    /// Not an instruction of this core.
    Invalid,
}

/// One predecoded instruction. The meaning of the fields depends on `code`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(align(8))]
pub struct Op {
    /// Operation.
    pub code: Code,
    /// Destination register (or source of a store).
    pub d: u8,
    /// Source register, immediate, pointer register or bit mask.
    pub r: u8,
    /// Displacement, cycles or number of words to skip.
    pub n: u8,
    /// Absolute word target or data address.
    pub k: u16,
}

const X: u8 = 26;
const Y: u8 = 28;
const Z: u8 = 30;

impl Op {
    const fn new(code: Code, d: u8, r: u8, n: u8, k: u16) -> Op {
        Op { code, d, r, n, k }
    }

    /// The filler behind the last word of flash.
    pub(crate) const WRAP: Op = Op::new(Code::Wrap, 0, 0, 0, 0);
}

/// Whether `word` starts a two-word instruction (LDS, STS, JMP, CALL).
pub(crate) const fn is_two_words(word: u16) -> bool {
    word & 0xFC0F == 0x9000 || word & 0xFE0C == 0x940C
}

/// Decodes the instruction at word address `pc` of `flash` (a power of two of words).
pub(crate) fn decode(flash: &[u16], pc: usize) -> Op {
    let mask = flash.len() - 1;
    let word = flash[pc & mask];
    let next = flash[(pc + 1) & mask];
    let here = Site {
        pc: pc as u16,
        mask: mask as u16,
        next,
    };
    match word >> 12 {
        0x0 => decode_low(word, here),
        0x1..=0x2 => decode_register_pair(word, here),
        0x3 => immediate(Code::Cpi, word),
        0x4 => immediate(Code::Sbci, word),
        0x5 => immediate(Code::Subi, word),
        0x6 => immediate(Code::Ori, word),
        0x7 => immediate(Code::Andi, word),
        0x8 | 0xA => decode_displacement(word),
        0x9 => decode_nine(word, here),
        0xB => decode_in_out(word),
        0xC | 0xD => decode_relative(word, here),
        0xE => immediate(Code::Ldi, word),
        _ => decode_branches(word, here),
    }
}

/// Where the instruction stands and the word behind it.
#[derive(Clone, Copy)]
struct Site {
    pc: u16,
    mask: u16,
    next: u16,
}

impl Site {
    /// Words that a skip here steps over.
    fn skip(self) -> u8 {
        1 + u8::from(is_two_words(self.next))
    }

    fn relative(self, offset: u16) -> u16 {
        self.pc.wrapping_add(1).wrapping_add(offset) & self.mask
    }
}

fn reg_d(word: u16) -> u8 {
    (word >> 4 & 31) as u8
}

fn reg_r(word: u16) -> u8 {
    (word & 15 | word >> 5 & 16) as u8
}

fn immediate(code: Code, word: u16) -> Op {
    let value = (word >> 4 & 0xF0 | word & 15) as u8;
    Op::new(code, 16 + (word >> 4 & 15) as u8, value, 0, 0)
}

fn decode_low(word: u16, here: Site) -> Op {
    let (d, r) = (reg_d(word), reg_r(word));
    let (d16, r16) = (16 + (d & 7), 16 + (r & 7));
    match word >> 8 {
        0x00 if word == 0 => Op::new(Code::Nop, 0, 0, 0, 0),
        0x01 => Op::new(Code::Movw, (d & 15) * 2, (r & 15) * 2, 0, 0),
        0x02 => Op::new(Code::Muls, 16 + (d & 15), 16 + (r & 15), 0, 0),
        0x03 => {
            let code = match word & 0x88 {
                0x00 => Code::Mulsu,
                0x08 => Code::Fmul,
                0x80 => Code::Fmuls,
                _ => Code::Fmulsu,
            };
            Op::new(code, d16, r16, 0, 0)
        }
        0x00 => invalid(),
        _ => decode_register_pair(word, here),
    }
}

fn decode_register_pair(word: u16, here: Site) -> Op {
    let code = match word >> 10 {
        1 => Code::Cpc,
        2 => Code::Sbc,
        3 => Code::Add,
        4 => Code::Cpse,
        5 => Code::Cp,
        6 => Code::Sub,
        7 => Code::Adc,
        8 => Code::And,
        9 => Code::Eor,
        10 => Code::Or,
        _ => Code::Mov,
    };
    Op::new(code, reg_d(word), reg_r(word), here.skip(), 0)
}

fn decode_displacement(word: u16) -> Op {
    let q = (word >> 8 & 0x20 | word >> 7 & 0x18 | word & 7) as u8;
    let pointer = if word & 8 != 0 { Y } else { Z };
    let code = if word & 0x200 != 0 {
        Code::Std
    } else {
        Code::Ldd
    };
    Op::new(code, reg_d(word), pointer, q, 0)
}

fn decode_in_out(word: u16) -> Op {
    let address = 0x20 + (word >> 5 & 0x30 | word & 15);
    let code = match (word & 0x800 != 0, address) {
        (false, 0x5D) => Code::InSpl,
        (false, 0x5E) => Code::InSph,
        (false, 0x5F) => Code::InSreg,
        (false, _) => Code::In,
        (true, 0x5D) => Code::OutSpl,
        (true, 0x5E) => Code::OutSph,
        (true, 0x5F) => Code::OutSreg,
        (true, _) => Code::Out,
    };
    Op::new(code, reg_d(word), 0, 0, address)
}

fn decode_relative(word: u16, here: Site) -> Op {
    let offset = (word & 0xFFF) | if word & 0x800 != 0 { 0xF000 } else { 0 };
    let target = here.relative(offset);
    if word & 0x1000 != 0 {
        return Op::new(Code::Call, 0, 1, 3, target);
    }
    jump(here, target, 2)
}

fn jump(here: Site, target: u16, cycles: u8) -> Op {
    let code = if target == here.pc {
        Code::JumpSelf
    } else {
        Code::Jump
    };
    Op::new(code, 0, 0, cycles, target)
}

fn decode_branches(word: u16, here: Site) -> Op {
    let mask = 1u8 << (word & 7);
    if word & 0x800 == 0 {
        let offset = (word >> 3 & 0x7F) | if word & 0x200 != 0 { 0xFF80 } else { 0 };
        let code = match (word & 7, word & 0x400 == 0) {
            (0, true) => Code::Brcs,
            (0, false) => Code::Brcc,
            (1, true) => Code::Breq,
            (1, false) => Code::Brne,
            (2, true) => Code::Brmi,
            (2, false) => Code::Brpl,
            (4, true) => Code::Brlt,
            (4, false) => Code::Brge,
            (_, true) => Code::Brbs,
            (_, false) => Code::Brbc,
        };
        return Op::new(code, 0, mask, 0, here.relative(offset));
    }
    if word & 8 != 0 {
        return invalid();
    }
    let code = match word >> 9 & 3 {
        0 => Code::Bld,
        1 => Code::Bst,
        2 => Code::Sbrc,
        _ => Code::Sbrs,
    };
    Op::new(code, reg_d(word), mask, here.skip(), 0)
}

fn decode_nine(word: u16, here: Site) -> Op {
    match word >> 8 & 15 {
        0x0 | 0x1 => decode_load(word, here),
        0x2 | 0x3 => decode_store(word, here),
        0x4 | 0x5 => decode_single(word, here),
        0x6 => word_immediate(Code::Adiw, word),
        0x7 => word_immediate(Code::Sbiw, word),
        0x8 => io_bit(Code::Cbi, word, here),
        0x9 => io_bit(Code::Sbic, word, here),
        0xA => io_bit(Code::Sbi, word, here),
        0xB => io_bit(Code::Sbis, word, here),
        _ => Op::new(Code::Mul, reg_d(word), reg_r(word), 0, 0),
    }
}

fn word_immediate(code: Code, word: u16) -> Op {
    let value = (word >> 2 & 0x30 | word & 15) as u8;
    Op::new(code, 24 + (word >> 4 & 3) as u8 * 2, value, 0, 0)
}

fn io_bit(code: Code, word: u16, here: Site) -> Op {
    Op::new(
        code,
        0,
        1 << (word & 7),
        here.skip(),
        0x20 + (word >> 3 & 31),
    )
}

fn decode_load(word: u16, here: Site) -> Op {
    let d = reg_d(word);
    match word & 15 {
        0x0 => Op::new(Code::Lds, d, 0, 0, here.next),
        0x1 => Op::new(Code::LdInc, d, Z, 0, 0),
        0x2 => Op::new(Code::LdDec, d, Z, 0, 0),
        0x4 => Op::new(Code::Lpm, d, 0, 0, 0),
        0x5 => Op::new(Code::LpmInc, d, 0, 0, 0),
        0x9 => Op::new(Code::LdInc, d, Y, 0, 0),
        0xA => Op::new(Code::LdDec, d, Y, 0, 0),
        0xC => Op::new(Code::Ldd, d, X, 0, 0),
        0xD => Op::new(Code::LdInc, d, X, 0, 0),
        0xE => Op::new(Code::LdDec, d, X, 0, 0),
        0xF => Op::new(Code::Pop, d, 0, 0, 0),
        _ => invalid(),
    }
}

fn decode_store(word: u16, here: Site) -> Op {
    let d = reg_d(word);
    match word & 15 {
        0x0 => Op::new(Code::Sts, d, 0, 0, here.next),
        0x1 => Op::new(Code::StInc, d, Z, 0, 0),
        0x2 => Op::new(Code::StDec, d, Z, 0, 0),
        0x9 => Op::new(Code::StInc, d, Y, 0, 0),
        0xA => Op::new(Code::StDec, d, Y, 0, 0),
        0xC => Op::new(Code::Std, d, X, 0, 0),
        0xD => Op::new(Code::StInc, d, X, 0, 0),
        0xE => Op::new(Code::StDec, d, X, 0, 0),
        0xF => Op::new(Code::Push, d, 0, 0, 0),
        _ => invalid(),
    }
}

fn decode_single(word: u16, here: Site) -> Op {
    let d = reg_d(word);
    match word & 15 {
        0x0 => Op::new(Code::Com, d, 0, 0, 0),
        0x1 => Op::new(Code::Neg, d, 0, 0, 0),
        0x2 => Op::new(Code::Swap, d, 0, 0, 0),
        0x3 => Op::new(Code::Inc, d, 0, 0, 0),
        0x5 => Op::new(Code::Asr, d, 0, 0, 0),
        0x6 => Op::new(Code::Lsr, d, 0, 0, 0),
        0x7 => Op::new(Code::Ror, d, 0, 0, 0),
        0xA => Op::new(Code::Dec, d, 0, 0, 0),
        0x8 => decode_implied(word),
        0x9 => match word {
            0x9409 => Op::new(Code::Ijmp, 0, 0, 2, 0),
            0x9509 => Op::new(Code::Icall, 0, 0, 3, 0),
            _ => invalid(),
        },
        0xC | 0xD => decode_long_jump(word, here),
        0xE | 0xF => decode_long_call(word, here),
        _ => invalid(),
    }
}

/// JMP and CALL: a 22-bit target, of which this core has as many bits as its flash needs.
/// A target beyond the flash cannot be reached and is kept as an invalid instruction.
fn decode_long_jump(word: u16, here: Site) -> Op {
    match long_target(word, here) {
        Some(target) => jump(here, target, 3),
        None => Op::new(Code::Invalid, 0, 1, 0, here.next),
    }
}

fn decode_long_call(word: u16, here: Site) -> Op {
    match long_target(word, here) {
        Some(target) => Op::new(Code::Call, 0, 2, 4, target),
        None => Op::new(Code::Invalid, 0, 1, 0, here.next),
    }
}

fn long_target(word: u16, here: Site) -> Option<u16> {
    let high = word >> 3 & 0x3E | word & 1;
    (high == 0 && here.next <= here.mask).then_some(here.next)
}

fn decode_implied(word: u16) -> Op {
    let mask = 1u8 << (word >> 4 & 7);
    match word {
        0x9478 => Op::new(Code::Sei, 0, 0, 0, 0),
        0x9408..=0x947F if word & 15 == 8 => Op::new(Code::Bset, 0, mask, 0, 0),
        0x9488..=0x94FF if word & 15 == 8 => Op::new(Code::Bclr, 0, mask, 0, 0),
        0x9508 => Op::new(Code::Ret, 0, 0, 0, 0),
        0x9518 => Op::new(Code::Reti, 0, 0, 0, 0),
        0x9588 => Op::new(Code::Sleep, 0, 0, 0, 0),
        0x9598 => Op::new(Code::Break, 0, 0, 0, 0),
        0x95A8 => Op::new(Code::Wdr, 0, 0, 0, 0),
        0x95C8 => Op::new(Code::Lpm, 0, 0, 0, 0),
        0x95E8 => Op::new(Code::Spm, 0, 0, 0, 0),
        _ => invalid(),
    }
}

/// `r` = 1 marks an instruction that exists but whose target lies outside the flash.
fn invalid() -> Op {
    Op::new(Code::Invalid, 0, 0, 0, 0)
}
