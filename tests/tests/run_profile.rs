//! `run --profile`: the table, the document and the files, opened by the programs they are for.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use cardan_tests::program::{compile_with, folder, hex_text, text, write};
use cardan_tests::{document, run, stderr};
use serde_json::Value;

const DEBUG: [&str; 1] = ["-gdwarf-4"];

fn profiled(folder: &Path, arguments: &[&str]) -> (PathBuf, Output) {
    let elf = compile_with("profiled", folder, &DEBUG);
    let output = run(&[&["run", text(&elf), "--adc", "0=2.5"], arguments].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    (elf, output)
}

fn sum(list: &Value, name: &str) -> u64 {
    let items = list.as_array().expect("a list").iter();
    items
        .map(|item| item[name].as_u64().expect("a number"))
        .sum()
}

#[test]
fn the_document_accounts_for_every_cycle_and_changes_nothing_else() {
    let folder = folder();
    let (elf, with) = profiled(folder.path(), &["--profile", "--json"]);
    let mut with = document(&with);
    let mut without = document(&run(&["run", text(&elf), "--adc", "0=2.5", "--json"]));
    let profile = with["profile"].take();
    with.as_object_mut().expect("a document").remove("profile");
    for document in [&mut with, &mut without] {
        // (The plain run may take the translator.)
        for name in ["host_seconds", "mcycles_per_second", "engine"] {
            document[name] = Value::Null;
        }
    }
    assert_eq!(with, without);
    let totals = &profile["totals"];
    let number = |name: &str| totals[name].as_u64().expect("a number");
    assert_eq!(number("cycles"), with["cycles"]);
    assert_eq!(number("instructions"), with["instructions"]);
    assert_eq!(number("asleep_cycles"), with["sleeping_cycles"]);
    assert_eq!(
        number("cycles"),
        sum(&profile["functions"], "self_cycles")
            + number("interrupt_entry_cycles")
            + number("asleep_cycles")
            + number("halted_cycles")
    );
    let windows = &profile["load"]["windows"];
    assert_eq!(sum(windows, "cycles"), number("cycles"));
    assert_eq!(
        sum(windows, "awake"),
        number("cycles") - number("asleep_cycles")
    );
    let awake = profile["load"]["awake"].as_f64().expect("a share");
    assert!((0.01..0.2).contains(&awake), "{awake}");
    let interrupt = &profile["interrupts"][0];
    let count = interrupt["count"].as_u64().expect("a number");
    assert_eq!(interrupt["name"], "ADC");
    assert!((500..=502).contains(&count), "{count}");
    assert_eq!(number("interrupt_entry_cycles"), 4 * count);
    assert_eq!(sum(&interrupt["latency"]["bins"], "count"), count);
    assert_eq!(profile["stack"]["peak_bytes"], with["stack_peak"]);
    assert_eq!(profile["memory"]["static_bytes"], 5);
    assert_eq!(profile["problem"], Value::Null);
}

#[test]
fn the_table_names_functions_lines_interrupts_load_and_stack() {
    let folder = folder();
    let (_, output) = profiled(folder.path(), &["--profile"]);
    let said = stderr(&output);
    for part in [
        "filter",
        "__vector_21",
        "(asleep)",
        "(interrupt entries)",
        "profiled.c:",
        "latency of ADC",
        "processor awake",
        "stack at its deepest",
        "RESET > __do_clear_bss > main",
        "flash",
        "variables 5",
    ] {
        assert!(said.contains(part), "no {part:?} in {said}");
    }
    assert!(output.stdout.is_empty(), "the program sends nothing");
    let (_, output) = profiled(folder.path(), &["--profile", "--quiet"]);
    assert_eq!(stderr(&output), "");
}

/// Runs a tool of the tests and returns what it prints.
fn tool(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output();
    let output = output.unwrap_or_else(|error| {
        panic!("{program} cannot be started ({error}); install it: apt-get install lcov")
    });
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(&output);
    assert!(output.status.success(), "{program} {arguments:?}: {said}");
    said
}

#[test]
fn genhtml_shows_the_line_coverage() {
    let folder = folder();
    let out = folder.path().join("profile");
    profiled(folder.path(), &["--profile-out", text(&out), "--quiet"]);
    let info = out.join("lcov.info");
    let listed = tool("lcov", &["--list", text(&info)]);
    assert!(listed.contains("profiled.c"), "{listed}");
    let html = folder.path().join("html");
    tool("genhtml", &["--output-directory", text(&html), text(&info)]);
    let source = fs::read_to_string(cardan_tests::root().join("tests/programs/profiled.c"))
        .expect("our own file");
    let counts = counts(&fs::read_to_string(&info).expect("written"));
    let count = |line: &str| {
        let number = source.lines().position(|known| known.trim() == line);
        counts[&(number.expect("a line of the program") + 1)]
    };
    assert_eq!(count("left--;"), 500);
    assert_eq!(count("return value * 3;"), 0);
    assert_eq!(count("cli();"), 1);
    assert!(count("average += quarter(value) - quarter(average);") == 500);
    let pages = find(&html, "profiled.c.gcov.html");
    let page = fs::read_to_string(pages).expect("genhtml writes a page per file");
    assert!(
        page.contains("never(unsigned value)"),
        "the page shows the source"
    );
}

/// Executions by line.
fn counts(info: &str) -> BTreeMap<usize, u64> {
    let lines = info.lines().filter_map(|line| line.strip_prefix("DA:"));
    lines
        .map(|line| {
            let (line, count) = line.split_once(',').expect("DA:LINE,COUNT");
            (
                line.parse().expect("a line"),
                count.parse().expect("a count"),
            )
        })
        .collect()
}

fn find(folder: &Path, name: &str) -> PathBuf {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.file_name().is_some_and(|known| known == name) {
                return path;
            }
        }
    }
    panic!("no {name} below {}", folder.display())
}

#[test]
fn inferno_draws_a_flame_graph_of_the_call_paths() {
    let folder = folder();
    let out = folder.path().join("profile");
    let (_, output) = profiled(
        folder.path(),
        &["--profile-out", text(&out), "--json", "--quiet"],
    );
    let folded = fs::read_to_string(out.join("folded.txt")).expect("written");
    let cycles: u64 = folded
        .lines()
        .map(|line| line.rsplit_once(' ').expect("STACK COUNT").1)
        .map(|count| count.parse::<u64>().expect("a count"))
        .sum();
    assert_eq!(cycles, document(&output)["cycles"]);
    let mut options = inferno::flamegraph::Options::default();
    let mut picture = Vec::new();
    inferno::flamegraph::from_lines(&mut options, folded.lines(), &mut picture)
        .expect("inferno reads it");
    let picture = String::from_utf8(picture).expect("SVG is text");
    for name in ["main", "filter", "ADC", "(asleep)"] {
        assert!(picture.contains(&format!("<title>{name} (")), "no {name}");
    }
    let written: Value =
        serde_json::from_str(&fs::read_to_string(out.join("profile.json")).expect("written"))
            .expect("JSON");
    assert_eq!(written, document(&output)["profile"]);
    let listing = fs::read_to_string(out.join("listing.txt")).expect("written");
    assert!(
        listing.contains("filter:") && listing.contains("sleep"),
        "{listing}"
    );
}

#[test]
fn a_program_without_names_is_profiled_all_the_same() {
    let folder = folder();
    let file = write(
        &folder,
        "words.hex",
        hex_text(&[0xE089, 0xD001, 0xCFFF, 0x9508]),
    );
    let output = run(&["run", text(&file), "--profile", "--json"]);
    let document = document(&output);
    let profile = &document["profile"];
    assert_eq!(profile["functions"][0]["self_cycles"], document["cycles"]);
    assert_eq!(profile["functions"][0]["name"], Value::Null);
    assert!(profile["problem"].is_string());
    assert_eq!(profile["memory"]["static_bytes"], Value::Null);
    assert!(stderr(&output).contains("(no symbol)"));
}

#[test]
fn a_folder_that_cannot_be_made_is_refused_before_the_run() {
    let folder = folder();
    let file = write(&folder, "words.hex", hex_text(&[0xE089, 0xCFFF]));
    let inside = file.join("profile");
    let output = run(&["run", text(&file), "--profile-out", text(&inside)]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("--profile-out"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn crashes_and_odd_accesses_are_told_with_function_and_source_line() {
    let folder = folder();
    let source = "#include <avr/io.h>\n\
        __attribute__((noinline)) void odd(void)\n{\n    *(volatile char *)0x2c = 1;\n}\n\
        __attribute__((noinline)) void crash(void)\n{\n    *(volatile char *)0x900 = 1;\n}\n\
        int main(void)\n{\n    odd();\n    odd();\n    crash();\n    return 0;\n}\n";
    let source = write(&folder, "faulty.c", source);
    let elf = cardan_tests::program::compile_file(&source, folder.path(), &DEBUG);
    let output = Command::new(cardan_tests::cardan())
        .current_dir(folder.path())
        .args(["run", text(&elf), "--json"])
        .output()
        .expect("cardan starts");
    assert_eq!(output.status.code(), Some(4));
    let said = stderr(&output);
    assert_eq!(said.matches("in odd (faulty.c:4)").count(), 1, "{said}");
    assert!(
        said.contains("beyond the end of SRAM, in crash (faulty.c:8)"),
        "{said}"
    );
    let document = document(&output);
    assert_eq!(document["crash"]["function"], "crash");
    assert_eq!(document["crash"]["line"], 8);
    assert!(
        document["reports"][0]
            .as_str()
            .expect("text")
            .contains("faulty.c:4")
    );
}
