//! Affine bounds hold for every run of any algorithm, are never wider than intervals, and are exact
//! where an algorithm is linear.

mod common;

use cardan_datapath::{DEFAULT_DOMAIN_FLAG, Format, Overflow, Rounding};
use cardan_numerics::tape::{
    Entry, Inputs, Interval, NO_NODE, Op, Reals, Ref, Runner, Tape, Words, affine_bounds, bounds,
};
use cardan_numerics::{Datapath, tape};
use common::{Everything, Fir, Iir, NODES, words_of};
use proptest::prelude::*;

const PORTS: usize = 3;
const LIMIT: i32 = 300;

const WIDE: Format = Format::new(48, 20, Rounding::NearestUp, Overflow::Saturate);

fn any_format() -> impl Strategy<Value = Format> {
    (3u32..=24, 0u32..=14, 0usize..6, 0usize..3).prop_map(|(word, frac, r, o)| {
        Format::new(word, frac, Rounding::ALL[r].0, Overflow::ALL[o].0)
    })
}

/// What an operation is drawn from.
type Draw = (u8, u16, u16, u16);

const TABLE: &[f64] = &[0.5, -0.25, 3.0, 0.125, -7.0];

/// An operation whose operands are among `values` and `truths`, or are of earlier steps.
fn drawn((kind, a, b, c): Draw, values: &[Ref], truths: &[Ref]) -> (bool, Op<Ref>) {
    let value = |draw: u16| values[draw as usize % values.len()];
    let truth = |draw: u16| truths[draw as usize % truths.len()];
    let (x, y) = (value(a), value(b));
    match kind % 19 {
        0 => (
            true,
            Op::Input {
                port: u32::from(a) % PORTS as u32,
                frac: i32::from(b % 10),
            },
        ),
        1 | 2 => (true, Op::Add(x, y)),
        3 | 4 => (true, Op::Sub(x, y)),
        5 | 6 => (true, Op::Mul(x, y)),
        7 => (true, Op::Mul(x, x)),
        8 => (true, Op::Div(x, y)),
        9 => (true, Op::Sqrt(x)),
        10 => (true, Op::Shift(x, i32::from(b % 7) - 3)),
        11 => (true, Op::Neg(x)),
        12 => (true, Op::Abs(x)),
        13 => (true, Op::Select(truth(c), x, y)),
        14 => (true, Op::Lookup(x, TABLE)),
        15 => (false, Op::Less(x, y)),
        16 => (false, Op::Negative(x)),
        17 => (false, Op::Xor(truth(a), truth(b))),
        _ => (false, Op::Not(truth(a))),
    }
}

/// A tape of any operations with references to earlier steps; a node for each. Before there were
/// enough steps, a constant takes their place. Limits (the smaller of two) follow the operations.
fn any_tape() -> impl Strategy<Value = Tape> {
    let draw = (any::<u8>(), any::<u16>(), any::<u16>(), any::<u16>());
    let state = (0u32..3, any::<u16>());
    let states = proptest::collection::vec(state, 0..3);
    (proptest::collection::vec(draw, 2..24), states).prop_map(|(draws, states)| {
        let before = vec![
            Entry {
                node: 0,
                op: Op::Constant(0.5),
            },
            Entry {
                node: NO_NODE,
                op: Op::Known(false),
            },
        ];
        let mut kinds = Vec::new();
        let (mut values, mut truths) = (vec![Ref::Before(0)], vec![Ref::Before(1)]);
        // Whatever they point at is checked below to be a value.
        for &(back, index) in &states {
            let index = u32::from(index) % draws.len() as u32;
            values.push(Ref::Ago {
                steps: back + 1,
                index,
            });
        }
        let mut steady: Vec<Entry> = Vec::new();
        for (at, draw) in draws.into_iter().enumerate() {
            let (is_value, op) = drawn(draw, &values, &truths);
            let here = Ref::Here(at as u32);
            if is_value {
                values.push(here)
            } else {
                truths.push(here)
            }
            kinds.push(is_value);
            let node = if is_value { 1 + at as u32 } else { NO_NODE };
            steady.push(Entry { node, op });
        }
        let known = |operand: Ref, step: u32| match operand {
            Ref::Ago { index, .. } if !kinds[index as usize] => Ref::Before(0),
            Ref::Ago { steps, .. } if steps > step => Ref::Before(0),
            other => other,
        };
        let at_step = |step: u32| {
            let entry = |entry: &Entry| Entry {
                node: entry.node,
                op: entry.op.map(|operand| known(operand, step)),
            };
            steady.iter().map(entry).collect()
        };
        Tape {
            before,
            transient: (0..3).map(at_step).collect(),
            steady: at_step(3),
        }
    })
}

fn inputs(steps: &[Vec<i32>]) -> Inputs {
    Inputs {
        raws: (0..PORTS)
            .map(|port| steps.iter().map(|step| step[port]).collect())
            .collect(),
        truths: Vec::new(),
        steps: steps.len(),
    }
}

fn assert_words(tape: &Tape, inputs: &Inputs, formats: &[Format]) {
    let ports = vec![(-LIMIT, LIMIT); inputs.raws.len()];
    let affine = affine_bounds(tape, &ports, formats);
    let plain = bounds(tape, &ports, formats);
    for (affine, plain) in affine.iter().zip(&plain) {
        assert_eq!(affine.is_some(), plain.is_some());
        if let (Some(affine), Some(plain)) = (affine, plain) {
            assert!(
                affine.lo >= plain.lo && affine.hi <= plain.hi && affine.lo <= affine.hi,
                "{affine:?} is wider than {plain:?}"
            );
        }
    }
    let mut words = Words::new(formats, DEFAULT_DOMAIN_FLAG);
    let mut runner = Runner::new(tape, &mut words);
    for step in 0..inputs.steps {
        let items = runner.step(&mut words, inputs, step).to_vec();
        for (entry, item) in tape.body(step).iter().zip(items) {
            if entry.node == NO_NODE || !entry.op.is_recorded() {
                continue;
            }
            let node = entry.node as usize;
            let bound = affine[node].expect("is written");
            let (value, within) = (formats[node].real(item.raw), words_of(bound, formats[node]));
            assert!(
                value >= within.lo && value <= within.hi,
                "step {step}, node {node}: {value} outside {bound:?}: {entry:?}"
            );
        }
    }
    for (node, bound) in affine.iter().enumerate() {
        let format = formats[node];
        let overflows = words.counts[node].overflows.count;
        if let Some(bound) = bound {
            assert!(
                !bound.fits(format) || overflows == 0,
                "node {node} is proven"
            );
        }
    }
}

fn any_steps(ports: usize) -> impl Strategy<Value = Vec<Vec<i32>>> {
    let word = prop_oneof![3 => -LIMIT..=LIMIT, 1 => Just(LIMIT), 1 => Just(-LIMIT)];
    proptest::collection::vec(proptest::collection::vec(word, ports), 1..40)
}

fn assert_datapath<A: Datapath>(datapath: &A, steps: &[Vec<i32>], formats: &[Format]) {
    let (tape, inputs) = Tape::record(datapath, steps).expect("is steady");
    assert_words(&tape, &inputs, formats);
}

proptest! {
    // Runs in which the real interpretation meets a format's end are drawn again.
    #![proptest_config(ProptestConfig {
        cases: 1500,
        max_global_rejects: 100_000,
        ..ProptestConfig::default()
    })]

    #[test]
    fn no_word_of_any_tape_leaves_its_affine_bounds(
        tape in any_tape(),
        steps in any_steps(PORTS),
        formats in proptest::collection::vec(any_format(), 25),
    ) {
        assert_words(&tape, &inputs(&steps), &formats);
    }

    #[test]
    fn no_real_value_of_any_tape_leaves_its_affine_bounds(
        tape in any_tape(),
        steps in any_steps(PORTS),
        frac in 16u32..24,
    ) {
        let format = Format::new(52, frac, Rounding::Floor, Overflow::Saturate);
        let formats = vec![format; 25];
        let inputs = inputs(&steps);
        let reals = Reals::run(&tape, &inputs, &formats, DEFAULT_DOMAIN_FLAG);
        // The real interpretation has no ends; where words have met theirs, both part.
        prop_assume!(reals.status.iter().all(|status| *status == 0));
        let largest = format.real(format.max_raw()) / 4.0;
        let mut values = reals.steps.iter().flatten();
        prop_assume!(values.all(|value| value.abs() < largest));
        let found = affine_bounds(&tape, &[(-LIMIT, LIMIT); PORTS], &formats);
        for (step, values) in reals.steps.iter().enumerate() {
            for (entry, value) in tape.body(step).iter().zip(values) {
                if entry.node == NO_NODE {
                    continue;
                }
                let bound = found[entry.node as usize].expect("is written");
                // The real interpretation's own rounding.
                let slack = 1e-9 * (1.0 + value.abs());
                prop_assert!(
                    *value >= bound.lo - slack && *value <= bound.hi + slack,
                    "step {}: {} outside {:?}: {:?}", step, value, bound, entry
                );
            }
        }
    }

    #[test]
    fn no_run_of_an_algorithm_leaves_its_affine_bounds(
        steps in any_steps(3),
        formats in proptest::collection::vec(any_format(), NODES),
    ) {
        assert_datapath(&Everything, &steps, &formats);
    }

    #[test]
    fn no_feedback_and_no_delay_leaves_its_affine_bounds(
        steps in any_steps(1),
        formats in proptest::collection::vec(any_format(), NODES),
    ) {
        assert_datapath(&Iir, &steps, &formats);
        assert_datapath(&Fir, &steps, &formats);
    }

    /// Sums and differences of sums and differences, in exact formats: the extremes are those of the
    /// coefficients, to the last bit.
    #[test]
    fn linear_algorithms_are_bounded_exactly(
        draws in proptest::collection::vec((any::<bool>(), any::<u16>(), any::<u16>()), 1..20),
    ) {
        let mut ops = vec![input(0), input(1), input(2)];
        let mut coefficients: Vec<[f64; PORTS]> =
            vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for (minus, a, b) in draws {
            let (a, b) = (a as usize % ops.len(), b as usize % ops.len());
            let (x, y) = (here(a), here(b));
            ops.push(if minus { Op::Sub(x, y) } else { Op::Add(x, y) });
            let sign = if minus { -1.0 } else { 1.0 };
            let of = |port: usize| coefficients[a][port] + sign * coefficients[b][port];
            coefficients.push([of(0), of(1), of(2)]);
        }
        let largest: f64 = coefficients.iter().flatten().fold(0.0, |max, c| c.abs().max(max));
        prop_assume!(largest < 1e5);
        let found = derive(&ops, WIDE, &[]);
        for (bound, coefficients) in found.iter().zip(coefficients) {
            let size: f64 = coefficients.iter().map(|c| c.abs() * f64::from(LIMIT)).sum();
            prop_assert_eq!(*bound, Interval::new(-size, size));
        }
    }
}

const fn input(port: u32) -> Op<Ref> {
    Op::Input { port, frac: 0 }
}

const fn here(index: usize) -> Ref {
    Ref::Here(index as u32)
}

/// Affine bounds of straight-line operations, a node each; `ports` all ±300 if not given.
fn derive(ops: &[Op<Ref>], format: Format, ports: &[(i32, i32)]) -> Vec<Interval> {
    both(ops, format, ports).0
}

/// Affine bounds and intervals.
fn both(ops: &[Op<Ref>], format: Format, ports: &[(i32, i32)]) -> (Vec<Interval>, Vec<Interval>) {
    let entry = |(node, &op): (usize, &Op<Ref>)| Entry {
        node: node as u32,
        op,
    };
    let tape = Tape {
        before: Vec::new(),
        transient: Vec::new(),
        steady: ops.iter().enumerate().map(entry).collect(),
    };
    let all = [(-LIMIT, LIMIT); PORTS];
    let ports = if ports.is_empty() { &all } else { ports };
    let formats = vec![format; ops.len()];
    let known = |bounds: Vec<Option<Interval>>| -> Vec<Interval> {
        let point = Interval::new(0.0, 0.0);
        bounds
            .into_iter()
            .map(|bound| bound.unwrap_or(point))
            .collect()
    };
    (
        known(affine_bounds(&tape, ports, &formats)),
        known(tape::bounds(&tape, ports, &formats)),
    )
}

#[test]
fn a_value_less_itself_is_zero_even_after_it_was_rounded() {
    let coarse = Format::new(16, 2, Rounding::NearestEven, Overflow::Saturate);
    let ops = [
        Op::Input { port: 0, frac: 6 },
        Op::Sub(here(0), here(0)),
        Op::Shift(here(0), -3),
        Op::Sub(here(2), here(2)),
    ];
    let (affine, plain) = both(&ops, coarse, &[]);
    assert_eq!(affine[1], Interval::new(0.0, 0.0));
    assert_eq!(affine[3], Interval::new(0.0, 0.0));
    assert!(plain[1].hi > 9.0 && plain[3].hi > 1.0, "{plain:?}");
}

/// Stolfi and de Figueiredo, section 3.4.2: (10 + x + r) (10 - x + s), x in -2..=2, r and s in
/// -1..=1. Intervals say 49..=169, affine forms 71..=129, the truth is 71..=121.
#[test]
fn the_textbook_product_is_as_in_the_textbook() {
    let ops = [
        input(0),
        input(1),
        input(2),
        Op::Constant(10.0),
        Op::Add(here(3), here(0)),
        Op::Add(here(4), here(1)),
        Op::Sub(here(3), here(0)),
        Op::Add(here(6), here(2)),
        Op::Mul(here(5), here(7)),
    ];
    let (affine, plain) = both(&ops, WIDE, &[(-2, 2), (-1, 1), (-1, 1)]);
    assert!(plain[8].lo > 48.999 && plain[8].lo <= 49.0, "{plain:?}");
    assert!(plain[8].hi < 169.001 && plain[8].hi >= 169.0, "{plain:?}");
    assert!(affine[8].lo > 70.999 && affine[8].lo <= 71.0, "{affine:?}");
    assert!(
        affine[8].hi < 129.001 && affine[8].hi >= 121.0,
        "{affine:?}"
    );
}

#[test]
fn a_common_factor_cancels_where_intervals_keep_it() {
    // a (b + c) - a b with c small is about a c.
    let ops = [
        input(0),
        input(1),
        input(2),
        Op::Add(here(1), here(2)),
        Op::Mul(here(0), here(3)),
        Op::Mul(here(0), here(1)),
        Op::Sub(here(4), here(5)),
    ];
    let (affine, plain) = both(&ops, WIDE, &[(90, 110), (90, 110), (-1, 1)]);
    assert!(plain[6].hi > 3900.0, "{plain:?}");
    assert!(affine[6].hi >= 110.0 && affine[6].hi < 420.0, "{affine:?}");
    assert!(
        affine[6].lo <= -110.0 && affine[6].lo > -420.0,
        "{affine:?}"
    );
}

#[test]
fn a_quotient_a_root_and_a_magnitude_know_their_operand() {
    // x / (x + 1), x in 4..=8: the truth is 0.8..=0.889, intervals say 0.44..=1.6.
    let ops = [
        input(0),
        Op::Constant(1.0),
        Op::Add(here(0), here(1)),
        Op::Div(here(0), here(2)),
        // sqrt(x) - x / 4, which is 1 at both ends and nearly constant.
        Op::Sqrt(here(0)),
        Op::Shift(here(0), -2),
        Op::Sub(here(4), here(5)),
        // |x| - x, as x is never negative.
        Op::Abs(here(0)),
        Op::Sub(here(7), here(0)),
    ];
    let (affine, plain) = both(&ops, WIDE, &[(4, 8)]);
    assert!(plain[3].width_over(0.8, 0.889) > 1.0, "{plain:?}");
    assert!(affine[3].width_over(0.8, 0.889) < 0.25, "{affine:?}");
    assert!(plain[6].width_over(0.828, 1.0) > 1.0, "{plain:?}");
    assert!(affine[6].width_over(0.829, 1.0) < 0.1, "{affine:?}");
    assert_eq!(affine[8], Interval::new(0.0, 0.0));
}

/// How much wider than the truth.
trait Excess {
    fn width_over(self, lo: f64, hi: f64) -> f64;
}

impl Excess for Interval {
    fn width_over(self, lo: f64, hi: f64) -> f64 {
        assert!(self.lo <= lo && self.hi >= hi, "{self:?} holds the truth");
        (self.hi - self.lo) - (hi - lo)
    }
}

/// y = y' - y'/4 + x/4 lies between the ends of x. Intervals take the first two terms apart, grow
/// without end and know the format's range only.
#[test]
fn a_low_pass_stays_within_its_input() {
    let ago = Ref::Ago { steps: 1, index: 4 };
    let step = |before: Ref| {
        let ops = [
            Op::Input { port: 0, frac: 8 },
            Op::Shift(here(0), -2),
            Op::Shift(before, -2),
            Op::Sub(before, here(2)),
            Op::Add(here(3), here(1)),
        ];
        let entry = |(node, op): (usize, Op<Ref>)| Entry {
            node: node as u32,
            op,
        };
        ops.into_iter().enumerate().map(entry).collect::<Vec<_>>()
    };
    let tape = Tape {
        before: vec![Entry {
            node: 5,
            op: Op::Constant(0.0),
        }],
        transient: vec![step(Ref::Before(0))],
        steady: step(ago),
    };
    let format = Format::new(20, 14, Rounding::NearestUp, Overflow::Wrap);
    let formats = [format; 6];
    let plain = bounds(&tape, &[(-256, 256)], &formats)[4].expect("is written");
    let affine = affine_bounds(&tape, &[(-256, 256)], &formats)[4].expect("is written");
    assert!(plain.hi > 30.0, "{plain:?}");
    assert!(affine.hi >= 0.999 && affine.hi < 1.01, "{affine:?}");
    assert!(affine.lo <= -0.999 && affine.lo > -1.01, "{affine:?}");
}

#[test]
fn a_limit_is_known_to_limit() {
    // min(x, 10) - x is never positive; a comparison of correlated values decides itself.
    let ops = [
        input(0),
        Op::Constant(10.0),
        Op::Less(here(0), here(1)),
        Op::Select(here(2), here(0), here(1)),
        Op::Sub(here(3), here(0)),
        Op::Constant(1.0),
        Op::Add(here(0), here(5)),
        Op::Less(here(0), here(6)),
        Op::Select(here(7), here(5), here(0)),
    ];
    let entry = |(node, &op): (usize, &Op<Ref>)| Entry {
        node: if matches!(op, Op::Less(..)) {
            NO_NODE
        } else {
            node as u32
        },
        op,
    };
    let tape = Tape {
        before: Vec::new(),
        transient: Vec::new(),
        steady: ops.iter().enumerate().map(entry).collect(),
    };
    let formats = [WIDE; 9];
    let affine = affine_bounds(&tape, &[(0, 20)], &formats);
    let plain = bounds(&tape, &[(0, 20)], &formats);
    let (limited, before) = (
        affine[4].expect("is written"),
        plain[4].expect("is written"),
    );
    assert!(before.hi >= 10.0 && limited.hi <= 5.001, "{limited:?}");
    assert!(limited.lo <= -10.0 && limited.lo > -10.001, "{limited:?}");
    assert_eq!(affine[8], Some(Interval::new(1.0, 1.0)), "x < x + 1");
}

#[test]
fn hundreds_of_symbols_are_condensed_and_still_hold() {
    // The sum of 400 halves, each rounded.
    let mut ops = Vec::new();
    for port in 0..400 {
        ops.push(Op::Input { port, frac: 0 });
        ops.push(Op::Shift(here(2 * port as usize), -1));
    }
    let mut sum = 1;
    for term in 1..400 {
        ops.push(Op::Add(here(sum), here(2 * term + 1)));
        sum = ops.len() - 1;
    }
    let format = Format::new(24, 0, Rounding::Floor, Overflow::Saturate);
    let ports = vec![(-100, 100); 400];
    let found = derive(&ops, format, &ports);
    let total = found[sum];
    assert!(total.hi >= 20_000.0 && total.hi <= 20_400.0, "{total:?}");
    assert!(total.lo <= -20_000.0 && total.lo >= -20_400.0, "{total:?}");
}
