//! What rounding is expected to make of a run holds for the run in fixed point itself: no value is
//! farther away than its deviation allows, deviations are not much too wide, status bits that are not
//! doubtful are those of the words.

mod common;

use cardan_datapath::{
    Arithmetic, Constant, DEFAULT_DOMAIN_FLAG, Format, Overflow, Rounding, Value,
};
use cardan_numerics::Datapath;
use cardan_numerics::tape::{Expected, NO_NODE, Reals, Tape, Uncertainty};
use cardan_numerics::trial::Trial;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

use common::{At, Everything, Fir, LAST, NODES, deployed};

/// Six deviations, which the propagation itself takes for the reach of an error.
const MOST_DEVIATIONS: f64 = 6.0;

/// Differences over deviations of a run, expected biases taken off.
struct Found {
    /// Steps behind the start-up that were compared.
    steps: usize,
    sum_of_squares: f64,
    count: usize,
    largest: f64,
}

/// Runs `datapath` in words and on real numbers, and asserts what is certain of both.
fn compare<D: Datapath>(datapath: &D, steps: &[Vec<i32>], formats: &[Format]) -> Found {
    let (tape, inputs) = Tape::record(datapath, steps).expect("is steady");
    let reals = Reals::run(&tape, &inputs, formats, DEFAULT_DOMAIN_FLAG);
    let mut trial = Trial::new(&tape, &inputs, DEFAULT_DOMAIN_FLAG);
    trial.run_all(formats);
    let mut uncertainty = Uncertainty::new(&tape, formats, DEFAULT_DOMAIN_FLAG);
    let mut found = Found {
        steps: 0,
        sum_of_squares: 0.0,
        count: 0,
        largest: 0.0,
    };
    for step in 0..inputs.steps {
        let mut writes: Vec<(usize, Expected)> = Vec::new();
        let raised = uncertainty.step(&inputs, step, |node, expected| {
            writes.push((node, expected))
        });
        assert_eq!(raised.status, reals.status[step], "step {step}");
        if step < tape.transient.len() {
            continue;
        }
        // A value that does not fit is no rounding: from there on nothing is claimed.
        let fits = |&(node, expected): &(usize, Expected)| {
            let format: Format = formats[node];
            let (least, most) = (format.real(format.min_raw()), format.real(format.max_raw()));
            (least..=most).contains(&expected.value)
        };
        if !writes.iter().all(fits) {
            return found;
        }
        let recorded = tape.steady.iter().enumerate();
        let recorded =
            recorded.filter(|(_, entry)| entry.node != NO_NODE && entry.op.is_recorded());
        assert_eq!(recorded.clone().count(), writes.len());
        found.steps += 1;
        for ((index, entry), (node, expected)) in recorded.zip(&writes) {
            assert_eq!(entry.node as usize, *node);
            assert_eq!(expected.value, reals.steps[step][index], "step {step}");
            let lsb = formats[*node].lsb();
            let word = trial.column(index).get(step) as f64 * lsb;
            let error = (word - expected.value - expected.bias).abs();
            let limit = MOST_DEVIATIONS * expected.deviation + 1e-3 * lsb;
            assert!(
                error <= limit,
                "step {step}, operation {index}: {error:e} beyond {limit:e} ({expected:?}, word {word})"
            );
            if expected.deviation > lsb * 1e-3 {
                let deviations = error / expected.deviation;
                found.sum_of_squares += deviations * deviations;
                found.largest = found.largest.max(deviations);
                found.count += 1;
            }
        }
    }
    found
}

fn steps(seed: u64, count: usize, ports: usize, most: i32) -> Vec<Vec<i32>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut next = || (random.next_u32() as i32) % most;
    (0..count)
        .map(|_| (0..ports).map(|_| next()).collect())
        .collect()
}

#[test]
fn the_errors_of_a_filter_have_the_deviation_that_is_expected_of_them() {
    let formats = vec![Format::new(24, 5, Rounding::NearestEven, Overflow::Saturate); NODES];
    let found = compare(&Fir, &steps(3, 5000, 1, 4000), &formats);
    let rms = (found.sum_of_squares / found.count as f64).sqrt();
    assert!((0.8..1.2).contains(&rms), "{rms} of {}", found.count);
}

struct Zero;
impl Constant for Zero {
    const VALUE: f64 = 0.0;
}

/// y += (x - y) / 4. (Of a second-order section only the sizes of its two words' errors are carried,
/// not how they belong together.)
struct LowPass;

impl Datapath for LowPass {
    type State<M: Arithmetic> = Value<M, At<2>>;
    fn start<M: Arithmetic>(&self, m: &M) -> Value<M, At<2>> {
        m.constant::<At<2>, Zero>()
    }
    fn step<M: Arithmetic>(&self, m: &M, y: &mut Value<M, At<2>>, inputs: &[i32]) {
        let x: Value<M, At<0>> = m.input::<At<0>, 7>(inputs[0]);
        let difference: Value<M, At<1>> = m.sub(x, *y);
        let quarter: Value<M, At<1>> = m.shift::<At<1>, At<1>, -2>(difference);
        *y = m.add(*y, quarter);
    }
}

#[test]
fn a_loop_s_errors_lie_within_what_is_expected_although_they_add_up() {
    for rounding in [Rounding::Floor, Rounding::NearestUp, Rounding::Zero] {
        let formats = vec![Format::new(24, 10, rounding, Overflow::Saturate); NODES];
        // Motion, and rest, where a dead band keeps its error for good.
        let mut inputs = steps(4, 500, 1, 1000);
        inputs.extend(vec![vec![333]; 500]);
        let found = compare(&LowPass, &inputs, &formats);
        assert!(
            found.count > 1000 && found.largest > 0.1,
            "{}",
            found.largest
        );
    }
}

#[test]
fn what_is_exact_is_expected_to_be_exact() {
    // Inputs with 7 fractional bits, weights of down to an eighth: 10 places hold every product and sum.
    let (tape, inputs) = Tape::record(&Fir, &steps(5, 50, 1, 3)).expect("is steady");
    let formats = deployed();
    let mut uncertainty = Uncertainty::new(&tape, &formats, DEFAULT_DOMAIN_FLAG);
    let mut written = 0;
    for step in 0..inputs.steps {
        uncertainty.step(&inputs, step, |node, expected| {
            let error = (expected.bias, expected.deviation);
            assert_eq!(error, (0.0, 0.0), "node {node} in step {step}");
            written += usize::from(node == LAST);
        });
    }
    assert_eq!(written, inputs.steps);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn no_word_is_farther_off_than_expected_whatever_the_rounding(
        seed in any::<u64>(), frac in 6_u32..11, mode in 0_usize..6,
    ) {
        let (rounding, _) = Rounding::ALL[mode];
        let formats = vec![Format::new(24, frac, rounding, Overflow::Saturate); NODES];
        let found = compare(&Fir, &steps(seed, 200, 1, 400), &formats);
        // Four steps fill the delay line.
        prop_assert_eq!(found.steps, 196);
    }

    #[test]
    fn every_operation_s_error_is_expected(seed in any::<u64>()) {
        let formats = vec![Format::new(48, 12, Rounding::NearestEven, Overflow::Saturate); NODES];
        let mut steps = steps(seed, 200, 3, 200);
        // What a zero divisor gives does not fit: from there on nothing is claimed, but not at once.
        steps[..50].iter_mut().filter(|step| step[2] == 0).for_each(|step| step[2] = 1);
        let found = compare(&Everything, &steps, &formats);
        prop_assert!(found.steps >= 49, "{} steps compared", found.steps);
    }
}
