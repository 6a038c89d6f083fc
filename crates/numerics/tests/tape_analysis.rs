//! Derived bounds hold for every run, and gains are derivatives.

mod common;

use cardan_datapath::{DEFAULT_DOMAIN_FLAG, Format, Overflow, Rounding};
use cardan_numerics::tape::{NO_NODE, Reals, Runner, Tape, Words, bounds, gains};
use common::{At, Everything, Fir, Iir, NODES, words_of};
use proptest::prelude::*;

use cardan_numerics::Datapath;

fn any_formats() -> impl Strategy<Value = Vec<Format>> {
    let format = (4u32..=24, 0u32..=12, 0usize..6, 0usize..3).prop_map(|(word, frac, r, o)| {
        Format::new(word, frac, Rounding::ALL[r].0, Overflow::ALL[o].0)
    });
    proptest::collection::vec(format, NODES)
}

/// Every word of a run lies within its node's bounds, limited to its format; nodes whose bounds fit
/// their format do not overflow.
fn assert_bounds<A: Datapath>(datapath: &A, steps: &[Vec<i32>], formats: &[Format], limit: i32) {
    let (tape, inputs) = Tape::record(datapath, steps).expect("is steady");
    let ports = vec![(-limit, limit); inputs.raws.len()];
    let bounds = bounds(&tape, &ports, formats);
    let mut words = Words::new(formats, DEFAULT_DOMAIN_FLAG);
    let mut runner = Runner::new(&tape, &mut words);
    for step in 0..inputs.steps {
        let items = runner.step(&mut words, &inputs, step).to_vec();
        for (entry, item) in tape.body(step).iter().zip(items) {
            if entry.node == NO_NODE || !entry.op.is_recorded() {
                continue;
            }
            let node = entry.node as usize;
            let (format, bound) = (formats[node], bounds[node].expect("is written"));
            let value = format.real(item.raw);
            let within = words_of(bound, format);
            assert!(
                value >= within.lo && value <= within.hi,
                "node {node}: {value} outside {bound:?}"
            );
        }
    }
    for (node, bound) in bounds.iter().enumerate() {
        if bound
            .as_ref()
            .is_some_and(|bound| bound.fits(formats[node]))
        {
            assert_eq!(
                words.counts[node].overflows.count, 0,
                "node {node} is proven"
            );
        }
    }
}

fn any_steps(ports: usize) -> impl Strategy<Value = Vec<Vec<i32>>> {
    let step = proptest::collection::vec(-300i32..=300, ports);
    proptest::collection::vec(step, 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_run_leaves_the_derived_bounds(steps in any_steps(3), formats in any_formats()) {
        assert_bounds(&Everything, &steps, &formats, 300);
    }

    #[test]
    fn no_feedback_leaves_the_derived_bounds(steps in any_steps(1), formats in any_formats()) {
        assert_bounds(&Iir, &steps, &formats, 300);
        assert_bounds(&Fir, &steps, &formats, 300);
    }
}

/// Gains against differences: one write moved by a little, the whole run repeated.
#[test]
fn gains_are_derivatives_through_feedback() {
    let steps: Vec<Vec<i32>> = (0..30).map(|at| vec![(at * 37) % 101 - 50]).collect();
    let (tape, inputs) = Tape::record(&Iir, &steps).expect("is steady");
    let formats = vec![Format::new(64, 20, Rounding::Floor, Overflow::Saturate); NODES];
    let reals = Reals::run(&tape, &inputs, &formats, DEFAULT_DOMAIN_FLAG);
    let target = tape.last_write(2).expect("the output");
    let weights: Vec<f64> = (0..30).map(|at| if at == 25 { 1.0 } else { 0.0 }).collect();
    let mut found = vec![0.0; 30];
    gains(&tape, &reals, target, &weights, |step, index, gain| {
        if index == target {
            found[step] = gain;
        }
    });
    // y = x - 0.7 y1 + 0.7 y2: its response to a change of itself.
    let mut response = vec![1.0, -0.7];
    for at in 2..26 {
        response.push(-0.7 * response[at - 1] + 0.7 * response[at - 2]);
    }
    for step in tape.transient.len()..=25 {
        assert!(
            (found[step] - response[25 - step]).abs() < 1e-12,
            "step {step}"
        );
    }
    assert!(
        found[26..].iter().all(|gain| *gain == 0.0),
        "nothing acts backwards"
    );
    let _ = At::<0>;
}
