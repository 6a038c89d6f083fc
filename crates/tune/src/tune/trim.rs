//! Integer bits given up where saturation does no harm: the overflow mode as a part of the search.
//!
//! A range that ends at a power of two (a cosine's 1) takes an integer bit for that one value, and
//! values of solutions that are flagged anyway need not be held exactly. Guard bits stay: they are
//! added to what judged steps take.

use cardan_datapath::Overflow;
use cardan_numerics::tape::NO_NODE;

use crate::evaluate::Prepared;
use crate::pool::Pool;
use crate::problem::Problem;
use crate::ranges::{NodeRange, Ranges, integer_bits};
use crate::space::{LONGEST, Space};

/// A range may pass a power of two by this share of it: saturation then costs less than an LSB of a
/// word of eight bits.
const PAST_THE_END: f64 = 1.0 / 256.0;
/// At most this stretch of the limits is taken for no harm, beyond what long words have anyway.
const HARMLESS: f64 = 0.02;

/// The integer bits that remain.
pub(super) fn trimmed(
    problem: &Problem,
    prepared: &[Prepared<'_>],
    pool: &Pool<'_>,
    ranges: &Ranges,
    space: &Space,
) -> Vec<i32> {
    let least = least(problem, prepared, ranges);
    let mut integer = space.integer().to_vec();
    let ratio = |integer: &[i32]| {
        let formats = space.with_integer(integer).uniform(LONGEST);
        pool.score(&formats).ratio
    };
    let allowed = ratio(&integer) + HARMLESS;
    if allowed > 1.0 {
        return integer;
    }
    for group in &space.groups {
        for &node in &group.nodes {
            let own = integer[node];
            // As low as it may go, else a bit at a time.
            for tried in least[node]..own {
                integer[node] = tried;
                if ratio(&integer) <= allowed {
                    break;
                }
                integer[node] = own;
            }
        }
    }
    integer
}

/// Per node the integer bits of what judged steps take, with guard bits where nothing is proven.
fn least(problem: &Problem, prepared: &[Prepared<'_>], ranges: &Ranges) -> Vec<i32> {
    let mut spans: Vec<Option<(f64, f64)>> = vec![None; ranges.nodes.len()];
    for one in prepared {
        judged_spans(one, &mut spans);
    }
    let bits = |(range, span): (&NodeRange, &Option<(f64, f64)>)| {
        let deployed = problem
            .node(&range.name)
            .map(|node| problem.nodes[node].format);
        let wraps = deployed.is_none_or(|format| format.overflow == Overflow::Wrap);
        // What wraps needs its range, whatever is judged; settings and constants take what they take.
        if wraps || range.samples == 0 {
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
