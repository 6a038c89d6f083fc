//! The debugger's server.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cardan_emulator_fuzz::packets(data);
});
