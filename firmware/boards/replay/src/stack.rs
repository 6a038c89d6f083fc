//! How deep the stack gets: free memory is painted at the start, and looked at in the end.

use core::hint::black_box;

/// What free memory holds.
const PAINT: u32 = 0x5ca1_ab1e;
/// Bytes below the painting function's own variable that are left alone: the rest of its frame.
const MARGIN: usize = 128;

// Of the link scripts of cortex-m-rt and riscv-rt: end of the static data, and top of the stack.
unsafe extern "C" {
    static mut __sheap: u32;
    static _stack_start: u32;
}

/// Paints everything between the static data and the stack. Call first.
#[inline(never)]
pub fn paint() {
    let here = black_box(0_u32);
    let mut word = &raw mut __sheap;
    let end = (&raw const here as usize) - MARGIN;
    while (word as usize) < end {
        // SAFETY: nobody uses the memory between the static data and the stack, whose end is above
        // this function's frame; there is no heap, and no interrupt is enabled.
        unsafe {
            word.write_volatile(PAINT);
            word = word.add(1);
        }
    }
}

/// Bytes from the top of the stack to the deepest word that was written since.
#[inline(never)]
pub fn depth() -> u32 {
    let top = &raw const _stack_start;
    let mut word = &raw const __sheap;
    // SAFETY: reads memory that exists, from the static data up to the top of the stack.
    while word < top && unsafe { word.read_volatile() } == PAINT {
        word = unsafe { word.add(1) };
    }
    (top as usize - word as usize) as u32
}
