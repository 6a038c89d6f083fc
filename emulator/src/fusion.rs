//! Fusion: two instructions that compiled code often has in a row are dispatched together.
//!
//! The predecoded operation of the first carries a code for both; the second keeps its own, for
//! jumps to it. What is executed, in which order and at which cycle does not change.

use crate::isa::Code;

/// Pairs that compiled code is full of: first, second, both. They were chosen by counting in the
/// programs of the benchmark.
const PAIRS: [(Code, Code, Code); 33] = [
    (Code::Add, Code::Adc, Code::AddAdc),
    (Code::Adc, Code::Adc, Code::AdcAdc),
    (Code::Sub, Code::Sbc, Code::SubSbc),
    (Code::Sbc, Code::Sbc, Code::SbcSbc),
    (Code::Subi, Code::Sbci, Code::SubiSbci),
    (Code::Sbci, Code::Sbci, Code::SbciSbci),
    (Code::Cp, Code::Cpc, Code::CpCpc),
    (Code::Cpc, Code::Cpc, Code::CpcCpc),
    (Code::Ror, Code::Ror, Code::RorRor),
    (Code::Asr, Code::Ror, Code::AsrRor),
    (Code::Lsr, Code::Ror, Code::LsrRor),
    (Code::Eor, Code::Eor, Code::EorEor),
    (Code::Movw, Code::Movw, Code::MovwMovw),
    (Code::Ldi, Code::Ldi, Code::LdiLdi),
    (Code::Ldd, Code::Ldd, Code::LddLdd),
    (Code::Std, Code::Std, Code::StdStd),
    (Code::Lds, Code::Lds, Code::LdsLds),
    (Code::Sts, Code::Sts, Code::StsSts),
    (Code::Push, Code::Push, Code::PushPush),
    (Code::Pop, Code::Pop, Code::PopPop),
    (Code::Dec, Code::Brne, Code::DecBrne),
    (Code::Dec, Code::Brpl, Code::DecBrpl),
    (Code::Sbiw, Code::Brne, Code::SbiwBrne),
    (Code::Cpi, Code::Breq, Code::CpiBreq),
    (Code::Cpi, Code::Brne, Code::CpiBrne),
    (Code::Cpc, Code::Brne, Code::CpcBrne),
    (Code::Cpc, Code::Breq, Code::CpcBreq),
    (Code::Cpc, Code::Brcs, Code::CpcBrcs),
    (Code::Cpc, Code::Brcc, Code::CpcBrcc),
    (Code::Mul, Code::Add, Code::MulAdd),
    (Code::Mul, Code::Movw, Code::MulMovw),
    (Code::Movw, Code::Mul, Code::MovwMul),
    (Code::Mov, Code::Mov, Code::MovMov),
];

/// The code that dispatches `first` and the instruction behind it together, if there is one.
pub(crate) fn fuse(first: Code, second: Code) -> Code {
    let found = PAIRS
        .iter()
        .find(|pair| (pair.0, pair.1) == (first, second));
    found.map_or(first, |pair| pair.2)
}

/// The first instruction of a fused pair; any other code is itself.
pub(crate) fn unfuse(code: Code) -> Code {
    // The codes of the pairs stand in the order of the table.
    let index = (code as usize).checked_sub(Code::AddAdc as usize);
    let found = index.and_then(|index| PAIRS.get(index));
    found.map_or(code, |pair| pair.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_is_taken_apart_into_its_first_instruction() {
        for (first, second, both) in PAIRS {
            assert_eq!(fuse(first, second), both);
            assert_eq!(unfuse(both), first);
        }
        assert_eq!(unfuse(Code::Add), Code::Add);
        assert_eq!(unfuse(Code::Invalid), Code::Invalid);
    }
}
