//! What values nodes take: simulated next to derived, and the integer bits that follow.

use cardan_datapath::{Format, Overflow};
use cardan_numerics::tape::{
    Interval, NO_NODE, Op, Reals, Runner, Tape, Words, affine_bounds, beyond, bounds,
};
use serde::Serialize;

use crate::design::wraps_by_design;
use crate::problem::{Case, Problem};
use crate::witness::{self, Witness};

/// Values in the interval that a bit weight covers: 2^exponent <= |x| < 2^(exponent + 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Bin {
    /// The exponent.
    pub exponent: i32,
    /// Values.
    pub count: u64,
}

/// Where a node first overflowed in simulation.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct First {
    /// The case.
    pub case: String,
    /// Which of the node's writes, from 0.
    pub write: u64,
}

/// A closed interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounds {
    /// Lower end; none where nothing is known.
    pub lo: Option<f64>,
    /// Upper end.
    pub hi: Option<f64>,
}

impl Bounds {
    /// Both ends, where both are known.
    #[must_use]
    pub fn ends(&self) -> Option<(f64, f64)> {
        self.lo.zip(self.hi)
    }
}

/// What is known of one node.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeRange {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Word length of the deployed format.
    pub word: u32,
    /// Its fractional bits.
    pub frac: u32,
    /// Writes in simulation; 0 for constants and settings.
    pub samples: u64,
    /// Smallest simulated value (real interpretation).
    pub min: Option<f64>,
    /// Largest simulated value.
    pub max: Option<f64>,
    /// Values that are not 0 but under half the deployed last place.
    pub underflows: u64,
    /// Simulated magnitudes in powers of two; zeros are in none.
    pub histogram: Vec<Bin>,
    /// Bounds derived with intervals, before the value is limited to its format.
    pub derived: Bounds,
    /// The same with affine forms: never wider, since they know what values share.
    pub derived_affine: Bounds,
    /// No input can make it overflow, by the affine bounds.
    pub proven: bool,
    /// It holds an angle or the like: wrapping is right, and its range is its format's.
    pub wraps_by_design: bool,
    /// Wrapping is right there, whether or not this run showed it.
    pub by_design: bool,
    /// An input enters it.
    pub is_input: bool,
    /// A constant, setting or table entry that the deployed format does not hold: it saturates there,
    /// in every run, without a word.
    pub beyond: Option<f64>,
    /// Overflows of the deployed format in simulation.
    pub overflows: u64,
    /// The first of them.
    pub first_overflow: Option<First>,
    /// An input that makes it overflow, found by search where simulation showed none.
    pub witness: Option<Witness>,
    /// Integer bits (sign included) that the simulated values need.
    pub integer_simulated: Option<i32>,
    /// Integer bits that the affine bounds need.
    pub integer_derived: Option<i32>,
    /// Integer bits to use: the derived ones where they are no more than the simulated ones with
    /// their guard bits.
    pub integer: i32,
    /// It takes one value only: its range means nothing.
    pub unexcited: bool,
}

impl NodeRange {
    /// What is known of its overflows, in a few words.
    #[must_use]
    pub fn verdict(&self) -> String {
        /// Of a witness; the whole is in the document.
        const SHOWN: usize = 4;
        if let Some(value) = self.beyond {
            format!("the constant {value} is beyond it")
        } else if self.wraps_by_design {
            "wraps by design".to_owned()
        } else if self.overflows > 0 {
            format!("{} in simulation", self.overflows)
        } else if self.proven {
            "proven impossible".to_owned()
        } else if let Some(witness) = &self.witness {
            let shown = witness.inputs.len().min(SHOWN);
            format!("possible: input {:?}", &witness.inputs[..shown])
        } else {
            "none found".to_owned()
        }
    }
}

/// Ranges of all nodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranges {
    /// Per node.
    pub nodes: Vec<NodeRange>,
    /// Guard bits that were added to simulated ranges.
    pub guard_bits: u32,
    /// Simulated steps.
    pub steps: u64,
}

/// Integer bits with the sign of values from `lo` to `hi`: at least -62, so that a word of one bit
/// remains.
pub(crate) fn integer_bits(lo: f64, hi: f64) -> Option<i32> {
    if !(lo.is_finite() && hi.is_finite()) {
        return None;
    }
    let fits = |bits: &i32| {
        let half = libm::ldexp(1.0, bits - 1);
        lo >= -half && hi < half
    };
    (-62..=64).find(fits)
}

/// Ranges over all cases of `problem`. `search` steps of random inputs look for witnesses.
#[must_use]
pub fn ranges(problem: &Problem, guard_bits: u32, search: usize, seed: u64) -> Ranges {
    let formats = problem.deployed();
    let mut found: Vec<Collected> = vec![Collected::default(); problem.nodes.len()];
    for (node, wraps) in wraps_by_design(problem).into_iter().enumerate() {
        found[node].by_design = wraps;
    }
    let mut steps = 0;
    for case in problem.cases() {
        steps += case.inputs.steps as u64;
        simulate(problem, case, &formats, &mut found);
        let derived = bounds(&case.tape, &case.ports, &formats);
        let affine = affine_bounds(&case.tape, &case.ports, &formats);
        for ((collected, derived), affine) in found.iter_mut().zip(derived).zip(affine) {
            widen_by(&mut collected.derived, derived);
            widen_by(&mut collected.affine, affine);
        }
        for (collected, value) in found.iter_mut().zip(beyond(&case.tape, &formats)) {
            collected.beyond = collected.beyond.or(value);
        }
        note_inputs(case, &mut found);
    }
    let finish =
        |(node, collected): (usize, &Collected)| node_range(problem, node, collected, guard_bits);
    let mut nodes: Vec<NodeRange> = found.iter().enumerate().map(finish).collect();
    witness::search(problem, &formats, &mut nodes, search, seed);
    Ranges {
        nodes,
        guard_bits,
        steps,
    }
}

/// What the cases showed of a node.
#[derive(Clone, Debug, Default)]
struct Collected {
    samples: u64,
    span: Option<(f64, f64)>,
    /// Constants and settings, which are no samples.
    settings: Option<(f64, f64)>,
    underflows: u64,
    histogram: std::collections::BTreeMap<i32, u64>,
    derived: Option<(f64, f64)>,
    affine: Option<(f64, f64)>,
    overflows: u64,
    first: Option<First>,
    /// Wrapping is right.
    by_design: bool,
    /// What a constant is that the format does not hold.
    beyond: Option<f64>,
    /// An input enters it.
    is_input: bool,
}

fn note_inputs(case: &Case, found: &mut [Collected]) {
    let bodies = case.tape.transient.iter().chain([&case.tape.steady]);
    for entry in bodies.flatten() {
        if let (Op::Input { .. }, Some(node)) = (entry.op, found.get_mut(entry.node as usize)) {
            node.is_input = true;
        }
    }
}

fn widen(span: &mut Option<(f64, f64)>, value: f64) {
    *span = Some(span.map_or((value, value), |(lo, hi)| (lo.min(value), hi.max(value))));
}

fn widen_by(span: &mut Option<(f64, f64)>, bound: Option<Interval>) {
    if let Some(bound) = bound {
        widen(span, bound.lo);
        widen(span, bound.hi);
    }
}

fn simulate(problem: &Problem, case: &Case, formats: &[Format], found: &mut [Collected]) {
    let reals = Reals::run(&case.tape, &case.inputs, formats, problem.domain_flag);
    let body = |step: usize| case.tape.body(step);
    let before = case.tape.before.iter().zip(&reals.before);
    let stepwise = reals.steps.iter().enumerate();
    let stepwise = stepwise.flat_map(|(step, values)| body(step).iter().zip(values));
    for (entry, &value) in before.chain(stepwise) {
        if entry.node == NO_NODE {
            continue;
        }
        let collected = &mut found[entry.node as usize];
        if !entry.op.is_recorded() {
            widen(&mut collected.settings, value);
            continue;
        }
        collected.samples += 1;
        widen(&mut collected.span, value);
        if value != 0.0 {
            let exponent = libm::ilogb(value);
            *collected.histogram.entry(exponent).or_default() += 1;
            let half = formats[entry.node as usize].lsb() / 2.0;
            collected.underflows += u64::from(value.abs() < half);
        }
    }
    count_overflows(problem, case, formats, found);
}

fn count_overflows(problem: &Problem, case: &Case, formats: &[Format], found: &mut [Collected]) {
    let mut words = Words::new(formats, problem.domain_flag);
    let mut runner = Runner::new(&case.tape, &mut words);
    for step in 0..case.inputs.steps {
        runner.step(&mut words, &case.inputs, step);
    }
    for (collected, counts) in found.iter_mut().zip(&words.counts) {
        collected.overflows += counts.overflows.count;
        if let (None, Some(write)) = (&collected.first, counts.overflows.first) {
            collected.first = Some(First {
                case: case.name.clone(),
                write,
            });
        }
    }
}

fn node_range(problem: &Problem, node: usize, collected: &Collected, guard_bits: u32) -> NodeRange {
    let info = &problem.nodes[node];
    let format = info.format;
    let span = match (collected.span, collected.settings) {
        (Some(a), Some(b)) => Some((a.0.min(b.0), a.1.max(b.1))),
        (a, b) => a.or(b),
    };
    let derived = derived_bounds(collected.derived, span);
    let affine = derived_bounds(collected.affine, span);
    let deployed_integer = format.word.cast_signed() - format.frac.cast_signed();
    let half = libm::ldexp(1.0, deployed_integer - 1);
    let reaches = span.is_some_and(|(lo, hi)| lo < -half / 2.0 || hi >= half / 2.0);
    // What fills the range of a node that is meant to wrap is a value modulo that range.
    let wraps_by_design = collected.by_design && (reaches || collected.overflows > 0);
    let integer_simulated = span.and_then(|(lo, hi)| integer_bits(lo, hi));
    let integer_derived = affine.ends().and_then(|(lo, hi)| integer_bits(lo, hi));
    let guard = guard_bits.cast_signed();
    let guarded = integer_simulated.map(|bits| bits + guard);
    let integer = match (guarded, integer_derived) {
        // Another range would be another period.
        _ if collected.by_design => deployed_integer,
        // A wrap by accident hides what the node would need.
        _ if format.overflow == Overflow::Wrap && collected.overflows > 0 => deployed_integer,
        (Some(simulated), Some(derived)) => simulated.min(derived),
        (Some(simulated), None) => simulated,
        (None, _) => deployed_integer,
    };
    // Whatever a run shows, an input may take all that its port allows and its node held so far.
    let least = integer_derived.map_or(deployed_integer, |bits| bits.min(deployed_integer));
    let integer = if collected.is_input {
        integer.max(least)
    } else {
        integer
    };
    let constant = collected.derived.is_none() && collected.overflows == 0;
    let fits = |(lo, hi): (f64, f64)| Interval::new(lo, hi).fits(format);
    let proven = constant || affine.ends().is_some_and(fits);
    NodeRange {
        name: info.name.to_owned(),
        unit: info.unit.to_owned(),
        word: format.word,
        frac: format.frac,
        samples: collected.samples,
        min: span.map(|(lo, _)| lo),
        max: span.map(|(_, hi)| hi),
        underflows: collected.underflows,
        histogram: collected
            .histogram
            .iter()
            .map(|(&exponent, &count)| Bin { exponent, count })
            .collect(),
        derived,
        derived_affine: affine,
        proven: proven && collected.overflows == 0 && collected.beyond.is_none(),
        wraps_by_design,
        by_design: collected.by_design,
        is_input: collected.is_input,
        beyond: collected.beyond,
        overflows: collected.overflows,
        first_overflow: collected.first.clone(),
        witness: None,
        integer_simulated,
        integer_derived,
        integer,
        unexcited: collected.samples > 0 && collected.span.is_some_and(|(lo, hi)| lo == hi),
    }
}

/// Derived bounds of a node; settings and constants alone are what they are.
fn derived_bounds(derived: Option<(f64, f64)>, span: Option<(f64, f64)>) -> Bounds {
    let finite = |value: f64| value.is_finite().then_some(value);
    let ends = derived.or(span);
    Bounds {
        lo: ends.and_then(|(lo, _)| finite(lo)),
        hi: ends.and_then(|(_, hi)| finite(hi)),
    }
}

/// Writes of each node in one steady step.
pub(crate) fn writes_per_step(tape: &Tape, nodes: usize) -> Vec<u64> {
    let mut counts = vec![0; nodes];
    for entry in &tape.steady {
        if entry.node != NO_NODE && entry.op.is_recorded() {
            counts[entry.node as usize] += 1;
        }
    }
    counts
}
