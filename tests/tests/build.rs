//! `build` and `doctor` as a user sees them.

use std::fs;
use std::process::{Command, Output};

use cardan_tests::{assert_refused, cardan, document, root, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

/// What the images may need at most.
const BUDGETS: &str = "firmware/boards/atmega328p/images/budgets.toml";

fn number(value: &Value) -> u64 {
    value
        .as_u64()
        .unwrap_or_else(|| panic!("{value} is no whole number"))
}

/// `cardan` on a machine that has nothing installed.
fn bare(arguments: &[&str]) -> Output {
    let mut command = Command::new(cardan());
    command
        .args(arguments)
        .env("PATH", "/nonexistent")
        .env("CARDAN_AVR_RUSTC", "/nonexistent/rustc");
    command
        .env("CARDAN_PYTHON", "/nonexistent/python")
        .output()
        .expect("starts")
}

#[test]
fn build_says_what_each_image_needs_of_the_controller() {
    let output = run(&["build", "--target", "atmega328p", "--json", "--quiet"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let document = document(&output);
    assert!(
        document["toolchain"]["rustc"]
            .as_str()
            .expect("a text")
            .starts_with("rustc ")
    );
    let target = &document["targets"][0];
    assert_eq!(target["target"], "atmega328p");
    let [plain, tapped] = ["plain", "tapped"].map(|name| {
        let images = target["images"].as_array().expect("a list");
        images
            .iter()
            .find(|image| image["image"] == name)
            .expect("both images")
            .clone()
    });
    let budgets = fs::read_to_string(root().join(BUDGETS)).expect("readable");
    let budgets: toml::Table = budgets.parse().expect("TOML");
    for (name, image) in [("plain", &plain), ("tapped", &tapped)] {
        let most = |what: &str| {
            let most = budgets[name][what].as_integer().expect("a whole number");
            u64::try_from(most).expect("positive")
        };
        let [flash, ram, stack] =
            ["flash_bytes", "ram_bytes", "stack_bytes"].map(|name| number(&image[name]));
        assert!(flash > 1000 && flash <= most("flash_bytes"), "{flash}");
        assert!(ram > 0 && stack > 0, "{ram} + {stack} bytes of SRAM");
        let both = ram + stack;
        assert!(both <= most("ram_and_stack_bytes"), "{both} bytes of SRAM");
        for what in ["sample_interrupt_cycles", "solution_own_cycles"] {
            let span = &image[what];
            let (max, mean) = (
                number(&span["max"]),
                span["mean"].as_f64().expect("a number"),
            );
            assert!(mean > 10.0 && mean <= max as f64, "{what}: {span}");
            assert!(max <= most(what), "{what}: {span}");
            assert!(number(&span["count"]) >= 100, "{what}: {span}");
        }
        let third = &image["measured_third_axis"];
        for what in ["sample_interrupt_cycles", "solution_own_cycles"] {
            let span = &third[what];
            assert!(
                number(&span["max"]) <= most(what),
                "third axis, {what}: {span}"
            );
            assert!(number(&span["count"]) >= 100, "third axis, {what}: {span}");
        }
        let both = ram + number(&third["stack_bytes"]);
        assert!(
            both <= most("ram_and_stack_bytes"),
            "third axis: {both} bytes of SRAM"
        );
        let own = number(&image["solution_own_cycles"]["max"]);
        assert!(own < number(&image["solution_cycles"]["max"]));
    }
    for name in ["flash_bytes", "ram_bytes"] {
        assert!(
            number(&tapped[name]) > number(&plain[name]),
            "{name}: taps cost something"
        );
    }
}

#[test]
fn other_formats_give_another_image_and_the_second_build_is_kept() {
    let folder = tempdir().expect("a temporary folder");
    let deployed = fs::read_to_string(root().join("firmware/wordlengths.toml")).expect("readable");
    let place = deployed
        .find("name = \"tilt_x\"")
        .expect("a node of that name");
    let (before, after) = deployed.split_at(place);
    let file = folder.path().join("other.toml");
    let other = format!("{before}{}", after.replacen("frac = 14", "frac = 13", 1));
    fs::write(&file, other).expect("the folder is ours");
    let file = file.to_str().expect("a path in UTF-8");
    let build = |arguments: &[&str]| {
        let target = ["build", "--target", "atmega328p", "--json", "--quiet"];
        let output = run(&[&target, arguments].concat());
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        document(&output)["targets"][0]["images"].clone()
    };
    let other = build(&["--wordlengths", file]);
    assert_eq!(other, build(&["--wordlengths", file]));
    let same = build(&["--wordlengths", "../firmware/wordlengths.toml"]);
    let deployed = build(&[]);
    for index in 0..2 {
        assert_ne!(other[index]["sha256"], deployed[index]["sha256"]);
        assert_eq!(same[index]["sha256"], deployed[index]["sha256"]);
    }
}

#[test]
fn what_build_cannot_use_is_refused_by_name() {
    let folder = tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| {
        let file = folder.path().join(name);
        fs::write(&file, text).expect("the folder is ours");
        file.to_str().expect("a path in UTF-8").to_owned()
    };
    let node = "name = \"tilt_x\"\nunit = \"g\"\nword = 16\nfrac = 14\nrounding = \"floor\"\n";
    let broken = write("broken.toml", "[[node]\n");
    let partial = write(
        "partial.toml",
        &format!("[[node]]\n{node}overflow = \"wrap\"\n"),
    );
    let wide = write(
        "wide.toml",
        &format!("[[node]]\n{node}overflow = \"explode\"\n"),
    );
    for (arguments, parts) in [
        (
            &["--target", "z80"][..],
            &["z80", "atmega328p", "cortex-m0plus", "cortex-m4", "rv32imc"][..],
        ),
        (
            &["--test", "--target", "cortex-m4"],
            &["cortex-m4", "no tests", "atmega328p"],
        ),
        (&["--app", "toaster"], &["toaster", "attitude"]),
        (
            &["--wordlengths", "no/such.toml"],
            &["no/such.toml", "cannot be read"],
        ),
        (&["--wordlengths", &broken], &["broken.toml", "line 1"]),
        (
            &["--wordlengths", &partial],
            &["partial.toml", "is missing"],
        ),
        (
            &["--wordlengths", &wide],
            &["wide.toml", "explode", "saturate"],
        ),
    ] {
        let output = run(&[&["build"], arguments].concat());
        assert_refused(&output, parts);
    }
}

#[test]
fn without_a_toolchain_build_names_what_is_missing_and_doctor() {
    let output = bare(&["build"]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    for part in [
        "/nonexistent/rustc",
        "avr-gcc",
        "apt-get install",
        "cardan doctor",
    ] {
        assert!(said.contains(part), "{said:?} does not say {part:?}");
    }
}

#[test]
fn without_a_linker_other_boards_name_it() {
    let output = bare(&["build", "--target", "rv32imc"]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    for part in ["rv32imc", "ld.lld", "apt-get install lld", "cardan doctor"] {
        assert!(said.contains(part), "{said:?} does not say {part:?}");
    }
}

#[test]
fn doctor_is_content_with_a_bare_machine_and_says_how_to_install_the_rest() {
    let output = bare(&["doctor", "--json", "--quiet"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let document = document(&output);
    assert_eq!(document["ready"], true);
    let parts = document["parts"].as_array().expect("a list");
    for part in parts {
        let is_needed = part["needed_for"] == "compare";
        assert_eq!(part["present"], is_needed, "{part}");
        assert_eq!(part["install"].is_string(), !is_needed, "{part}");
        assert!(!part["purpose"].as_str().expect("a text").is_empty());
    }
    let names: Vec<&str> = parts
        .iter()
        .filter_map(|part| part["name"].as_str())
        .collect();
    for name in [
        "rust for AVR",
        "avr-gcc",
        "avr-libc",
        "rust ARM, RISC-V",
        "lld",
        "qemu for ARM",
        "qemu for RISC-V",
        "simavr",
        "python oracles",
        "chromium",
    ] {
        assert!(names.contains(&name), "{name} is not looked for");
    }
    let text = String::from_utf8(bare(&["doctor"]).stdout).expect("text");
    assert!(
        text.contains("can run") && text.contains("MISSING"),
        "{text}"
    );
    assert!(text.contains("All at once: sudo apt-get install"), "{text}");
}

#[test]
fn doctor_finds_what_the_tests_run_with() {
    let document = document(&run(&["doctor", "--json", "--quiet"]));
    for name in [
        "shared memory",
        "rust",
        "rust for AVR",
        "avr-gcc",
        "avr binutils",
        "avr-libc",
        "rust ARM, RISC-V",
        "lld",
        "qemu for ARM",
        "qemu for RISC-V",
    ] {
        let parts = document["parts"].as_array().expect("a list");
        let part = parts
            .iter()
            .find(|part| part["name"] == name)
            .expect("it is looked for");
        assert_eq!(
            part["present"], true,
            "{part}; `cargo xtask test` installs it"
        );
        assert!(part["version"].is_string(), "{part}");
    }
}
