//! Disassembler, in the spelling of GNU objdump.

use crate::isa::{Code, Op, decode, is_two_words};

const POINTERS: [&str; 3] = ["X", "Y", "Z"];
const SET: [&str; 8] = ["sec", "sez", "sen", "sev", "ses", "seh", "set", "sei"];
const CLEAR: [&str; 8] = ["clc", "clz", "cln", "clv", "cls", "clh", "clt", "cli"];
const BRANCH_SET: [&str; 8] = [
    "brcs", "breq", "brmi", "brvs", "brlt", "brhs", "brts", "brie",
];
const BRANCH_CLEAR: [&str; 8] = [
    "brcc", "brne", "brpl", "brvc", "brge", "brhc", "brtc", "brid",
];

/// Disassembles the instruction that starts with `words[0]`. `words[1]`, if given, is the second
/// word of a two-word instruction. Relative targets are shown as `.+n` and `.-n`.
///
/// ```
/// assert_eq!(cardan_emulator::disassemble(&[0x940C, 0x0034]), "jmp 0x68");
/// assert_eq!(cardan_emulator::disassemble(&[0xCFFF]), "rjmp .-2");
/// ```
pub fn disassemble(words: &[u16]) -> String {
    let Some(&word) = words.first() else {
        return String::new();
    };
    let second = words.get(1).copied().unwrap_or(0);
    // A whole address space around the instruction, so that every relative target is valid.
    let mut flash = vec![0u16; 0x1_0000];
    flash[HOME as usize] = word;
    flash[HOME as usize + 1] = second;
    let op = decode(&flash, HOME as usize);
    text(op, word, second)
}

/// Where the instruction stands in the scratch flash.
const HOME: u16 = 0x4000;

fn text(op: Op, word: u16, second: u16) -> String {
    let Op { d, r, k, n, .. } = op;
    let bit = if r == 0 {
        0
    } else {
        r.trailing_zeros() as usize
    };
    let pointer = POINTERS[usize::from(r.clamp(26, 30) - 26) / 2];
    let register_pair = |name: &str| format!("{name} r{d}, r{r}");
    let constant = |name: &str| format!("{name} r{d}, {r:#04x}");
    let single = |name: &str| format!("{name} r{d}");
    let io = k.wrapping_sub(0x20);
    match op.code {
        Code::Movw => register_pair("movw"),
        Code::Mul => register_pair("mul"),
        Code::Muls => register_pair("muls"),
        Code::Mulsu => register_pair("mulsu"),
        Code::Fmul => register_pair("fmul"),
        Code::Fmuls => register_pair("fmuls"),
        Code::Fmulsu => register_pair("fmulsu"),
        Code::Cpc => register_pair("cpc"),
        Code::Sbc => register_pair("sbc"),
        Code::Add => register_pair("add"),
        Code::Cpse => register_pair("cpse"),
        Code::Cp => register_pair("cp"),
        Code::Sub => register_pair("sub"),
        Code::Adc => register_pair("adc"),
        Code::And => register_pair("and"),
        Code::Eor => register_pair("eor"),
        Code::Or => register_pair("or"),
        Code::Mov => register_pair("mov"),
        Code::Cpi => constant("cpi"),
        Code::Sbci => constant("sbci"),
        Code::Subi => constant("subi"),
        Code::Ori => constant("ori"),
        Code::Andi => constant("andi"),
        Code::Ldi => constant("ldi"),
        Code::Adiw => constant("adiw"),
        Code::Sbiw => constant("sbiw"),
        Code::Ldd if n == 0 => format!("ld r{d}, {pointer}"),
        Code::Ldd => format!("ldd r{d}, {pointer}+{n}"),
        Code::LdInc => format!("ld r{d}, {pointer}+"),
        Code::LdDec => format!("ld r{d}, -{pointer}"),
        Code::Std if n == 0 => format!("st {pointer}, r{d}"),
        Code::Std => format!("std {pointer}+{n}, r{d}"),
        Code::StInc => format!("st {pointer}+, r{d}"),
        Code::StDec => format!("st -{pointer}, r{d}"),
        Code::Lds => format!("lds r{d}, {k:#06x}"),
        Code::Sts => format!("sts {k:#06x}, r{d}"),
        Code::Lpm if word == 0x95C8 => "lpm".to_owned(),
        Code::Lpm => format!("lpm r{d}, Z"),
        Code::LpmInc => format!("lpm r{d}, Z+"),
        Code::Push => single("push"),
        Code::Pop => single("pop"),
        Code::Com => single("com"),
        Code::Neg => single("neg"),
        Code::Swap => single("swap"),
        Code::Inc => single("inc"),
        Code::Dec => single("dec"),
        Code::Asr => single("asr"),
        Code::Lsr => single("lsr"),
        Code::Ror => single("ror"),
        Code::Bset | Code::Sei => SET[usize::from(word >> 4 & 7)].to_owned(),
        Code::Bclr => CLEAR[usize::from(word >> 4 & 7)].to_owned(),
        Code::Brbs | Code::Brcs | Code::Breq | Code::Brmi | Code::Brlt => {
            format!("{} {}", BRANCH_SET[bit], relative(k))
        }
        Code::Brbc | Code::Brcc | Code::Brne | Code::Brpl | Code::Brge => {
            format!("{} {}", BRANCH_CLEAR[bit], relative(k))
        }
        Code::Bld => format!("bld r{d}, {bit}"),
        Code::Bst => format!("bst r{d}, {bit}"),
        Code::Sbrc => format!("sbrc r{d}, {bit}"),
        Code::Sbrs => format!("sbrs r{d}, {bit}"),
        Code::Sbi => format!("sbi {io:#04x}, {bit}"),
        Code::Cbi => format!("cbi {io:#04x}, {bit}"),
        Code::Sbic => format!("sbic {io:#04x}, {bit}"),
        Code::Sbis => format!("sbis {io:#04x}, {bit}"),
        Code::In | Code::InSreg | Code::InSpl | Code::InSph => format!("in r{d}, {io:#04x}"),
        Code::Out | Code::OutSreg | Code::OutSpl | Code::OutSph => format!("out {io:#04x}, r{d}"),
        Code::Jump | Code::JumpSelf | Code::Call => jump_text(word, second, k),
        Code::Nop => "nop".to_owned(),
        Code::Ret => "ret".to_owned(),
        Code::Reti => "reti".to_owned(),
        Code::Ijmp => "ijmp".to_owned(),
        Code::Icall => "icall".to_owned(),
        Code::Sleep => "sleep".to_owned(),
        Code::Break => "break".to_owned(),
        Code::Wdr => "wdr".to_owned(),
        Code::Spm => "spm".to_owned(),
        Code::Invalid if is_two_words(word) => jump_text(word, second, k),
        _ => format!(".word {word:#06x}"),
    }
}

fn jump_text(word: u16, second: u16, target: u16) -> String {
    match word >> 12 {
        0xC => format!("rjmp {}", relative(target)),
        0xD => format!("rcall {}", relative(target)),
        _ => {
            let name = if word & 2 == 0 { "jmp" } else { "call" };
            let high = u32::from(word >> 3 & 0x3E | word & 1);
            format!("{name} {:#x}", (high << 16 | u32::from(second)) * 2)
        }
    }
}

/// Byte distance from the next instruction to `target`, as objdump writes it.
fn relative(target: u16) -> String {
    let bytes = i32::from(target.wrapping_sub(HOME + 1) as i16) * 2;
    let sign = if bytes < 0 { '-' } else { '+' };
    format!(".{sign}{}", bytes.abs())
}
