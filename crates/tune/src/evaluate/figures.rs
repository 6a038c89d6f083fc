//! The figures of a run that budgets limit.

use cardan_datapath::Format;
use cardan_numerics::trial::Trial;

use super::Prepared;
use crate::budget::Statistic;

/// value - reference, the short way round where there is a period.
pub(crate) fn difference(value: f64, reference: f64, period: Option<f64>) -> f64 {
    let plain = value - reference;
    match period {
        Some(period) => plain - period * (plain / period).round_ties_even(),
        None => plain,
    }
}

/// The largest size; what is no number counts as infinite.
pub(super) fn largest(errors: impl Iterator<Item = f64>) -> f64 {
    errors.fold(0.0, |worst: f64, error| {
        if error.is_nan() {
            f64::INFINITY
        } else {
            worst.max(error.abs())
        }
    })
}

pub(super) fn figure(
    statistic: Statistic,
    square: f64,
    count: usize,
    errors: &mut [f64],
    whole: bool,
) -> f64 {
    if errors.is_empty() {
        return if whole { f64::NAN } else { f64::NEG_INFINITY };
    }
    match statistic {
        Statistic::Rms => (square / count as f64).sqrt(),
        Statistic::Max => largest(errors.iter().copied()),
        Statistic::P99 if !whole => f64::NEG_INFINITY,
        Statistic::P99 => {
            let rank = (errors.len() * 99).div_ceil(100) - 1;
            let by_size = |a: &f64, b: &f64| a.abs().total_cmp(&b.abs());
            errors.select_nth_unstable_by(rank, by_size).1.abs()
        }
    }
}

/// Error and real value of every write of a node in judged steps.
pub(super) fn distances<'a>(
    prepared: &'a Prepared<'_>,
    trial: &'a Trial<'_>,
    formats: &'a [Format],
    node: usize,
) -> impl Iterator<Item = (f64, f64)> + 'a {
    let lsb = formats[node].lsb();
    let judged = (0..prepared.case.inputs.steps).filter(|&step| prepared.judged[step]);
    judged.flat_map(move |step| {
        let body = prepared.case.tape.body(step).iter().enumerate();
        let writes =
            body.filter(move |(_, entry)| entry.node as usize == node && entry.op.is_recorded());
        writes.map(move |(index, _)| {
            let raw = match trial.transient().get(step) {
                None => trial.column(index).get(step),
                Some(words) => words[index].raw,
            };
            let real = prepared.reals.steps[step][index];
            (raw as f64 * lsb - real, real)
        })
    })
}

pub(super) fn sqnr(
    prepared: &Prepared<'_>,
    trial: &Trial<'_>,
    formats: &[Format],
    node: usize,
) -> f64 {
    let (mut noise, mut signal) = (0.0, 0.0);
    for (error, real) in distances(prepared, trial, formats, node) {
        noise += error * error;
        signal += real * real;
    }
    // A node without noise is beyond any limit.
    if noise == 0.0 {
        f64::INFINITY
    } else {
        10.0 * libm::log10(signal / noise)
    }
}

/// Overflows of one node, or of all that do not wrap by design. A constant or a table entry that its
/// node does not hold is one too, though it saturates without a word.
pub(super) fn overflows(
    by_design: &[bool],
    trial: &Trial<'_>,
    beyond: &[Option<f64>],
    node: Option<usize>,
) -> u64 {
    let counts = trial.overflows();
    let of = |node: usize| counts[node] + u64::from(beyond[node].is_some());
    match node {
        Some(node) => of(node),
        None => {
            let counted = (0..counts.len()).filter(|&node| !by_design[node]);
            counted.map(of).sum()
        }
    }
}

/// Share of all steps whose status is another than on real numbers.
pub(super) fn differing_flags(prepared: &Prepared<'_>, trial: &Trial<'_>) -> f64 {
    let pairs = trial.status().iter().zip(&prepared.reals.status);
    let differing = pairs.filter(|(own, real)| own != real).count();
    differing as f64 / prepared.case.inputs.steps.max(1) as f64
}
