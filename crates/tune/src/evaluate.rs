//! What a candidate achieves: runs it on every tuning case and measures the budget's figures, ending
//! a run as soon as a limit is provably missed.

mod figures;

use std::ops::{ControlFlow, Range};

use cardan_datapath::Format;
use cardan_numerics::tape::{Reals, beyond};
use cardan_numerics::trial::Trial;

pub(crate) use self::figures::difference;
use self::figures::{differing_flags, distances, figure, largest, overflows, sqnr};
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
        let writes = |step: usize| {
            let node = |q: &crate::Quantity| case.tape.last_write_in(step, q.node).is_some();
            problem.quantities.iter().all(node)
        };
        let known = |step: usize| {
            let is_known = |series: &Vec<f64>| series[step].is_finite();
            case.references.iter().all(is_known) && writes(step)
        };
        let judged: Vec<bool> = (0..case.inputs.steps)
            .map(|step| reals.status[step] == 0 && known(step))
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

    /// Steps whose errors count, start-up steps among them.
    pub(crate) fn judged(&self) -> &[bool] {
        &self.judged
    }

    /// How many they are.
    pub(crate) const fn count(&self) -> usize {
        self.count
    }

    /// The raw word of quantity `at` after `step` of a trial; steps that write none are not judged.
    fn output(&self, trial: &Trial<'_>, at: usize, node: usize, step: usize) -> i64 {
        match trial.transient().get(step) {
            None => trial.column(self.outputs[at]).get(step),
            Some(words) => {
                let write = self.case.tape.last_write_in(step, node);
                write.map_or(0, |index| words[index].raw)
            }
        }
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
    /// Per node, whether wrapping is right.
    by_design: &'a [bool],
    trials: Vec<Trial<'a>>,
    buffers: Vec<Vec<f64>>,
}

impl<'a> Evaluator<'a> {
    pub(crate) fn new(
        problem: &'a Problem,
        budget: &'a Budget,
        cases: &'a [Prepared<'a>],
        by_design: &'a [bool],
    ) -> Self {
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
            by_design,
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
        // Start-up steps are judged with the first block.
        let start_up = case_start_up(prepared);
        let mut judge = |trial: &Trial<'_>, block: Range<usize>| {
            let mut missed = false;
            let block = if block.start == start_up {
                0..block.end
            } else {
                block
            };
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
        let whole = self.trials[at].run(formats, &mut judge);
        let trial = &self.trials[at];
        if start_up == prepared.case.inputs.steps {
            // The run ends within the start-up: no block came.
            let _ = judge(trial, start_up..start_up);
        }
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
                    let errors = distances(prepared, trial, formats, node);
                    largest(errors.map(|(error, _)| error)) / formats[node].lsb()
                }
                Measure::Overflow(node) => {
                    let beyond = beyond(&prepared.case.tape, formats);
                    overflows(self.by_design, trial, &beyond, node) as f64
                }
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
    let lsbs: Vec<f64> = problem
        .quantities
        .iter()
        .map(|q| formats[q.node].lsb())
        .collect();
    let mut values = vec![0.0; lsbs.len()];
    let mut references = vec![0.0; lsbs.len()];
    let value_of = |at: usize, step: usize| {
        prepared.output(trial, at, problem.quantities[at].node, step) as f64 * lsbs[at]
    };
    for step in block {
        if !prepared.judged[step] {
            continue;
        }
        let error = match subject {
            Subject::Quantity(at) => {
                let quantity = &problem.quantities[at];
                references[at] = series[at][step];
                difference(value_of(at, step), references[at], quantity.period) * quantity.scale
            }
            Subject::Combined(at) => {
                for (quantity, value) in values.iter_mut().enumerate() {
                    *value = value_of(quantity, step);
                    references[quantity] = series[quantity][step];
                }
                (problem.combined[at].error)(&values, &references)
            }
        };
        // An unknown truth says nothing; an error that is no number is as bad as can be.
        let is_known = match subject {
            Subject::Quantity(at) => references[at].is_finite(),
            Subject::Combined(_) => references.iter().all(|reference| reference.is_finite()),
        };
        if is_known {
            errors.push(if error.is_finite() {
                error
            } else {
                f64::INFINITY
            });
        }
    }
}

/// The figure of an error on real numbers: what no formats change.
pub(crate) fn own_value(
    problem: &Problem,
    prepared: &Prepared<'_>,
    (against, subject): (Against, Subject),
    statistic: Statistic,
) -> f64 {
    let case = prepared.case;
    let series = match against {
        Against::Golden => &case.references,
        Against::Truth => &case.truths,
    };
    let value = |at: usize, step: usize| {
        let write = case.tape.last_write_in(step, problem.quantities[at].node);
        write.map_or(f64::NAN, |index| prepared.reals.steps[step][index])
    };
    let error = |step: usize| match subject {
        Subject::Quantity(at) => {
            let quantity = &problem.quantities[at];
            let reference = series[at][step];
            difference(value(at, step), reference, quantity.period) * quantity.scale
        }
        Subject::Combined(at) => {
            let all = 0..problem.quantities.len();
            let values: Vec<f64> = all.clone().map(|at| value(at, step)).collect();
            let references: Vec<f64> = all.map(|at| series[at][step]).collect();
            (problem.combined[at].error)(&values, &references)
        }
    };
    let judged = (0..case.inputs.steps).filter(|&step| prepared.judged[step]);
    let mut errors: Vec<f64> = judged
        .map(error)
        .filter(|error| error.is_finite())
        .collect();
    let square = errors.iter().map(|error| error * error).sum();
    let count = errors.len();
    figure(statistic, square, count, &mut errors, true)
}

/// Start-up steps of a case.
fn case_start_up(prepared: &Prepared<'_>) -> usize {
    (prepared.case.tape.transient.len()).min(prepared.case.inputs.steps)
}
