//! The attitude sensor's processing on RV32IMC, on recorded codes.
#![no_std]
#![no_main]

#[riscv_rt::entry]
fn main() -> ! {
    cardan_replay::run()
}
