//! How far every node is from the algorithm on real numbers, and every status bit.

use cardan_datapath::Format;
use cardan_numerics::tape::NO_NODE;
use cardan_numerics::trial::Trial;

use crate::evaluate::{Prepared, difference};
use crate::outcome::FlagCount;
use crate::problem::Problem;

/// What one run shows.
pub(crate) struct Deviations {
    /// Per node: largest size, root mean square and size of the mean of its errors in judged steps
    /// that the formats do not flag either; none where it is not written there.
    pub(crate) nodes: Vec<Option<[f64; 3]>>,
    /// Status bits that either raised.
    pub(crate) flags: Vec<FlagCount>,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    count: u64,
    largest: f64,
    sum: f64,
    square: f64,
}

pub(crate) fn deviations(
    problem: &Problem,
    prepared: &Prepared<'_>,
    formats: &[Format],
) -> Deviations {
    let case = prepared.case;
    let mut trial = Trial::new(&case.tape, &case.inputs, problem.domain_flag);
    trial.run_all(formats);
    let period: Vec<Option<f64>> = (problem.nodes.iter().zip(formats))
        .map(|(node, format)| {
            let wraps = node.format.overflow == cardan_datapath::Overflow::Wrap;
            let integer = format.word.cast_signed() - format.frac.cast_signed();
            wraps.then(|| libm::ldexp(1.0, integer))
        })
        .collect();
    let mut sums = vec![Sums::default(); formats.len()];
    let judged = (0..case.inputs.steps).filter(|&step| prepared.judged()[step]);
    for step in judged.filter(|&step| trial.status()[step] == 0) {
        for (index, entry) in case.tape.body(step).iter().enumerate() {
            if entry.node == NO_NODE || !entry.op.is_recorded() {
                continue;
            }
            let node = entry.node as usize;
            let raw = match trial.transient().get(step) {
                Some(words) => words[index].raw,
                None => trial.column(index).get(step),
            };
            let value = raw as f64 * formats[node].lsb();
            let error = difference(value, prepared.reals.steps[step][index], period[node]);
            let sums = &mut sums[node];
            sums.count += 1;
            sums.largest = sums.largest.max(error.abs());
            sums.sum += error;
            sums.square += error * error;
        }
    }
    let figures = |sums: &Sums| {
        let count = sums.count as f64;
        let rms = (sums.square / count).sqrt();
        (sums.count > 0).then(|| [sums.largest, rms, (sums.sum / count).abs()])
    };
    Deviations {
        nodes: sums.iter().map(figures).collect(),
        flags: flags(trial.status(), &prepared.reals.status),
    }
}

fn flags(tuned: &[u16], real: &[u16]) -> Vec<FlagCount> {
    let count = |bit: u32| {
        let bit = 1_u16 << bit;
        let of = |status: &[u16]| status.iter().filter(|own| *own & bit != 0).count() as u64;
        let pairs = tuned.iter().zip(real);
        FlagCount {
            bit,
            real: of(real),
            tuned: of(tuned),
            differing: pairs.filter(|(a, b)| (*a ^ *b) & bit != 0).count() as u64,
        }
    };
    let bits = (0..u16::BITS).map(count);
    bits.filter(|flag| flag.real + flag.tuned > 0).collect()
}
