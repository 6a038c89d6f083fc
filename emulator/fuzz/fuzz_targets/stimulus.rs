//! Stimulus files.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cardan_emulator_fuzz::stimulus(data);
});
