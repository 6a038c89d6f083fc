//! The attitude sensor's processing on ARMv7E-M, on recorded codes.
#![no_std]
#![no_main]

#[cortex_m_rt::entry]
fn main() -> ! {
    cardan_replay::run()
}
