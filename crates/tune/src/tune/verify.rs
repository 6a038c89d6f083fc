//! Whether a result holds on what it was not tuned on.

use cardan_datapath::Format;
use cardan_datapath::wordlengths::TunedTolerance;

use super::rounds::ROUNDS;
use super::{Run, reached};
use crate::budget::Measure;
use crate::deviation::{Deviations, deviations};
use crate::evaluate::{Evaluator, Prepared, Score};
use crate::outcome::{Statistics, Stretch, Verification};
use crate::problem::Case;
use crate::statistics::{CONTENT, enough, moments, tolerance_factor};

/// Confidence over all rounds.
const CONFIDENCE: f64 = 0.95;
/// Of a single round: the rounds together have [`CONFIDENCE`], since each has runs of its own.
const CONFIDENCE_OF_A_ROUND: f64 = 1.0 - (1.0 - CONFIDENCE) / ROUNDS as f64;
/// What largest errors are taken times for tolerances.
const TOLERANCE: f64 = 2.0;
/// Fewer fresh runs say nothing of a distribution.
const FEWEST: usize = 3;

/// A result on every case.
pub(super) struct Checked {
    pub(super) verification: Vec<Verification>,
    pub(super) statistics: Option<Statistics>,
    pub(super) tolerances: Vec<TunedTolerance>,
    /// It holds.
    pub(super) holds: bool,
    /// The largest stretch of a limit, by statistics where there are any.
    pub(super) stretch: f64,
}

impl Checked {
    /// No run misses a limit, whatever few runs tell of others.
    pub(super) fn holds_so_far(&self) -> bool {
        self.verification.iter().all(|case| case.pass)
    }

    /// Runs that nothing was tuned on and that miss a limit: by what factor, and their names.
    pub(super) fn missed(&self) -> impl Iterator<Item = (f64, &str)> {
        let missed = |case: &&Verification| case.held_out && !case.pass;
        let ratio = |case: &Verification| {
            let ratios = case.reached.iter();
            let ratios = ratios.map(|reached| reached.ratio.unwrap_or(f64::INFINITY));
            ratios.fold(0.0, f64::max)
        };
        self.verification
            .iter()
            .filter(missed)
            .map(move |case| (ratio(case), case.case.as_str()))
    }
}

impl Run<'_> {
    /// The result on every case, to their ends: those tuned on, held-out ones, and fresh runs.
    pub(super) fn check(&self, formats: &[Format], fresh: &[Case]) -> Checked {
        let prepare = |case| Prepared::new(self.problem, case);
        let held_out: Vec<Prepared<'_>> = self.problem.held_out.iter().map(prepare).collect();
        let fresh: Vec<Prepared<'_>> = fresh.iter().map(prepare).collect();
        let tuned = self.prepared.iter().map(|one| (one, Kind::Tuned));
        let held_out = held_out.iter().map(|one| (one, Kind::HeldOut));
        let all = tuned
            .chain(held_out)
            .chain(fresh.iter().map(|one| (one, Kind::Fresh)));
        let results: Vec<CaseResult> = all
            .map(|(one, kind)| self.result(formats, one, kind))
            .collect();
        let largest = |kind: Kind| {
            let own = results.iter().filter(|result| result.kind == kind);
            own.map(|result| result.score.ratio).fold(0.0, f64::max)
        };
        let tuned = largest(Kind::Tuned);
        let statistics = self.statistics(&results);
        // So many runs that hold, without exception, need no model of how they scatter.
        let by_statistics =
            statistics
                .as_ref()
                .filter(|found| !found.by_count)
                .map_or(0.0, |found| {
                    found
                        .stretches
                        .iter()
                        .map(|stretch| stretch.bound)
                        .fold(0.0, f64::max)
                });
        let stretch = [
            by_statistics,
            tuned,
            largest(Kind::HeldOut),
            largest(Kind::Fresh),
        ];
        let stretch = stretch.into_iter().fold(0.0, f64::max);
        let tolerances = self.tolerances(&results);
        let verification = results.into_iter().map(|result| Verification {
            reached: reached(&self.budget.0, &result.score.values),
            pass: result.score.is_feasible(),
            held_out: result.kind != Kind::Tuned,
            fresh: result.kind == Kind::Fresh,
            over_tuning: (result.kind != Kind::Tuned && tuned > 0.0)
                .then_some(result.score.ratio / tuned),
            flags: result.deviations.flags,
            case: result.case,
        });
        Checked {
            verification: verification.collect(),
            statistics,
            tolerances,
            holds: stretch <= 1.0,
            stretch,
        }
    }

    fn result(&self, formats: &[Format], one: &Prepared<'_>, kind: Kind) -> CaseResult {
        let cases = std::slice::from_ref(one);
        let mut evaluator = Evaluator::new(self.problem, self.budget, cases, self.by_design);
        let mut score = evaluator.score(formats, false);
        if one.count() == 0 {
            // Nothing could be judged: that is not within any limit.
            score.ratio = f64::INFINITY;
        }
        CaseResult {
            case: one.case.name.clone(),
            kind,
            score,
            deviations: deviations(self.problem, one, formats),
        }
    }

    /// Bounds of what runs like the fresh ones stretch each limit.
    fn statistics(&self, results: &[CaseResult]) -> Option<Statistics> {
        let fresh: Vec<&CaseResult> = results.iter().filter(|r| r.kind == Kind::Fresh).collect();
        if fresh.len() < FEWEST {
            return None;
        }
        let factor = tolerance_factor(fresh.len(), CONFIDENCE_OF_A_ROUND);
        let measured = self.budget.0.iter().enumerate().filter(|(_, constraint)| {
            // What is the same in every run, or is no number but a yes or no.
            !matches!(
                constraint.measure,
                Measure::Cycles | Measure::Flash | Measure::Overflow(_)
            )
        });
        let stretch = |(at, constraint): (usize, &crate::Constraint)| {
            let ratios = fresh
                .iter()
                .map(|result| constraint.ratio(result.score.values[at]));
            let (mean, deviation) = moments(&ratios.collect::<Vec<_>>());
            let bound = mean + factor * deviation;
            Stretch {
                constraint: constraint.text.clone(),
                mean,
                deviation,
                bound: if bound.is_nan() { f64::INFINITY } else { bound },
            }
        };
        let holding = fresh
            .iter()
            .filter(|result| result.score.is_feasible())
            .count();
        let runs = fresh.len();
        Some(Statistics {
            runs,
            holding,
            by_count: holding == runs && enough(runs, CONFIDENCE_OF_A_ROUND),
            rounds: 1,
            confidence: CONFIDENCE,
            content: CONTENT,
            factor,
            stretches: measured.map(stretch).collect(),
        })
    }

    fn tolerances(&self, results: &[CaseResult]) -> Vec<TunedTolerance> {
        let nodes = self.problem.nodes.iter().enumerate();
        let tolerance = |(at, node): (usize, &cardan_datapath::NodeInfo)| {
            let own = results
                .iter()
                .filter_map(|result| result.deviations.nodes[at]);
            let largest = own.reduce(|a, b| std::array::from_fn(|k| a[k].max(b[k])))?;
            let [max, rms, bias] = largest.map(|value| TOLERANCE * value);
            let node = node.name.to_owned();
            (max.is_finite()).then_some(TunedTolerance {
                node,
                max,
                rms,
                bias,
            })
        };
        nodes.filter_map(tolerance).collect()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Tuned,
    HeldOut,
    Fresh,
}

struct CaseResult {
    case: String,
    kind: Kind,
    score: Score,
    deviations: Deviations,
}
