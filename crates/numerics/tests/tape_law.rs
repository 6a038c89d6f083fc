//! A recorded tape is the algorithm: step by step, in columns of many steps, and in trials one after
//! the other, it gives the words, overflows and status of [`Mixed`], and so of the firmware.

mod common;

use cardan_datapath::{Format, Overflow, Rounding};
use cardan_numerics::tape::{Inputs, NO_NODE, Real, Runner, Tape, TraceError, Words};
use cardan_numerics::trial::Trial;
use cardan_numerics::{Datapath, Formats, Recording, Steps, record};
use common::{At, Everything, Fir, Iir, NODES, Unsteady, columns, infos};
use proptest::prelude::*;

const DOMAIN: u16 = cardan_datapath::DEFAULT_DOMAIN_FLAG;

/// What the mixed arithmetic makes of it.
fn expected<A: Datapath>(
    datapath: &A,
    steps: &[Vec<i32>],
    formats: &[Format],
) -> (Vec<u16>, Recording) {
    let formats = Formats::deployed(&infos(formats)).expect("computable");
    record(
        &Steps {
            datapath,
            inputs: steps,
        },
        &formats,
    )
}

/// Every recorded word of a run of the tape, per node.
fn step_by_step(tape: &Tape, inputs: &Inputs, formats: &[Format]) -> (Vec<u16>, Vec<Vec<i64>>) {
    let mut words = Words::new(formats, DOMAIN);
    let mut runner = Runner::new(tape, &mut words);
    let mut raws = vec![Vec::new(); formats.len()];
    let mut status = Vec::new();
    for step in 0..inputs.steps {
        let items = runner.step(&mut words, inputs, step);
        for (entry, item) in tape.body(step).iter().zip(items) {
            if entry.node != NO_NODE && entry.op.is_recorded() {
                raws[entry.node as usize].push(item.raw);
            }
        }
        status.push(std::mem::take(&mut words.status));
    }
    // A word before the steps may raise it too; the algorithm's own status is taken after a step.
    (status, raws)
}

/// All of it, for several formats in a row.
fn assert_law<A: Datapath>(datapath: &A, steps: &[Vec<i32>], all: &[Vec<Format>]) {
    let (tape, inputs) = Tape::record(datapath, steps).expect("is steady");
    let mut trial = Trial::new(&tape, &inputs, DOMAIN);
    for formats in all {
        let (status, recording) = expected(datapath, steps, formats);
        let (tape_status, raws) = step_by_step(&tape, &inputs, formats);
        assert_eq!(raws, recording.raws, "{formats:?}");
        assert_eq!(tape_status, status);
        trial.run_all(formats);
        let found = columns(&tape, &inputs, &trial, formats.len());
        for (node, format) in formats.iter().enumerate() {
            assert_eq!(
                found[node], recording.raws[node],
                "node {node} in {format:?} of {formats:?}"
            );
        }
        assert_eq!(trial.status(), status);
        let counts: Vec<u64> = recording.overflows.iter().map(|o| o.count).collect();
        assert_eq!(trial.overflows(), counts, "{formats:?}");
    }
}

fn any_format(word: std::ops::RangeInclusive<u32>) -> impl Strategy<Value = Format> {
    (word, 0u32..=30, 0usize..6, 0usize..7).prop_map(|(word, frac, rounding, overflow)| {
        let overflow = [0, 0, 0, 1, 1, 1, 2][overflow];
        Format::new(
            word,
            frac.min(word + 8).min(64),
            Rounding::ALL[rounding].0,
            Overflow::ALL[overflow].0,
        )
    })
}

/// Formats as people choose them, and any.
fn any_formats() -> impl Strategy<Value = Vec<Vec<Format>>> {
    let usual = proptest::collection::vec(any_format(2..=20), NODES);
    let wide = proptest::collection::vec(any_format(1..=64), NODES);
    let one = prop_oneof![3 => usual, 1 => wide];
    proptest::collection::vec(one, 1..4)
}

fn any_steps(ports: usize) -> impl Strategy<Value = Vec<Vec<i32>>> {
    let word = prop_oneof![
        4 => -600i32..600,
        1 => Just(0),
        1 => any::<i32>(),
    ];
    let step = proptest::collection::vec(word, ports);
    prop_oneof![
        proptest::collection::vec(step.clone(), 1..40),
        proptest::collection::vec(step, 500..560),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn every_operation_in_any_formats(steps in any_steps(3), formats in any_formats()) {
        assert_law(&Everything, &steps, &formats);
    }

    #[test]
    fn a_feedback_loop_in_any_formats(steps in any_steps(1), formats in any_formats()) {
        assert_law(&Iir, &steps, &formats);
    }

    #[test]
    fn a_delay_line_in_any_formats(steps in any_steps(1), formats in any_formats()) {
        assert_law(&Fir, &steps, &formats);
    }

    #[test]
    fn one_changed_node_after_the_other(
        steps in any_steps(3),
        formats in proptest::collection::vec(any_format(2..=24), NODES),
        changes in proptest::collection::vec((0..NODES, any_format(2..=24)), 1..8),
    ) {
        let mut all = vec![formats];
        for (node, format) in changes {
            let mut next = all.last().expect("not empty").clone();
            next[node] = format;
            all.push(next);
        }
        assert_law(&Everything, &steps, &all);
    }

    #[test]
    fn real_numbers_are_those_of_the_mixed_arithmetic(
        steps in any_steps(3),
    ) {
        let deployed = common::deployed();
        let (tape, inputs) = Tape::record(&Everything, &steps).expect("is steady");
        let algorithm = Steps { datapath: &Everything, inputs: &steps };
        let (status, recording) = record(&algorithm, &Formats::real(NODES));
        let mut real = Real::new(&deployed, DOMAIN);
        let mut runner = Runner::new(&tape, &mut real);
        let mut values = vec![Vec::new(); NODES];
        let mut found = Vec::new();
        for step in 0..inputs.steps {
            let items = runner.step(&mut real, &inputs, step);
            for (entry, item) in tape.body(step).iter().zip(items) {
                if entry.node != NO_NODE && entry.op.is_recorded() {
                    values[entry.node as usize].push(item.to_bits());
                }
            }
            found.push(std::mem::take(&mut real.status));
        }
        let bits = |all: &Vec<f64>| all.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(values, recording.values.iter().map(bits).collect::<Vec<_>>());
        prop_assert_eq!(found, status);
    }
}

#[test]
fn a_trial_that_is_ended_early_leaves_the_next_one_right() {
    let steps: Vec<Vec<i32>> = (0..2000)
        .map(|at| vec![at * 7 % 301 - 150, at * 13 % 401 - 200, at % 17])
        .collect();
    let (tape, inputs) = Tape::record(&Everything, &steps).expect("is steady");
    let mut trial = Trial::new(&tape, &inputs, DOMAIN);
    let first = common::deployed();
    let mut second = first.clone();
    for format in &mut second {
        format.frac -= 2;
    }
    trial.run_all(&first);
    assert!(!trial.run(&second, |_, _| std::ops::ControlFlow::Break(())));
    for formats in [&first, &second] {
        let mut fresh = Trial::new(&tape, &inputs, DOMAIN);
        fresh.run_all(formats);
        trial.run_all(formats);
        assert_eq!(
            columns(&tape, &inputs, &trial, NODES),
            columns(&tape, &inputs, &fresh, NODES)
        );
        assert_eq!(trial.status(), fresh.status());
        assert_eq!(trial.overflows(), fresh.overflows());
    }
}

#[test]
fn only_what_lies_downstream_of_a_change_is_computed_again() {
    let steps: Vec<Vec<i32>> = (0..400).map(|at| vec![at, -at, 3]).collect();
    let (tape, inputs) = Tape::record(&Everything, &steps).expect("is steady");
    let mut trial = Trial::new(&tape, &inputs, DOMAIN);
    let mut formats = common::deployed();
    trial.run_all(&formats);
    let whole = trial.operations;
    trial.run_all(&formats);
    assert_eq!(trial.operations, whole, "nothing changed");
    formats[common::LAST].frac -= 1;
    trial.run_all(&formats);
    assert!(
        trial.operations - whole < whole / 4,
        "the last node has few users"
    );
}

#[test]
fn an_algorithm_that_branches_on_its_input_is_refused() {
    let steps: Vec<Vec<i32>> = (0..100).map(|at| vec![at]).collect();
    let found = Tape::record(&Unsteady, &steps).unwrap_err();
    assert!(
        matches!(found, TraceError::OtherPath { step: 50, .. }),
        "{found}"
    );
    let none: [Vec<i32>; 0] = [];
    assert_eq!(Tape::record(&Iir, &none).unwrap_err(), TraceError::Empty);
    let _ = At::<0>;
}
