//! The attitude sensor's processing on ARMv6-M, on recorded codes.
//!
//! No machine of QEMU's has a Cortex-M0+; it runs on the Cortex-M0 of the `microbit`, which has the
//! same instruction set and no other exceptions than the program needs: none.
#![no_std]
#![no_main]

#[cortex_m_rt::entry]
fn main() -> ! {
    cardan_replay::run()
}
