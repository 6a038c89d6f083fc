//! Random algorithms: each is recorded as what it is or refused, its trials are the exact arithmetic,
//! and no node that is proven ever overflows. `CARDAN_TAPES` says how many, from `CARDAN_TAPES_SEED` on.

mod common;
#[path = "random/mod.rs"]
mod random;

use cardan_datapath::{DEFAULT_DOMAIN_FLAG, Format};
use cardan_numerics::tape::{Inputs, Runner, Tape, Words, affine_bounds, beyond, bounds};
use cardan_numerics::trial::Trial;
use cardan_numerics::{Formats, Recording, Steps, record};
use common::{columns, infos};
use random::{Draw, Kind, NODES, Program, When};

/// Steps beyond the data that are looked at: longer than any delay line and later than any change.
const AHEAD: usize = 160;

#[derive(Default, Debug)]
struct Tally {
    recorded: u64,
    refused: u64,
    delayed: u64,
    proven: u64,
    wide: u64,
    start_up: u64,
}

fn number(name: &str, otherwise: u64) -> u64 {
    let given = std::env::var(name).ok();
    given
        .and_then(|text| text.parse().ok())
        .unwrap_or(otherwise)
}

fn formats(draw: &mut Draw) -> (Vec<Format>, Formats) {
    loop {
        let formats: Vec<Format> = (0..NODES).map(|_| draw.format()).collect();
        if let Ok(computable) = Formats::deployed(&infos(&formats)) {
            return (formats, computable);
        }
    }
}

/// Words, status and overflows of a trial are those of the algorithm.
fn assert_trial(
    seed: u64,
    (tape, inputs): (&Tape, &Inputs),
    formats: &[Format],
    (status, expected): &(Vec<u16>, Recording),
) {
    let mut trial = Trial::new(tape, inputs, DEFAULT_DOMAIN_FLAG);
    trial.run_all(formats);
    let raws = columns(tape, inputs, &trial, NODES);
    assert_eq!(raws, expected.raws, "seed {seed}, {formats:?}");
    assert_eq!(trial.status(), status, "seed {seed}, {formats:?}");
    let counts: Vec<u64> = expected.overflows.iter().map(|o| o.count).collect();
    assert_eq!(trial.overflows(), counts, "seed {seed}, {formats:?}");
}

/// No node overflows that is proven not to; their number.
fn assert_proofs(
    seed: u64,
    (tape, inputs): (&Tape, &Inputs),
    formats: &[Format],
    ports: &[(i32, i32)],
) -> u64 {
    let mut words = Words::new(formats, DEFAULT_DOMAIN_FLAG);
    let mut runner = Runner::new(tape, &mut words);
    for step in 0..inputs.steps {
        runner.step(&mut words, inputs, step);
    }
    let beyond = beyond(tape, formats);
    let mut proven = 0;
    for (how, found) in [
        ("intervals", bounds(tape, ports, formats)),
        ("affine forms", affine_bounds(tape, ports, formats)),
    ] {
        for (node, bound) in found.iter().enumerate() {
            let fits = bound.is_some_and(|bound| bound.fits(formats[node]));
            if fits && beyond[node].is_none() {
                proven += 1;
                assert_eq!(
                    words.counts[node].overflows.count, 0,
                    "seed {seed}, node {node}, {how}: {bound:?} in {formats:?}"
                );
            }
        }
    }
    proven
}

fn one(seed: u64, tally: &mut Tally) {
    let mut draw = Draw(seed);
    let program: Program = draw.program();
    let ports = [draw.port(), draw.port()];
    let count = 20 + draw.below(40);
    let steps = draw.steps(count, ports);
    let (tape, inputs) = match Tape::record_ahead(&program, &steps, AHEAD) {
        Ok(recorded) => recorded,
        Err(error) => {
            let may_change = matches!(program.when, When::Every(_) | When::Above(_));
            assert!(may_change, "seed {seed}: {error}: {program:?}");
            tally.refused += 1;
            return;
        }
    };
    tally.recorded += 1;
    tally.start_up += u64::from(!tape.transient.is_empty());
    // A longer run is the same tape: it was recorded as what it is. (What only an input would change
    // that was not there yet is told then.)
    let longer = draw.steps(150 + count, ports);
    let longer =
        Tape::record_ahead(&program, &longer, AHEAD).map(|(tape, inputs)| (tape, inputs, longer));
    match longer {
        Ok((again, inputs, steps)) => {
            // A change by an input may leave no trace once two delay lines hold the same; while
            // they fill, it is a start-up of these data.
            if matches!(program.when, When::Above(_)) {
                assert_eq!(again.steady, tape.steady, "seed {seed}: {program:?}");
            } else {
                assert_eq!(again, tape, "seed {seed}: {program:?}");
            }
            let tape = &again;
            let (formats, computable) = formats(&mut draw);
            let run = Steps {
                datapath: &program,
                inputs: &steps,
            };
            assert_trial(seed, (tape, &inputs), &formats, &record(&run, &computable));
            tally.proven += assert_proofs(seed, (tape, &inputs), &formats, &ports_of(tape, ports));
        }
        Err(error) => {
            assert!(
                matches!(program.when, When::Above(_)),
                "seed {seed}: {error}: {program:?}"
            );
        }
    }
    let read = |kind: Kind| matches!(kind, Kind::Delayed(_));
    tally.delayed += u64::from(program.instructions.iter().any(|i| read(i.kind)));
    for _ in 0..2 {
        let (formats, computable) = formats(&mut draw);
        tally.wide += u64::from(formats.iter().any(|format| format.word >= 54));
        let run = Steps {
            datapath: &program,
            inputs: &steps,
        };
        assert_trial(seed, (&tape, &inputs), &formats, &record(&run, &computable));
        tally.proven += assert_proofs(seed, (&tape, &inputs), &formats, &ports_of(&tape, ports));
    }
}

/// The bounds of each of the tape's ports: coarse inputs have 0 fractional bits.
fn ports_of(tape: &Tape, ports: [(i32, i32); 2]) -> Vec<(i32, i32)> {
    let mut all = Vec::new();
    for entry in tape.steady.iter().chain(tape.transient.iter().flatten()) {
        if let cardan_numerics::tape::Op::Input { port, frac } = entry.op {
            let port = port as usize;
            if all.len() <= port {
                all.resize(port + 1, (0, 0));
            }
            all[port] = if frac == 0 { ports[1] } else { ports[0] };
        }
    }
    all
}

/// Algorithms that were once proven wrong: the last word of a wide format, where values stay that are beyond it,
/// is no f64 and lies below the one that stood for it.
const FOUND: [u64; 5] = [2_140_971, 2_256_093, 2_471_982, 2_578_303, 2_744_306];

#[test]
fn algorithms_that_were_proven_wrong_are_so_no_longer() {
    let mut tally = Tally::default();
    for seed in FOUND {
        one(seed, &mut tally);
    }
    assert!(tally.proven > 0, "{tally:?}");
}

#[test]
fn random_algorithms_are_recorded_computed_and_proven_right() {
    let (count, first) = (number("CARDAN_TAPES", 3000), number("CARDAN_TAPES_SEED", 0));
    let mut tally = Tally::default();
    for seed in first..first + count {
        one(seed, &mut tally);
    }
    println!("{count} tapes: {tally:?}");
    if count >= 3000 {
        let share = |part: u64| part as f64 / count as f64;
        assert!(share(tally.refused) > 0.05, "{tally:?}");
        assert!(share(tally.delayed) > 0.2, "{tally:?}");
        assert!(share(tally.start_up) > 0.2, "{tally:?}");
        assert!(share(tally.wide) > 0.5, "{tally:?}");
        assert!(share(tally.proven) > 1.0, "{tally:?}");
    }
}
