//! Which nodes wrap because they are meant to.

use cardan_datapath::{Format, Overflow};
use cardan_numerics::tape::{Reals, Runner, Words};

use crate::evaluate::difference;
use crate::problem::{Case, Problem};

/// Outputs that differ by less than this share of their largest value are the same.
const SAME: f64 = 1e-9;

/// Per node, whether wrapping is right. It is right for an angle or the like: a node in the unit of a
/// quantity with a period, whose range is a multiple of that period. And it is right where it shows in
/// no output (the integrators of a decimating filter): the outputs on real numbers are the same
/// when that node does not wrap. All other nodes that wrap do so by accident.
pub(crate) fn wraps_by_design(problem: &Problem) -> Vec<bool> {
    let formats = problem.deployed();
    let mut by_design: Vec<bool> = (0..formats.len())
        .map(|node| is_periodic(problem, node))
        .collect();
    let wraps = |node: &usize| formats[*node].overflow == Overflow::Wrap && !by_design[*node];
    let open: Vec<usize> = (0..formats.len()).filter(wraps).collect();
    if open.is_empty() || problem.quantities.is_empty() {
        return by_design;
    }
    let mut wrapped = vec![false; formats.len()];
    for case in problem.cases() {
        let counts = overflows(problem, case, &formats);
        for &node in open.iter().filter(|&&node| counts[node] > 0) {
            let shows = shows(problem, case, &formats, node);
            by_design[node] = !shows && (by_design[node] || !wrapped[node]);
            wrapped[node] = true;
        }
    }
    by_design
}

fn is_periodic(problem: &Problem, node: usize) -> bool {
    let info = &problem.nodes[node];
    let integer = info.format.word.cast_signed() - info.format.frac.cast_signed();
    let range = libm::ldexp(1.0, integer);
    let is_multiple = |period: f64| range >= period && (range / period).fract() == 0.0;
    let fits = |quantity: &crate::Quantity| {
        let unit = problem.nodes[quantity.node].unit;
        unit == info.unit && quantity.period.is_some_and(is_multiple)
    };
    info.format.overflow == Overflow::Wrap && problem.quantities.iter().any(fits)
}

/// Overflows per node in the deployed formats.
fn overflows(problem: &Problem, case: &Case, formats: &[Format]) -> Vec<u64> {
    let mut words = Words::new(formats, problem.domain_flag);
    let mut runner = Runner::new(&case.tape, &mut words);
    for step in 0..case.inputs.steps {
        runner.step(&mut words, &case.inputs, step);
    }
    let count = |counts: &cardan_numerics::tape::WriteCounts| counts.overflows.count;
    words.counts.iter().map(count).collect()
}

/// Whether an output on real numbers changes when `node` does not wrap.
fn shows(problem: &Problem, case: &Case, formats: &[Format], node: usize) -> bool {
    let mut others = formats.to_vec();
    others[node].overflow = Overflow::Saturate;
    let run = |formats: &[Format]| Reals::run(&case.tape, &case.inputs, formats, 0);
    let (with, without) = (run(formats), run(&others));
    problem.quantities.iter().any(|quantity| {
        let series = |reals: &Reals| -> Vec<f64> {
            let value = |(step, values): (usize, &Vec<f64>)| {
                let write = case.tape.last_write_in(step, quantity.node)?;
                Some(values[write])
            };
            reals.steps.iter().enumerate().filter_map(value).collect()
        };
        let (a, b) = (series(&with), series(&without));
        let largest = a.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let is_same =
            |(a, b): (&f64, &f64)| difference(*a, *b, quantity.period).abs() <= SAME * largest;
        !a.iter().zip(&b).all(is_same)
    })
}
