//! The noise-power model: what share of an output's error each node's rounding brings.
//!
//! A rounded write adds an error of uniform distribution: [`rounding_noise`]. Derivatives along the tape take
//! it to the output; writes are taken as independent of each other. The model does not see
//! thresholds (a comparison that flips), saturation, and the fixed errors of constants.

use cardan_datapath::{Format, Rounding};
use cardan_numerics::tape::{Entry, NO_NODE, Op, Ref, Tape, gains, rounding_noise};
use cardan_numerics::trial::Trial;
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};
use serde::Serialize;

use crate::evaluate::{Prepared, difference};
use crate::problem::Problem;

/// Gains from every write to one output.
#[derive(Clone, Debug)]
pub(crate) struct Gains {
    /// Per steady operation: mean square of the derivative.
    pub(crate) power: Vec<f64>,
    /// Per steady operation: its mean.
    mean: Vec<f64>,
}

/// Gains to the last write of `node`, over the judged steps of a case. The signs of the weights come
/// from `seed`: with them the gains through feedback add as powers.
pub(crate) fn gains_to(prepared: &Prepared<'_>, node: usize, seed: u64) -> Gains {
    let tape = &prepared.case.tape;
    let mut found = Gains {
        power: vec![0.0; tape.steady.len()],
        mean: vec![0.0; tape.steady.len()],
    };
    let Some(target) = tape.last_write(node) else {
        return found;
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut sign = || if rng.next_u32() & 1 == 0 { 1.0 } else { -1.0 };
    let judged = prepared.judged();
    let weights: Vec<f64> = judged
        .iter()
        .map(|&j| if j { sign() } else { 0.0 })
        .collect();
    let count = judged.iter().filter(|judged| **judged).count().max(1) as f64;
    gains(
        tape,
        &prepared.reals,
        target,
        &weights,
        |step, index, gain| {
            found.power[index] += gain * gain / count;
            found.mean[index] += gain * weights[step] / count;
        },
    );
    found
}

/// Fractional bits of an operation's exact result; `None` without end.
pub(crate) fn natural_frac(entry: &Entry, frac: impl Fn(Ref) -> i64) -> Option<i64> {
    Some(match entry.op {
        Op::Input { frac, .. } => frac.into(),
        Op::Add(a, b) | Op::Sub(a, b) | Op::Select(_, a, b) => frac(a).max(frac(b)),
        Op::Mul(a, b) => frac(a) + frac(b),
        Op::Shift(a, power) => frac(a) - i64::from(power),
        Op::Neg(a) | Op::Abs(a) => frac(a),
        _ => return None,
    })
}

/// Bits that a result without end drops.
const ENDLESS: i64 = 64;

impl Gains {
    /// Predicted noise power at the output in `formats`, per node.
    pub(crate) fn per_node(&self, tape: &Tape, formats: &[Format]) -> Vec<f64> {
        let mut variance = vec![0.0; formats.len()];
        let mut mean = vec![0.0; formats.len()];
        for (index, entry) in tape.steady.iter().enumerate() {
            if entry.node == NO_NODE || !entry.op.is_recorded() || self.power[index] == 0.0 {
                continue;
            }
            let frac = |operand: Ref| {
                let node = tape.node_of(operand);
                formats
                    .get(node as usize)
                    .map_or(0, |format| i64::from(format.frac))
            };
            let node = entry.node as usize;
            let format = formats[node];
            let natural = natural_frac(entry, frac);
            let dropped = natural.map_or(ENDLESS, |natural| natural - i64::from(format.frac));
            let (power, offset) = rounding_noise(format, dropped);
            variance[node] += self.power[index] * power;
            mean[node] += self.mean[index] * offset;
        }
        let total = |(variance, mean): (&f64, &f64)| variance + mean * mean;
        variance.iter().zip(&mean).map(total).collect()
    }

    /// The power gains of a node's writes together.
    pub(crate) fn of_node(&self, tape: &Tape, node: usize) -> f64 {
        let own = tape.steady.iter().zip(&self.power);
        own.filter(|(entry, _)| entry.node as usize == node)
            .map(|(_, power)| power)
            .sum()
    }
}

/// One node's part in the error of one quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeNoise {
    /// The node.
    pub node: String,
    /// The quantity.
    pub quantity: String,
    /// Root of the power gain: error of the quantity per error of the node, in budgets' units.
    pub gain: f64,
    /// Predicted rms error of the quantity from this node alone.
    pub predicted: f64,
    /// Its share of the predicted power of all nodes.
    pub share: f64,
    /// The same from simulation with this node alone rounded; none where it was not asked for.
    pub simulated: Option<f64>,
    /// 10 log10(simulated / predicted power).
    pub difference_db: Option<f64>,
    /// Why the model does not apply, where it is off by more than 1 dB or says nothing.
    pub not_applicable: Option<String>,
}

/// Bits that nodes have more where one node alone is rounded.
const FINE_BITS: u32 = 12;

/// The model for every node and quantity in `formats`, on the first tuning case; with `validate`,
/// beside a simulation in which that node alone is rounded.
#[must_use]
pub fn sensitivities(
    problem: &Problem,
    formats: &[Format],
    validate: bool,
    seed: u64,
) -> Vec<NodeNoise> {
    let Some(case) = problem.tuning.first() else {
        return Vec::new();
    };
    let prepared = Prepared::new(problem, case);
    let tape = &case.tape;
    let simulated = validate.then(|| simulate(problem, &prepared, formats));
    let mut all = Vec::new();
    for (at, quantity) in problem.quantities.iter().enumerate() {
        let gains = gains_to(&prepared, quantity.node, seed);
        let powers: Vec<f64> = (0..formats.len())
            .map(|node| {
                // Alone: its operands have all their places.
                let alone = alone(formats, node);
                gains.per_node(tape, &alone)[node]
            })
            .collect();
        let total: f64 = gains.per_node(tape, formats).iter().sum();
        let inside = gains.per_node(tape, formats);
        for (node, power) in powers.iter().enumerate() {
            let predicted = power.sqrt() * quantity.scale;
            let found = simulated.as_ref().map(|all| all[node][at]);
            let difference_db = found
                .filter(|found| *found > 0.0 && predicted > 0.0)
                .map(|found| 20.0 * libm::log10(found / predicted));
            all.push(NodeNoise {
                node: problem.nodes[node].name.to_owned(),
                quantity: quantity.name.clone(),
                gain: gains.of_node(tape, node).sqrt() * quantity.scale,
                predicted,
                share: if total > 0.0 {
                    inside[node] / total
                } else {
                    0.0
                },
                simulated: found,
                difference_db,
                not_applicable: found.and_then(|found| verdict(predicted, found, difference_db)),
            });
        }
    }
    all
}

fn verdict(predicted: f64, found: f64, difference_db: Option<f64>) -> Option<String> {
    if let Some(db) = difference_db {
        let why = "few values, thresholds or saturation: errors are not spread evenly over a place";
        return (db.abs() > 1.0).then(|| format!("{db:+.1} dB: {why}"));
    }
    (found > 0.0 && predicted == 0.0)
        .then(|| "acts through comparisons or as a constant, which the model does not see".into())
}

/// `formats` with one node as it is and all others much finer.
fn alone(formats: &[Format], node: usize) -> Vec<Format> {
    let fine = |(index, format): (usize, &Format)| {
        if index == node {
            *format
        } else {
            let extra = FINE_BITS.min(62_u32.saturating_sub(format.word.max(format.frac)));
            let (word, frac) = (format.word + extra, format.frac + extra);
            Format::new(word, frac, Rounding::NearestEven, format.overflow)
        }
    };
    formats.iter().enumerate().map(fine).collect()
}

/// Per node, per quantity: rms difference that rounding it alone makes.
fn simulate(problem: &Problem, prepared: &Prepared<'_>, formats: &[Format]) -> Vec<Vec<f64>> {
    let case = prepared.case;
    let mut trial = Trial::new(&case.tape, &case.inputs, problem.domain_flag);
    let outputs = |trial: &Trial<'_>, formats: &[Format]| -> Vec<Vec<f64>> {
        let series = |quantity: &crate::Quantity| {
            let Some(index) = case.tape.last_write(quantity.node) else {
                return Vec::new();
            };
            let lsb = formats[quantity.node].lsb();
            let judged = trial.steps().filter(|&step| prepared.judged()[step]);
            judged
                .map(|step| trial.column(index).get(step) as f64 * lsb)
                .collect()
        };
        problem.quantities.iter().map(series).collect()
    };
    let fine = alone(formats, usize::MAX);
    trial.run_all(&fine);
    let reference = outputs(&trial, &fine);
    let per_node = |node: usize| {
        let formats = alone(formats, node);
        trial.run_all(&formats);
        let found = outputs(&trial, &formats);
        let rms = |(quantity, (found, reference)): (&crate::Quantity, (&Vec<f64>, &Vec<f64>))| {
            let square = |(a, b): (&f64, &f64)| difference(*a, *b, quantity.period).powi(2);
            let sum: f64 = found.iter().zip(reference).map(square).sum();
            (sum / found.len().max(1) as f64).sqrt() * quantity.scale
        };
        problem
            .quantities
            .iter()
            .zip(found.iter().zip(&reference))
            .map(rms)
            .collect()
    };
    (0..formats.len()).map(per_node).collect()
}
