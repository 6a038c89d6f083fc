//! What a candidate achieves: runs it on every tuning case and measures the budget's figures, ending
//! a run as soon as a limit is provably missed.

use std::ops::{ControlFlow, Range};

use cardan_datapath::{Format, Overflow};
use cardan_numerics::tape::{NO_NODE, Reals};
use cardan_numerics::trial::Trial;

use crate::budget::{Against, Budget, Measure, Statistic, Subject};
use crate::problem::{Case, Problem};

/// A case with what every candidate is compared with.
pub(crate) struct Prepared<'a> {
    pub(crate) case: &'a Case,
    pub(crate) reals: Reals,
    /// Steps whose errors count: unflagged on real numbers, and with known references.
    judged: Vec<bool>,
    count: usize,
    /// Steady operation of each quantity.
    outputs: Vec<usize>,
}

impl<'a> Prepared<'a> {
    pub(crate) fn new(problem: &Problem, case: &'a Case) -> Self {
        let formats = problem.deployed();
        let reals = Reals::run(&case.tape, &case.inputs, &formats, problem.domain_flag);
        let known = |step: usize| {
            case.references
                .iter()
                .all(|series| series[step].is_finite())
        };
        let first = case.tape.transient.len();
        let judged: Vec<bool> = (0..case.inputs.steps)
            .map(|step| step >= first && reals.status[step] == 0 && known(step))
            .collect();
        let output = |node: usize| case.tape.last_write(node).unwrap_or(0);
        Self {
            count: judged.iter().filter(|judged| **judged).count(),
            outputs: problem.quantities.iter().map(|q| output(q.node)).collect(),
            judged,
            reals,
            case,
        }
    }

    /// Steps whose errors count.
    pub(crate) fn judged(&self) -> &[bool] {
        &self.judged
    }
}

/// What a candidate achieves.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Per constraint, the worst of all cases; where a run was ended early, what is certain.
    pub values: Vec<f64>,
    /// The largest stretch of a limit: up to 1 is feasible.
    pub ratio: f64,
    /// The constraint that is stretched most.
    pub binding: usize,
}

impl Score {
    /// Every limit is met.
    #[must_use]
    pub fn is_feasible(&self) -> bool {
        self.ratio <= 1.0
    }
}

/// Evaluates candidates on all cases, one after the other.
pub(crate) struct Evaluator<'a> {
    problem: &'a Problem,
    budget: &'a Budget,
    cases: &'a [Prepared<'a>],
    trials: Vec<Trial<'a>>,
    buffers: Vec<Vec<f64>>,
}

impl<'a> Evaluator<'a> {
    pub(crate) fn new(problem: &'a Problem, budget: &'a Budget, cases: &'a [Prepared<'a>]) -> Self {
        let trial = |prepared: &Prepared<'a>| {
            Trial::new(
                &prepared.case.tape,
                &prepared.case.inputs,
                problem.domain_flag,
            )
        };
        Self {
            problem,
            budget,
            cases,
            trials: cases.iter().map(trial).collect(),
            buffers: vec![Vec::new(); budget.0.len()],
        }
    }

    /// The score of `formats`. With `early`, a run ends when a limit is missed for certain.
    pub(crate) fn score(&mut self, formats: &[Format], early: bool) -> Score {
        let mut values = vec![f64::NEG_INFINITY; self.budget.0.len()];
        for at in 0..self.cases.len() {
            let of_case = self.case(at, formats, early);
            for ((worst, value), constraint) in values.iter_mut().zip(of_case).zip(&self.budget.0) {
                let is_worse = *worst == f64::NEG_INFINITY
                    || constraint.ratio(value) > constraint.ratio(*worst);
                if is_worse {
                    *worst = value;
                }
            }
            if early && self.rate(&values).ratio > 1.0 {
                break;
            }
        }
        let mut score = self.rate(&values);
        score.values = values;
        score
    }

    fn rate(&self, values: &[f64]) -> Score {
        let mut score = Score {
            values: Vec::new(),
            ratio: 0.0,
            binding: 0,
        };
        for (at, (constraint, &value)) in self.budget.0.iter().zip(values).enumerate() {
            if value == f64::NEG_INFINITY {
                continue;
            }
            let ratio = constraint.ratio(value);
            if ratio > score.ratio {
                (score.ratio, score.binding) = (ratio, at);
            }
        }
        score
    }

    /// The figures of one case.
    fn case(&mut self, at: usize, formats: &[Format], early: bool) -> Vec<f64> {
        let prepared = &self.cases[at];
        let (problem, budget) = (self.problem, self.budget);
        let buffers = &mut self.buffers;
        buffers.iter_mut().for_each(Vec::clear);
        let mut sums = vec![0.0; budget.0.len()];
        let judge = |trial: &Trial<'_>, block: Range<usize>| {
            let mut missed = false;
            for (index, constraint) in budget.0.iter().enumerate() {
                if let Measure::Error(against, subject, statistic) = constraint.measure {
                    let errors = &mut buffers[index];
                    let from = errors.len();
                    collect(
                        problem,
                        prepared,
                        trial,
                        formats,
                        (against, subject),
                        block.clone(),
                        errors,
                    );
                    let fresh = &errors[from..];
                    sums[index] += fresh.iter().map(|error| error * error).sum::<f64>();
                    missed |= match statistic {
                        Statistic::Rms => {
                            sums[index] > constraint.limit.powi(2) * prepared.count as f64
                        }
                        Statistic::Max => fresh.iter().any(|e| e.abs() > constraint.limit),
                        Statistic::P99 => false,
                    };
                }
            }
            if early && missed {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        };
        let whole = self.trials[at].run(formats, judge);
        let trial = &self.trials[at];
        let mut values = Vec::new();
        for (index, constraint) in budget.0.iter().enumerate() {
            let value = match constraint.measure {
                Measure::Error(_, _, statistic) => {
                    let count = if whole {
                        self.buffers[index].len()
                    } else {
                        prepared.count
                    };
                    figure(
                        statistic,
                        sums[index],
                        count,
                        &mut self.buffers[index],
                        whole,
                    )
                }
                // Nothing certain can be said of the rest of a run that ended early.
                _ if !whole => f64::NEG_INFINITY,
                Measure::Sqnr(node) => sqnr(prepared, trial, formats, node),
                Measure::Lsb(node) => {
                    let worst = distances(prepared, trial, formats, node)
                        .fold(0.0, |worst: f64, (error, _)| worst.max(error.abs()));
                    worst / formats[node].lsb()
                }
                Measure::Overflow(node) => overflows(problem, trial, node) as f64,
                Measure::Flags => differing_flags(prepared, trial),
                // Measured on the target, by others.
                Measure::Cycles | Measure::Flash => f64::NEG_INFINITY,
            };
            values.push(value);
        }
        values
    }
}

/// Errors of the judged steps of a block that this candidate does not flag either. (How many it
/// flags is limited by [`Measure::Flags`]; status bits of a block are known at the end of the run
/// only, so that a flagged step's error counts here: the stricter choice.)
fn collect(
    problem: &Problem,
    prepared: &Prepared<'_>,
    trial: &Trial<'_>,
    formats: &[Format],
    (against, subject): (Against, Subject),
    block: Range<usize>,
    errors: &mut Vec<f64>,
) {
    let series = match against {
        Against::Golden => &prepared.case.references,
        Against::Truth => &prepared.case.truths,
    };
    let columns: Vec<_> = prepared
        .outputs
        .iter()
        .map(|&index| trial.column(index))
        .collect();
    let lsbs: Vec<f64> = problem
        .quantities
        .iter()
        .map(|q| formats[q.node].lsb())
        .collect();
    let mut values = vec![0.0; columns.len()];
    let mut references = vec![0.0; columns.len()];
    for step in block {
        if !prepared.judged[step] {
            continue;
        }
        let error = match subject {
            Subject::Quantity(at) => {
                let quantity = &problem.quantities[at];
                let value = columns[at].get(step) as f64 * lsbs[at];
                difference(value, series[at][step], quantity.period) * quantity.scale
            }
            Subject::Combined(at) => {
                for (quantity, value) in values.iter_mut().enumerate() {
                    *value = columns[quantity].get(step) as f64 * lsbs[quantity];
                    references[quantity] = series[quantity][step];
                }
                (problem.combined[at].error)(&values, &references)
            }
        };
        if error.is_finite() {
            errors.push(error);
        }
    }
}

/// value - reference, the short way round where there is a period.
pub(crate) fn difference(value: f64, reference: f64, period: Option<f64>) -> f64 {
    let plain = value - reference;
    match period {
        Some(period) => plain - period * (plain / period).round_ties_even(),
        None => plain,
    }
}

fn figure(statistic: Statistic, square: f64, count: usize, errors: &mut [f64], whole: bool) -> f64 {
    if errors.is_empty() {
        return if whole { f64::NAN } else { f64::NEG_INFINITY };
    }
    match statistic {
        Statistic::Rms => (square / count as f64).sqrt(),
        Statistic::Max => errors
            .iter()
            .fold(0.0, |worst, error| worst.max(error.abs())),
        Statistic::P99 if !whole => f64::NEG_INFINITY,
        Statistic::P99 => {
            let rank = (errors.len() * 99).div_ceil(100) - 1;
            let by_size = |a: &f64, b: &f64| a.abs().total_cmp(&b.abs());
            errors.select_nth_unstable_by(rank, by_size).1.abs()
        }
    }
}

/// Error and real value of every write of a node in judged steps.
fn distances<'a>(
    prepared: &'a Prepared<'_>,
    trial: &'a Trial<'_>,
    formats: &'a [Format],
    node: usize,
) -> impl Iterator<Item = (f64, f64)> + 'a {
    let lsb = formats[node].lsb();
    let steady = prepared.case.tape.steady.iter().enumerate();
    let writes = steady.filter(move |(_, entry)| {
        entry.node != NO_NODE && entry.node as usize == node && entry.op.is_recorded()
    });
    writes.flat_map(move |(index, _)| {
        let column = trial.column(index);
        let judged = trial.steps().filter(|&step| prepared.judged[step]);
        judged.map(move |step| {
            let real = prepared.reals.steps[step][index];
            (column.get(step) as f64 * lsb - real, real)
        })
    })
}

fn sqnr(prepared: &Prepared<'_>, trial: &Trial<'_>, formats: &[Format], node: usize) -> f64 {
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

/// Overflows of one node, or of all that do not wrap by design (deployed as wrapping).
fn overflows(problem: &Problem, trial: &Trial<'_>, node: Option<usize>) -> u64 {
    let counts = trial.overflows();
    match node {
        Some(node) => counts[node],
        None => {
            let counted = problem.nodes.iter().zip(&counts);
            counted
                .filter(|(info, _)| info.format.overflow != Overflow::Wrap)
                .map(|(_, count)| count)
                .sum()
        }
    }
}

/// Share of all steps whose status is another than on real numbers.
fn differing_flags(prepared: &Prepared<'_>, trial: &Trial<'_>) -> f64 {
    let steps = trial.steps();
    let differing = steps
        .clone()
        .filter(|&step| trial.status()[step] != prepared.reals.status[step]);
    differing.count() as f64 / steps.len().max(1) as f64
}
