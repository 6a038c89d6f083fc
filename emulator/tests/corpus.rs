//! Every file of the fuzz corpus, without the fuzzer.

#[path = "../fuzz/src/lib.rs"]
#[allow(unreachable_pub, reason = "a library of its own for the fuzzer")]
mod bodies;

use std::fs;
use std::path::Path;

/// Runs `body` over the corpus of a target; returns how many files there are.
fn replay(target: &str, body: impl Fn(&[u8])) -> usize {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("fuzz/corpus")
        .join(target);
    let files = fs::read_dir(&folder).unwrap_or_else(|error| panic!("{target}: {error}"));
    let mut count = 0;
    for file in files {
        let file = file.expect("readable").path();
        let bytes = fs::read(&file).expect("readable");
        // The test harness shows this if the body panics.
        println!("{}", file.display());
        body(&bytes);
        count += 1;
    }
    count
}

#[test]
fn the_corpus_of_image_files_does_no_harm() {
    assert!(replay("loader", bodies::loader) >= 4);
}

#[test]
fn the_corpus_of_instructions_does_no_harm() {
    assert!(replay("decoder", bodies::decoder) >= 4);
}

#[test]
fn the_corpus_of_stimuli_does_no_harm() {
    assert!(replay("stimulus", bodies::stimulus) >= 4);
}

#[test]
fn the_corpus_of_packets_does_no_harm() {
    assert!(replay("packets", bodies::packets) >= 4);
}

#[test]
fn the_corpus_of_programs_does_no_harm() {
    let run = |data: &[u8]| {
        bodies::random_flash(data);
    };
    assert!(replay("random_flash", run) >= 4);
}

#[test]
fn every_word_is_an_instruction_for_the_disassembler_if_it_is_one_for_the_core() {
    let all: Vec<u8> = (0..=u16::MAX).flat_map(u16::to_le_bytes).collect();
    all.chunks(128).for_each(bodies::decoder);
}
