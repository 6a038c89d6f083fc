//! Integer bits given up where saturation does no harm: the overflow mode as a part of the search.
//!
//! A range that ends at a power of two (a cosine's 1) takes an integer bit for that one value, and
//! values of solutions that are flagged anyway need not be held exactly. Guard bits stay: they are
//! added to what judged steps take.

use cardan_numerics::tape::NO_NODE;

use crate::budget::{Budget, Constraint, Measure, Subject};
use crate::evaluate::Prepared;
use crate::pool::Pool;
use crate::problem::Problem;
use crate::ranges::{NodeRange, Ranges, integer_bits};
use crate::space::{LONGEST, Space};

/// A range may pass a power of two by this share of it: saturation then costs less than an LSB of a
/// word of eight bits.
const PAST_THE_END: f64 = 1.0 / 256.0;
/// Errors may grow by this share of what long words have anyway.
const HARMLESS: f64 = 0.02;
/// Or to this share of the quantity's size. Neither depends on the budget's limit: a looser one must not
/// search in another space.
const UNSEEN: f64 = 1.0 / 262_144.0;

/// Per constraint the value up to which saturation has done no harm.
fn allowed(
    problem: &Problem,
    prepared: &[Prepared<'_>],
    budget: &Budget,
    values: &[f64],
) -> Vec<f64> {
    let allowed = |(constraint, &value): (&Constraint, &f64)| match constraint.measure {
        Measure::Error(_, subject, _) => {
            value * (1.0 + HARMLESS) + UNSEEN * size(problem, prepared, subject)
        }
        Measure::Lsb(_) => value * (1.0 + HARMLESS) + 0.5,
        Measure::Sqnr(_) => value - 0.2,
        Measure::Flags => value + HARMLESS * constraint.limit,
        Measure::Overflow(_) | Measure::Cycles | Measure::Flash => value,
    };
    budget.0.iter().zip(values).map(allowed).collect()
}

/// The largest root mean square of what the error is of, in budgets' units.
pub(super) fn size(problem: &Problem, prepared: &[Prepared<'_>], subject: Subject) -> f64 {
    let rms = |at: usize| {
        let quantity = &problem.quantities[at];
        let of = |one: &Prepared<'_>| {
            let series = one.case.references.get(at).map_or(&[][..], Vec::as_slice);
            let judged = series
                .iter()
                .zip(one.judged())
                .filter(|(_, judged)| **judged);
            let square: f64 = judged.map(|(value, _)| value * value).sum();
            (square / one.count().max(1) as f64).sqrt() * quantity.scale
        };
        prepared.iter().map(of).fold(0.0, f64::max)
    };
    match subject {
        Subject::Quantity(at) => rms(at),
        Subject::Combined(_) => (0..problem.quantities.len()).map(rms).fold(0.0, f64::max),
    }
}

/// The integer bits that remain.
pub(super) fn trimmed(
    problem: &Problem,
    prepared: &[Prepared<'_>],
    (budget, pool): (&Budget, &Pool<'_>),
    ranges: &Ranges,
    space: &Space,
) -> Vec<i32> {
    let least = least(problem, ranges);
    let mut integer = space.integer().to_vec();
    let score = |integer: &[i32]| {
        let formats = space.with_integer(integer).uniform(LONGEST);
        pool.score(&formats)
    };
    let whole = score(&integer);
    if !whole.is_feasible() {
        return integer;
    }
    let allowed = allowed(problem, prepared, budget, &whole.values);
    let is_harmless = |integer: &[i32]| {
        let found = score(integer);
        let pairs = found.values.iter().zip(&allowed).zip(&budget.0);
        found.is_feasible()
            && pairs.into_iter().all(|((found, allowed), constraint)| {
                constraint.ratio(*found) <= constraint.ratio(*allowed)
            })
    };
    for group in &space.groups {
        for &node in &group.nodes {
            let own = integer[node];
            // As low as it may go, else a bit at a time.
            for tried in least[node]..own {
                integer[node] = tried;
                if is_harmless(&integer) {
                    break;
                }
                integer[node] = own;
            }
        }
    }
    integer
}

/// Per node the integer bits of what judged steps take, with guard bits where nothing is proven.
/// Those of every run count: a word that is too short for a run that nothing was tuned on is wrong there
/// by as much as it can hold.
fn least(problem: &Problem, ranges: &Ranges) -> Vec<i32> {
    let mut spans: Vec<Option<(f64, f64)>> = vec![None; ranges.nodes.len()];
    for case in problem.cases() {
        judged_spans(&Prepared::new(problem, case), &mut spans);
    }
    let bits = |(range, span): (&NodeRange, &Option<(f64, f64)>)| {
        // What is meant to wrap needs its range, and an input what its port allows, whatever is judged;
        // settings and constants take what they take.
        if range.by_design || range.is_input || range.samples == 0 {
            return range.integer;
        }
        let to_end = |(lo, hi): (f64, f64)| {
            let shrunk = |value: f64| value / (1.0 + PAST_THE_END);
            // Just below the end: the end itself saturates.
            integer_bits(shrunk(lo), shrunk(hi))
        };
        let guard = ranges.guard_bits.cast_signed();
        let simulated = span.and_then(to_end).map(|bits| bits + guard);
        let derived = range.derived_affine.ends().and_then(to_end);
        let needed = [simulated, derived].into_iter().flatten().min();
        needed.map_or(range.integer, |bits| bits.min(range.integer))
    };
    ranges.nodes.iter().zip(&spans).map(bits).collect()
}

/// Widens each node's span by what it takes in judged steps.
fn judged_spans(one: &Prepared<'_>, spans: &mut [Option<(f64, f64)>]) {
    for (step, values) in one.reals.steps.iter().enumerate() {
        if !one.judged()[step] {
            continue;
        }
        for (entry, &value) in one.case.tape.body(step).iter().zip(values) {
            if entry.node != NO_NODE && entry.op.is_recorded() {
                let span = &mut spans[entry.node as usize];
                *span =
                    Some(span.map_or((value, value), |(lo, hi)| (lo.min(value), hi.max(value))));
            }
        }
    }
}
