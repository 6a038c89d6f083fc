//! Host code in memory, and the call into it: the one place of the workspace's host side that
//! needs `unsafe`. Memory is written first and made executable then, never both at once.

use std::io;

use cardan_emulator::engine::Core;
use memmap2::{Mmap, MmapMut};

/// A translated function: core, its data space, its program memory, number of the entry; returns
/// why it left.
type Function = unsafe extern "C" fn(*mut Core, *mut u8, *const u16, u32) -> u32;

/// One translated function.
#[derive(Debug)]
pub(crate) struct HostCode {
    memory: Mmap,
}

impl HostCode {
    /// Copies position-independent machine code into executable memory.
    pub(crate) fn new(code: &[u8]) -> io::Result<HostCode> {
        let mut memory = MmapMut::map_anon(code.len())?;
        memory[..code.len()].copy_from_slice(code);
        let memory = memory.make_exec()?;
        synchronise(&memory);
        Ok(HostCode { memory })
    }

    /// Size in memory, in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.memory.len()
    }

    /// Executes it on a core, from one of its entries.
    #[inline]
    #[allow(unsafe_code, reason = "calls the code that this crate has generated")]
    pub(crate) fn run(&self, core: &mut Core, entry: u32) -> u32 {
        let flash = core.flash().as_ptr();
        let data = core.data_mut().as_mut_ptr();
        // SAFETY: the memory holds, from its beginning, one function that `lower` has emitted with
        // this signature and the platform's calling convention. It writes fields of the core at
        // the offsets of `Core::LAYOUT`, data bytes 0 to 31, and bytes that it has found to lie in
        // SRAM; it reads program memory with an index masked to its length; it keeps none of the
        // pointers. The core is borrowed exclusively for the time of the call.
        unsafe {
            let function = std::mem::transmute::<*const u8, Function>(self.memory.as_ptr());
            function(core, data, flash, entry)
        }
    }
}

/// Makes new code visible to instruction fetch, where the host does not do that by itself.
#[cfg(target_arch = "x86_64")]
fn synchronise(_: &Mmap) {}

/// Makes new code visible to instruction fetch (Arm Architecture Reference Manual, B2.4.4).
#[cfg(target_arch = "aarch64")]
#[allow(unsafe_code, reason = "cache maintenance has no safe form")]
fn synchronise(memory: &Mmap) {
    const LINE: usize = 16;
    let start = memory.as_ptr() as usize;
    for address in (start..start + memory.len()).step_by(LINE) {
        // SAFETY: cleans and invalidates cache lines of a mapping that we own; changes no data.
        unsafe {
            std::arch::asm!("dc cvau, {0}", in(reg) address, options(nostack, preserves_flags));
        }
    }
    // SAFETY: barriers, and invalidation of the same lines.
    unsafe { std::arch::asm!("dsb ish", options(nostack, preserves_flags)) };
    for address in (start..start + memory.len()).step_by(LINE) {
        // SAFETY: as above.
        unsafe {
            std::arch::asm!("ic ivau, {0}", in(reg) address, options(nostack, preserves_flags));
        }
    }
    // SAFETY: as above.
    unsafe { std::arch::asm!("dsb ish", "isb", options(nostack, preserves_flags)) };
}
