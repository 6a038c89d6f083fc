//! Inputs that make a node overflow, found by search: random ones, corners, and both by channel.

use cardan_datapath::Format;
use cardan_numerics::tape::{Inputs, Runner, Words};
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};
use serde::Serialize;

use crate::problem::{Case, Problem};
use crate::ranges::{NodeRange, writes_per_step};

/// An input that makes a node overflow.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Witness {
    /// The raw inputs of the step.
    pub inputs: Vec<i32>,
    /// Steps of the same search that went before it; they matter only through what steps leave to
    /// each other.
    pub steps_before: usize,
}

/// Looks for witnesses for the nodes that are neither proven nor overflowed in simulation.
pub(crate) fn search(
    problem: &Problem,
    formats: &[Format],
    nodes: &mut [NodeRange],
    steps: usize,
    seed: u64,
) {
    let open = |node: &NodeRange| {
        !node.proven && node.overflows == 0 && !node.wraps_by_design && node.samples > 0
    };
    let Some(case) = problem.tuning.first() else {
        return;
    };
    if steps == 0 || !nodes.iter().any(open) {
        return;
    }
    let inputs = drawn(case, steps, seed);
    let mut words = Words::new(formats, problem.domain_flag);
    let mut runner = Runner::new(&case.tape, &mut words);
    let mut first = vec![None; nodes.len()];
    let writes = writes_per_step(&case.tape, nodes.len());
    for step in 0..steps {
        runner.step(&mut words, &inputs, step);
        for (node, first) in first.iter_mut().enumerate() {
            if first.is_none() && writes[node] > 0 && words.counts[node].overflows.count > 0 {
                *first = Some(step);
            }
        }
    }
    for (node, step) in nodes.iter_mut().zip(first) {
        if let (true, Some(step)) = (open(node), step) {
            node.witness = Some(Witness {
                inputs: inputs.raws.iter().map(|port| port[step]).collect(),
                steps_before: step,
            });
        }
    }
}

/// Random steps within the bounds of the ports.
fn drawn(case: &Case, steps: usize, seed: u64) -> Inputs {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = |lo: i32, hi: i32| {
        let span = (i64::from(hi) - i64::from(lo) + 1).unsigned_abs();
        (i64::from(lo) + (rng.next_u64() % span).cast_signed()) as i32
    };
    let middle = |lo: i32, hi: i32| ((i64::from(lo) + i64::from(hi)) / 2) as i32;
    let mut raws = vec![Vec::with_capacity(steps); case.ports.len()];
    for step in 0..steps {
        // Each channel rests somewhere or in a corner, with or without noise; or anything goes.
        let kind = step % 4;
        let bases: Vec<i32> = (0..case.channels)
            .map(|channel| {
                let (lo, hi) = case.ports.get(channel).copied().unwrap_or((0, 0));
                if kind == 0 {
                    [lo, hi, middle(lo, hi)][uniform(0, 2).unsigned_abs() as usize]
                } else {
                    uniform(lo, hi)
                }
            })
            .collect();
        for (port, (lo, hi)) in case.ports.iter().enumerate() {
            let raw = match kind {
                0 | 1 => bases[port % case.channels].clamp(*lo, *hi),
                2 => (bases[port % case.channels].saturating_add(uniform(-4, 4))).clamp(*lo, *hi),
                _ => uniform(*lo, *hi),
            };
            raws[port].push(raw);
        }
    }
    Inputs {
        raws,
        truths: vec![vec![false; steps]; case.inputs.truths.len()],
        steps,
    }
}
