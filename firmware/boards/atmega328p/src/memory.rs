//! Copying and filling, byte by byte: the compiler's own versions are unrolled and take 500 bytes.

use core::arch::asm;

/// C's `memcpy`, which the compiler calls.
///
/// # Safety
/// As C's: `len` bytes may be read from `from` and written to `to`, and do not overlap.
#[unsafe(no_mangle)]
unsafe extern "C" fn memcpy(to: *mut u8, from: *const u8, len: usize) -> *mut u8 {
    // SAFETY: reads and writes `len` bytes, as the caller promises.
    unsafe {
        asm!(
            "rjmp 3f",
            "2:",
            "ld __tmp_reg__, Z+",
            "st X+, __tmp_reg__",
            "3:",
            "sbiw {len}, 1",
            "brcc 2b",
            len = inout(reg_iw) len => _,
            inout("Z") from => _,
            inout("X") to => _,
            options(nostack),
        );
    }
    to
}

/// C's `memset`, which the compiler calls.
///
/// # Safety
/// As C's: `len` bytes may be written to `to`.
#[unsafe(no_mangle)]
unsafe extern "C" fn memset(to: *mut u8, value: i16, len: usize) -> *mut u8 {
    // SAFETY: writes `len` bytes, as the caller promises.
    unsafe {
        asm!(
            "rjmp 3f",
            "2:",
            "st X+, {value}",
            "3:",
            "sbiw {len}, 1",
            "brcc 2b",
            value = in(reg) value as u8,
            len = inout(reg_iw) len => _,
            inout("X") to => _,
            options(nostack),
        );
    }
    to
}
