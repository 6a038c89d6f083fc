//! The kernels in assembly for AVR with a multiplier: LLVM's 32-bit products, quotients and roots
//! take 2 to 7 times as many cycles there, and they are most of a solution (figures:
//! `docs/design/board.md`). What they compute is defined by, and tested against, `portable.rs`.
//!
//! What is called has arguments and results where the C calling convention has them (r25:r24 and
//! r23:r22, 32 bits in r25:r22), so that a call moves nothing; products are inlined and keep their
//! factors. r1 is 0 before and after. (Not `global_asm`: that is
//! parsed for the oldest AVR, without MUL and MOVW.)
#![allow(
    unsafe_code,
    reason = "assembly: touches its operands and clobbers only, and is total"
)]

use core::arch::asm;

/// Signed product of r21:r20 and r23:r22 into r25:r24:r19:r18; changes r26 (application note AVR201).
macro_rules! product {
    () => {
        "clr r26
        muls r21, r23
        movw r24, r0
        mul r20, r22
        movw r18, r0
        mulsu r21, r22
        sbc r25, r26
        add r19, r0
        adc r24, r1
        adc r25, r26
        mulsu r23, r20
        sbc r25, r26
        add r19, r0
        adc r24, r1
        adc r25, r26
        clr r1
        "
    };
}

/// Twice r25:r24:r19:r18; an overflow goes to label 8 with the sign in C.
macro_rules! double {
    () => {
        "lsl r18
        rol r19
        rol r24
        rol r25
        brvs 8f
        "
    };
}

/// After a sum (`com`) or a difference (nothing): the end of the range if V is set. C is then the sign
/// of the exact sum, and the opposite of the sign of the exact difference.
macro_rules! limit {
    ($complement:literal) => {
        concat!(
            "brvc 2f
        sbc {a:l}, {a:l}
        ",
            $complement,
            "
        mov {a:h}, {a:l}
        lsr {a:h}
        brcs 2f
        sec
        ror {a:h}
    2:
        "
        )
    };
}

/// r25:r24 rounded up if r19 is 128 or more. Label 8 makes 0x7fff, or 0x8000 with C set; a rounding
/// that overflows leaves C clear.
macro_rules! round {
    () => {
        "lsl r19
        adc r24, r1
        adc r25, r1
        brvc 9f
    8:  ldi r24, 0xff
        ldi r25, 0x7f
        adc r24, r1
        adc r25, r1
    9:
        "
    };
}

macro_rules! saturating {
    ($(#[$doc:meta])* $name:ident, $first:literal, $next:literal, $complement:literal) => {
        $(#[$doc])*
        #[inline(always)]
        pub fn $name(a: i16, b: i16) -> i16 {
            let result: i16;
            // SAFETY: see the file's first lines.
            unsafe {
                asm!(
                    concat!($first, " {a:l}, {b:l}\n", $next, " {a:h}, {b:h}\n", limit!($complement)),
                    a = inout(reg_pair) a => result,
                    b = in(reg_pair) b,
                    options(pure, nomem, nostack),
                );
            }
            result
        }
    };
}
saturating! {
    /// a + b limited to 16 bits.
    add16, "add", "adc", "com {a:l}"
}
saturating! {
    /// a - b limited to 16 bits.
    sub16, "sub", "sbc", ""
}

/// -a limited to 16 bits.
#[inline(always)]
pub fn neg16(a: i16) -> i16 {
    sub16(0, a)
}

/// |a| limited to 16 bits.
#[inline(always)]
pub fn abs16(a: i16) -> i16 {
    if a < 0 { sub16(0, a) } else { a }
}

macro_rules! multiply_wide {
    ($(#[$doc:meta])* $name:ident $limit:literal) => {
        $(#[$doc])*
        #[inline(always)]
        pub fn $name(a: i16, b: i16) -> i32 {
            let (low, high): (u16, i16);
            // SAFETY: see the file's first lines.
            unsafe {
                asm!(
                    concat!(product!(), $limit),
                    in("r21r20") a,
                    in("r23r22") b,
                    out("r25r24") high,
                    out("r19r18") low,
                    out("r26") _,
                    options(pure, nomem, nostack),
                );
            }
            i32::from(high) << 16 | i32::from(low)
        }
    };
}
multiply_wide! {
    /// Exact product.
    multiply16 ""
}
multiply_wide! {
    /// Product limited to 31 bits: only that of the two least words needs it.
    multiply31 "cpi r25, 0x40
        brne 2f
        ldi r25, 0x3f
        ldi r24, 0xff
        movw r18, r24
        mov r19, r24
    2:
    "
}

macro_rules! multiply_round {
    ($(#[$doc:meta])* $name:ident $($double:ident)*) => {
        $(#[$doc])*
        #[inline(always)]
        pub fn $name(a: i16, b: i16) -> i16 {
            let result: i16;
            // SAFETY: see the file's first lines.
            unsafe {
                asm!(
                    concat!(product!(), $($double!(),)* round!()),
                    in("r21r20") a,
                    in("r23r22") b,
                    out("r25r24") result,
                    out("r18") _, out("r19") _, out("r26") _,
                    options(pure, nomem, nostack),
                );
            }
            result
        }
    };
}
multiply_round! {
    /// a b / 2^12, to nearest with ties up, limited to 16 bits.
    multiply_round12 double double double double
}
multiply_round! {
    /// a b / 2^13, likewise.
    multiply_round13 double double double
}
multiply_round! {
    /// a b / 2^14, likewise.
    multiply_round14 double double
}
multiply_round! {
    /// a b / 2^15, likewise.
    multiply_round15 double
}
multiply_round! {
    /// a b / 2^16, likewise.
    multiply_round16
}

macro_rules! round_word {
    ($(#[$doc:meta])* $name:ident $($double:ident)*) => {
        $(#[$doc])*
        #[inline(never)]
        pub fn $name(raw: i32) -> i16 {
            let (high, low) = ((raw >> 16) as i16, raw as i16);
            let result: i16;
            // SAFETY: see the file's first lines.
            unsafe {
                asm!(
                    concat!("movw r18, r22\n", $($double!(),)* round!()),
                    inout("r25r24") high => result,
                    in("r23r22") low,
                    out("r18") _, out("r19") _,
                    options(pure, nomem, nostack),
                );
            }
            result
        }
    };
}
round_word! {
    /// raw / 2^14, to nearest with ties up, limited to 16 bits.
    round14 double double
}
round_word! {
    /// raw / 2^15, likewise.
    round15 double
}

/// Magnitudes of r25:r24 and r23:r22, the sign of their quotient into T. The quotient will be
/// collected inverted in r19:r18, since the carry of a comparison is; after 15 bits the 1 is the
/// highest, which inverts to 0.
macro_rules! magnitudes {
    () => {
        "mov r26, r25
        eor r26, r23
        bst r26, 7
        tst r25
        brpl 1f
        com r25
        neg r24
        sbci r25, 0xff
    1:  tst r23
        brpl 2f
        com r23
        neg r22
        sbci r23, 0xff
    2:  ldi r18, 1
        clr r19
        "
    };
}

/// One step of the restoring division.
macro_rules! quotient_bit {
    () => {
        "cp r24, r22
        cpc r25, r23
        brcs 3f
        sub r24, r22
        sbc r25, r23
    3:  rol r18
        rol r19
        "
    };
}

/// 14 further bits, rounding (up in magnitude if twice the rest is at least the divisor; with a
/// negative sign, label 5, if it is more), sign; label 8 is the end of the range.
macro_rules! quotient_rest {
    () => {
        concat!(
            ".rept 14
            lsl r24
            rol r25
            ",
            quotient_bit!(),
            ".endr
            com r18
            com r19
            lsl r24
            rol r25
            brts 5f
            cp r24, r22
            cpc r25, r23
            sbci r18, 0xff
            sbci r19, 0xff
            movw r24, r18
            brpl 9f
        8:  ldi r24, 0xff
            ldi r25, 0x7f
            brtc 9f
            adiw r24, 1
            rjmp 9f
        5:  cp r22, r24
            cpc r23, r25
            adc r18, r1
            adc r19, r1
            movw r24, r18
            com r25
            neg r24
            sbci r25, 0xff
        9:
            "
        )
    };
}

/// a 2^14 / b, to nearest with ties up, limited to 16 bits; b is not 0.
#[inline(always)]
pub fn divide14(a: i16, b: i16) -> i16 {
    divide(a, b, 0)
}

/// a 2^15 / b, likewise.
#[inline(always)]
pub fn divide15(a: i16, b: i16) -> i16 {
    divide(a, b, 1)
}

/// Both: at the end of the range if half of |a| (`doubled`: |a|) is at least |b|.
#[inline(never)]
fn divide(a: i16, b: i16, doubled: u8) -> i16 {
    let result: i16;
    // SAFETY: see the file's first lines.
    unsafe {
        asm!(
            concat!(
                magnitudes!(),
                "movw r26, r24
                tst r20
                brne 4f
                lsr r27
                ror r26
            4:  cp r26, r22
                cpc r27, r23
                brcs 6f
                rjmp 8f
            6:  tst r20
                breq 7f
                lsl r24
                rol r25
            7:
                ",
                quotient_bit!(),
                quotient_rest!(),
            ),
            inout("r25r24") a => result,
            inout("r23r22") b => _,
            in("r20") doubled,
            out("r18") _, out("r19") _, out("X") _,
            options(pure, nomem, nostack),
        );
    }
    result
}

/// One step of two argument bits: the rest comes with them into `rest`, `fourfold` is four times the
/// root so far. The comparison sets C exactly when the bit is 1, and the subtraction takes C along:
/// 4 root + 1. Before bit i the root has i bits, the shifted rest i + 3.
macro_rules! root_bit {
    ($byte:literal: $($rest:literal, $fourfold:literal);+) => {
        concat!(
            root_bit!(@twice "lsl ", $byte, "\n" $(, "rol ", $rest, "\n")+),
            root_bit!(@first "cp", "cpc" $(, $fourfold, $rest)+),
            "brcc 1f\n",
            $("sbc ", $rest, ", ", $fourfold, "\n",)+
            "ori r20, 2\n1:\n",
            root_bit!(@shift "lsl", "rol" $(, $fourfold)+),
        )
    };
    (@twice $($text:expr),+) => { concat!($($text),+, $($text),+) };
    (@first $first:literal, $next:literal, $a:literal, $b:literal $(, $c:literal, $d:literal)*) => {
        concat!($first, " ", $a, ", ", $b, "\n" $(, $next, " ", $c, ", ", $d, "\n")*)
    };
    (@shift $first:literal, $next:literal, $a:literal $(, $b:literal)*) => {
        concat!($first, " ", $a, "\n" $(, $next, " ", $b, "\n")*)
    };
}

/// Bits 0 to 3 of the root.
macro_rules! root_bits_8 {
    ($times:literal, $byte:literal) => {
        concat!(".rept ", $times, "\n", root_bit!($byte: "r18", "r20"), ".endr\n")
    };
}
/// Bits up to 13.
macro_rules! root_bits_16 {
    ($times:literal, $byte:literal) => {
        concat!(".rept ", $times, "\n", root_bit!($byte: "r18", "r20"; "r19", "r21"), ".endr\n")
    };
}
/// The last bits.
macro_rules! root_bits_24 {
    ($times:literal, $byte:literal) => {
        concat!(
            ".rept ", $times, "\n",
            root_bit!($byte: "r18", "r20"; "r19", "r21"; "r27", "r26"),
            ".endr\n",
        )
    };
}

/// Square root to nearest (no ties exist; up if the rest is more than the root), limited to 16 bits.
#[inline(never)]
pub fn square_root16(radicand: u32) -> i16 {
    let (high, low) = ((radicand >> 16) as u16, radicand as u16);
    let result: i16;
    // SAFETY: see the file's first lines.
    unsafe {
        asm!(
            concat!(
                "clr r18
                clr r19
                movw r20, r18
                movw r26, r18
                ",
                root_bits_8!("4", "r25"), root_bits_16!("4", "r24"), root_bits_16!("4", "r23"),
                root_bits_16!("2", "r22"), root_bits_24!("2", "r22"),
                "lsr r26
                ror r21
                ror r20
                lsr r26
                ror r21
                ror r20
                movw r24, r20
                cp r20, r18
                cpc r21, r19
                cpc r1, r27
                adc r24, r1
                adc r25, r1
                brcs 2f
                brpl 3f
            2:  ldi r24, 0xff
                ldi r25, 0x7f
            3:
                ",
            ),
            inout("r25r24") high => result,
            inout("r23r22") low => _,
            out("r18") _, out("r19") _, out("r20") _, out("r21") _, out("X") _,
            options(pure, nomem, nostack),
        );
    }
    result
}
