//! Names of places, against avr-addr2line and avr-nm.

mod common;

use std::path::Path;
use std::process::Command;

use cardan_emulator::Symbols;
use common::compile;
use proptest::prelude::*;

fn compiled(name: &str, extension: &str, source: &str, options: &[&str]) -> Vec<u8> {
    let elf = compile(name, extension, source, options);
    std::fs::read(elf).expect("compiled")
}

const OPTIONS: [&str; 4] = [
    "-std=gnu99",
    "-ffunction-sections",
    "-Wl,--gc-sections",
    "-Os",
];

fn output(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output();
    let output = output.unwrap_or_else(|error| panic!("{program}: {error}; {}", common::INSTALL));
    String::from_utf8(output.stdout).expect("text")
}

#[test]
fn every_place_has_the_names_that_addr2line_gives_it() {
    let source = include_str!("programs/profile.c");
    // Without removed functions, whose lines avr-addr2line takes for those of others.
    let elf = compile("places", "c", source, &["-std=gnu99", "-Os", "-gdwarf-4"]);
    let symbols = Symbols::parse(&std::fs::read(&elf).expect("compiled"));
    assert_eq!(symbols.problem(), None);
    let addresses: Vec<u32> = symbols
        .rows()
        .iter()
        .flat_map(|row| (row.start..row.end).step_by(2))
        .collect();
    assert!(addresses.len() > 200);
    let mut inlined = 0;
    for address in addresses {
        let elf = elf.to_str().expect("a path in UTF-8");
        let text = output(
            "avr-addr2line",
            &["-e", elf, "-f", "-i", &format!("{address:#x}")],
        );
        let lines: Vec<&str> = text.lines().collect();
        let expected: Vec<(&str, &str, u32)> = lines
            .chunks(2)
            .map(|pair| {
                let (file, line) = pair[1].rsplit_once(':').expect("FILE:LINE");
                let line = line.split(' ').next().unwrap_or_default();
                (pair[0], file, line.parse().expect("a line"))
            })
            .collect();
        let frames = symbols.frames_at(address);
        let found: Vec<(&str, &str, u32)> = frames
            .iter()
            .map(|frame| {
                (
                    frame.function.as_deref().unwrap_or_default(),
                    frame.file.as_deref().unwrap_or_default(),
                    frame.line.unwrap_or_default(),
                )
            })
            .collect();
        assert_eq!(found, expected, "at {address:#x}");
        inlined += usize::from(found.len() > 1);
    }
    assert!(inlined > 0, "nothing was inlined");
}

#[test]
fn removed_functions_give_no_names_to_the_vectors() {
    let source = include_str!("programs/profile.c");
    let options = [&OPTIONS[..], &["-gdwarf-4"]].concat();
    let symbols = Symbols::parse(&compiled("removed", "c", source, &options));
    for address in (0..0x68).step_by(2) {
        assert_eq!(symbols.line_at(address), None, "{address:#x}");
        let frames = symbols.frames_at(address);
        assert_eq!(frames[0].function.as_deref(), Some("__vectors"));
    }
    let names = symbols.functions().iter().map(|function| &function.name);
    assert!(!names.clone().any(|name| name == "dead"));
    assert!(names.clone().any(|name| name == "leaf"));
}

#[test]
fn names_of_cpp_and_rust_are_spelt_as_in_their_languages() {
    let source = "namespace filter { template <int N> struct Mean { int sum;
        __attribute__((noinline)) int add(int x) { sum += x * N; return sum; } }; }
        volatile int sink; extern \"C\" void _ZN4core5slice4sort17h0123456789abcdefE() { sink = 1; }
        int main() { filter::Mean<4> mean = {0}; sink = mean.add(sink);
        _ZN4core5slice4sort17h0123456789abcdefE(); return 0; }";
    let symbols = Symbols::parse(&compiled("mangled", "cpp", source, &["-Os"]));
    let names: Vec<&str> = symbols
        .functions()
        .iter()
        .map(|function| function.name.as_str())
        .collect();
    assert!(names.contains(&"filter::Mean<4>::add(int)"), "{names:?}");
    assert!(names.contains(&"core::slice::sort"), "{names:?}");
    assert!(names.contains(&"main"));
}

#[test]
fn what_is_missing_is_said_and_the_rest_is_there() {
    let source = include_str!("programs/profile.c");
    let plain = Symbols::parse(&compiled("plain", "c", source, &OPTIONS));
    assert!(plain.function_at(0x200).is_some());
    assert!(plain.rows().is_empty());
    let problem = plain.problem().expect("a reason");
    assert!(problem.contains("-gdwarf-4"), "{problem}");
    // avr-gcc 5 writes stabs for -g, newer ones DWARF.
    let other = compiled("stabs", "c", source, &[&OPTIONS[..], &["-gstabs"]].concat());
    if other.windows(6).any(|bytes| bytes == b".stab\0") {
        let problem = Symbols::parse(&other).problem().map(str::to_owned);
        assert!(problem.is_some_and(|problem| problem.contains("stabs")));
    }
    let hex = Symbols::parse(b":00000001FF\n");
    assert!(hex.functions().is_empty() && hex.problem().is_some());
}

#[test]
fn paths_are_shown_relative_to_the_folder_they_lie_in() {
    use cardan_emulator::shortened;
    for (path, base, shown) in [
        ("/a/b/c.c", "/a", "b/c.c"),
        ("/a/b/c.c", "/a/b/", "c.c"),
        ("/a/b/c.c", "/x", "/a/b/c.c"),
        ("/ab/c.c", "/a", "/ab/c.c"),
        ("c.c", "/a", "c.c"),
    ] {
        assert_eq!(shortened(path, Path::new(base)), shown);
    }
}

/// A program with debug information.
fn debugged() -> &'static [u8] {
    static BYTES: std::sync::OnceLock<Vec<u8>> = std::sync::OnceLock::new();
    BYTES.get_or_init(|| {
        let source = include_str!("programs/profile.c");
        compiled(
            "damaged",
            "c",
            source,
            &[&OPTIONS[..], &["-gdwarf-4"]].concat(),
        )
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_give_fewer_names_and_never_fail(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..40),
        length in any::<prop::sample::Index>(), cut in any::<bool>(),
    ) {
        let mut bytes = debugged().to_vec();
        if cut {
            bytes.truncate(length.index(bytes.len()));
        }
        for (at, value) in damage {
            if !bytes.is_empty() {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
        }
        let symbols = Symbols::parse(&bytes);
        for address in (0..0x8000).step_by(26) {
            let _ = symbols.describe(address, Path::new("/"));
        }
    }
}
