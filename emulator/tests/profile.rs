//! Profiles: exact in every cycle, right about who called whom, and without effect on the run.

mod common;

use std::collections::BTreeMap;
use std::path::PathBuf;

use cardan_emulator::{
    ATMEGA328P, Environment, FunctionCost, Image, Machine, Observers, Profile, ProfileReport, Stop,
    Symbols, Unconnected, Watch, Watched,
};
use common::compile;
use proptest::prelude::*;

fn program(name: &str, options: &[&str]) -> PathBuf {
    let source = include_str!("programs/profile.c");
    let always = [
        "-gdwarf-4",
        "-std=gnu99",
        "-ffunction-sections",
        "-Wl,--gc-sections",
    ];
    compile(name, "c", source, &[&always, options].concat())
}

fn loaded(elf: &PathBuf) -> (Machine, Symbols) {
    let bytes = std::fs::read(elf).expect("compiled");
    let image = Image::parse("profile.elf", &bytes, &ATMEGA328P).expect("a good ELF file");
    let mut machine = Machine::new(&ATMEGA328P, 16_000_000);
    machine.load(&image);
    (machine, Symbols::parse(&bytes))
}

/// Runs with a profile, in slices, and checks that the machine is as after a run without one.
fn profiled<E: Environment + Clone>(
    machine: &Machine,
    symbols: &Symbols,
    env: E,
    until: u64,
    slice: u64,
) -> (Machine, Stop, ProfileReport) {
    let (mut plain, mut watched) = (machine.clone(), machine.clone());
    let (mut one, mut other) = (env.clone(), env);
    let mut profile = Profile::new(symbols, machine);
    let values = vec![
        Watched::ProgramCounter,
        Watched::Memory {
            address: 0x100,
            bytes: 8,
        },
    ];
    let mut watch = Watch::new(values, machine);
    loop {
        let end = (watched.cycle() + slice).min(until);
        let expected = plain.run(&mut one, end);
        let mut observers = Observers {
            profile: Some(&mut profile),
            watch: Some(&mut watch),
        };
        let stop = watched.run_observed(&mut other, end, &mut observers);
        assert_eq!(stop, expected);
        assert!(plain == watched, "the observers changed the run");
        if stop != Stop::Limit || watched.cycle() >= until {
            let report = profile.report(&watched, symbols);
            check_sums(&watched, &report);
            return (watched, stop, report);
        }
    }
}

/// Every cycle has one owner.
fn check_sums(machine: &Machine, report: &ProfileReport) {
    let (totals, statistics) = (report.totals, machine.statistics());
    assert_eq!(totals.cycles, machine.cycle());
    let parts = totals.executing + totals.entries + totals.asleep + totals.halted;
    assert_eq!(parts, totals.cycles);
    assert_eq!(totals.instructions, statistics.instructions);
    assert_eq!(totals.asleep, statistics.sleeping_cycles);
    let selves: u64 = report.functions.iter().map(|cost| cost.self_cycles).sum();
    assert_eq!(selves, totals.executing);
    let places: u64 = report.places.iter().map(|place| place.cycles).sum();
    assert_eq!(places, totals.executing);
    let paths: u64 = report.paths.iter().map(|path| path.1).sum();
    assert_eq!(paths, totals.cycles);
    let windows: u64 = report.windows.iter().map(|window| window.cycles).sum();
    assert_eq!(windows, totals.cycles);
    let awake: u64 = report
        .windows
        .iter()
        .map(|window| window.window.awake)
        .sum();
    assert_eq!(awake, totals.cycles - totals.asleep);
    let interrupts: u64 = report
        .windows
        .iter()
        .map(|window| window.window.interrupts)
        .sum();
    let vectors: u64 = report.vectors.iter().map(|vector| vector.cycles).sum();
    assert!(interrupts <= awake && vectors <= awake);
    for cost in &report.functions {
        assert!(
            cost.self_cycles <= cost.inclusive_cycles || report.is_cut,
            "{cost:?}"
        );
    }
    let taken: Vec<u64> = report
        .vectors
        .iter()
        .map(|vector| vector.latency.count())
        .collect();
    let known = statistics.vectors.iter().filter(|vector| vector.count > 0);
    assert_eq!(taken, known.map(|vector| vector.count).collect::<Vec<_>>());
    assert_eq!(report.stack.sp, statistics.lowest_sp);
}

fn cost<'a>(report: &'a ProfileReport, name: &str) -> &'a FunctionCost {
    let named = |cost: &&FunctionCost| cost.function.as_ref().is_some_and(|f| f.name == name);
    report
        .functions
        .iter()
        .find(named)
        .unwrap_or_else(|| panic!("{name} is not in the profile"))
}

#[test]
fn calls_are_counted_whatever_way_functions_are_left() {
    for (name, options) in [
        ("profile-os", &["-Os"][..]),
        ("profile-o2", &["-O2"][..]),
        ("profile-o0", &["-O0"][..]),
        ("profile-prologues", &["-Os", "-mcall-prologues"][..]),
        ("profile-relax", &["-Os", "-mrelax", "-mcall-prologues"][..]),
    ] {
        let (machine, symbols) = loaded(&program(name, options));
        let (machine, stop, report) =
            profiled(&machine, &symbols, Unconnected, 10_000_000, 10_000_000);
        assert_eq!(stop, Stop::Halt, "{name}");
        // 10 by tail, 12 by local, 7 by wide.
        for (function, calls) in [
            ("main", 1),
            ("tail", 10),
            ("leaf", 29),
            ("factorial", 6),
            ("thrower", 24),
            ("longjmp", 4),
            ("setjmp", 4),
            ("local", 1),
            ("wide", 1),
        ] {
            assert_eq!(cost(&report, function).calls, calls, "{name}: {function}");
        }
        let ticks = machine.statistics().vectors[11].count;
        assert!(ticks >= 20, "{ticks}");
        assert_eq!(cost(&report, "__vector_11").calls, ticks, "{name}");
        assert_eq!(report.vectors[0].duration.count(), ticks, "{name}");
        check_paths(name, &report);
    }
}

/// The paths are those of the source: nothing is called by what it does not call.
fn check_paths(name: &str, report: &ProfileReport) {
    let mut found = BTreeMap::new();
    for (path, cycles) in &report.paths {
        *found.entry(path.join(";")).or_insert(0) += cycles;
    }
    let has = |end: &str| found.keys().any(|path| path.ends_with(end));
    for end in [
        "main;tail",
        "factorial;factorial;factorial;factorial;factorial;factorial",
        "thrower;thrower;thrower;thrower;thrower;thrower;longjmp",
        "main;local;leaf",
        "main;wide;leaf",
        "TIMER1_COMPA;__vector_11",
    ] {
        assert!(has(end), "{name}: no {end} in {found:#?}");
    }
    assert!(has("main;tail;leaf") || has("main;tail;twice"), "{name}");
    for path in found.keys() {
        let depth = path.matches("thrower").count();
        assert!(depth <= 6, "{name}: {path}");
        let of_main = path.starts_with("RESET;") && path.matches(";main").count() == 1;
        let other = ["RESET", "TIMER1_COMPA", "(asleep)", "(halted)"];
        assert!(
            of_main || other.iter().any(|root| path.starts_with(root)),
            "{name}: {path}"
        );
        assert!(!path.contains("__vectors;__vector_"), "{name}: {path}");
    }
    let whole = report.totals.executing - cost(report, "__vector_11").self_cycles;
    let main = cost(report, "main").inclusive_cycles;
    assert!(
        main <= whole && main * 10 > whole * 9,
        "{name}: {main} of {whole}"
    );
}

#[test]
fn the_places_are_those_of_a_run_taken_step_by_step() {
    let (machine, symbols) = loaded(&program("profile-steps", &["-Os"]));
    let (_, _, report) = profiled(&machine, &symbols, Unconnected, 10_000_000, 777);
    let mut stepped = machine;
    let mut expected: BTreeMap<u32, (u64, u64)> = BTreeMap::new();
    loop {
        let (pc, cycle) = (stepped.pc(), stepped.cycle());
        let (instructions, is_sleeping) =
            (stepped.statistics().instructions, stepped.is_sleeping());
        let stop = stepped.step(&mut Unconnected);
        let executed = stepped.statistics().instructions - instructions;
        // Otherwise an interrupt was entered, or time passed asleep.
        if executed > 0 && !is_sleeping {
            let place = expected.entry(pc).or_default();
            place.0 += executed;
            place.1 += stepped.cycle() - cycle;
        }
        if stop.is_some() {
            break;
        }
    }
    let found: BTreeMap<u32, (u64, u64)> = report
        .places
        .iter()
        .map(|place| (place.pc, (place.count, place.cycles)))
        .collect();
    assert!(found.len() > 200);
    for (pc, place) in &expected {
        assert_eq!(found.get(pc), Some(place), "at {pc:#06x}");
    }
    assert_eq!(found.len(), expected.len());
}

#[test]
fn the_deepest_stack_has_its_place_and_its_callers() {
    let (machine, symbols) = loaded(&program("profile-stack", &["-Os"]));
    let (machine, _, report) = profiled(&machine, &symbols, Unconnected, 10_000_000, 50_000);
    let peak = &report.stack;
    assert_eq!(peak.sp, machine.statistics().lowest_sp);
    assert_eq!(peak.bytes, 0x8FF - peak.sp);
    // Six frames of more than 20 bytes each lie below main.
    assert!(peak.bytes > 6 * 22, "{peak:?}");
    let throwers = peak.path.iter().filter(|name| *name == "thrower").count();
    assert!(throwers >= 5 && peak.path[0] == "RESET", "{peak:?}");
}

#[test]
fn a_function_that_ends_in_a_return_to_an_address_it_pushed_jumps() {
    let source = "
        .global start
start:  ldi r16, lo8(gs(other))
        ldi r17, hi8(gs(other))
        push r16
        push r17
        ret
        .global other
other:  call third
stop:   rjmp stop
        .global third
third:  rcall .+0
        rcall .+0
        pop r0
        pop r0
        pop r0
        pop r0
        ret
";
    let source = format!("#include <avr/io.h>\n.global __vectors\n__vectors: jmp start\n{source}");
    let elf = compile("returns", "S", &source, &["-nostartfiles", "-nostdlib"]);
    let (machine, symbols) = loaded(&elf);
    let (_, stop, report) = profiled(&machine, &symbols, Unconnected, 1000, 1000);
    assert_eq!(stop, Stop::Halt);
    let paths: Vec<String> = report.paths.iter().map(|path| path.0.join(";")).collect();
    assert!(paths.contains(&"RESET;other;third".to_owned()), "{paths:?}");
    assert_eq!(cost(&report, "third").calls, 1);
    assert_eq!(cost(&report, "third").self_cycles, 3 + 3 + 4 * 2 + 4);
}

/// An environment with inputs that never rest.
#[derive(Clone)]
struct Noise;

impl Environment for Noise {
    fn pin_level(&mut self, cycle: u64, pin: cardan_emulator::Pin) -> Option<bool> {
        Some((cycle >> 4).wrapping_mul(pin.index() as u64 + 3) & 4 != 0)
    }

    fn next_input(&self, cycle: u64) -> Option<u64> {
        Some(cycle + 37)
    }
}

/// Words with many calls, returns, jumps, changes of the stack pointer and interrupts.
fn word() -> impl Strategy<Value = Vec<u16>> {
    prop_oneof![
        3 => any::<u16>().prop_map(|word| vec![word]),
        2 => (0u16..400).prop_map(|target| vec![0x940E, target]),
        1 => (0u16..400).prop_map(|target| vec![0x940C, target]),
        2 => prop::sample::select(vec![0x9508, 0x9518, 0xD000, 0x9509, 0x9409, 0x9478]).prop_map(|w| vec![w]),
        1 => (0u16..32).prop_map(|register| vec![0x920F | register << 4]),
        1 => (0u16..32).prop_map(|register| vec![0x900F | register << 4]),
        1 => any::<u8>().prop_map(|low| vec![0xE000 | u16::from(low & 0xF0) << 4 | u16::from(low & 15), 0xBF0D]),
        // Timer0 overflows every 256 cycles.
        1 => Just(vec![0xE001, 0xBD05, 0x9300, 0x006E]),
        1 => Just(vec![0xE001, 0xBF03, 0x9588]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn whatever_a_program_does_the_sums_hold_and_the_run_is_the_same(
        items in prop::collection::vec(word(), 1..200), slice in 50u64..100_000,
    ) {
        let mut machine = Machine::new(&ATMEGA328P, 8_000_000);
        machine.write_flash(0, &items.concat());
        profiled(&machine, &Symbols::default(), Noise, 60_000, slice);
    }
}
