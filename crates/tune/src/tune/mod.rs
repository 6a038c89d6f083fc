//! From a problem and a budget to formats.

mod front;
mod inputs;
mod options;
mod relax;
mod target;
mod trim;

use self::inputs::{prepare, unexcited, unraised};
pub use self::options::Options;

use std::time::{Duration, Instant};

use cardan_datapath::Format;

use crate::budget::{Budget, Constraint, Measure};
use crate::cost::{Coefficients, Cost, area, bits, counts};
use crate::evaluate::{Evaluator, Prepared, Score};
use crate::noise::sensitivities;
use crate::outcome::{Candidate, NamedFormats, OnTarget, Outcome, Reached, Verification};
use crate::pool::Pool;
use crate::problem::Problem;
use crate::ranges::{Ranges, ranges};
use crate::search::{Context, Journal, JournalError, Limits, Method, search};
use crate::space::{LONGEST, Levels, Restrictions, Space, SpaceError, builds};

/// Builds formats and measures them on the target.
pub type OnTargetFn<'a> = dyn Fn(&[Format]) -> Result<OnTarget, TuneError> + 'a;

/// Progress of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// What goes on.
    pub stage: &'static str,
    /// Candidates simulated in it.
    pub evaluations: u64,
    /// Cost of the best one so far.
    pub best: Option<f64>,
}

/// Why tuning could not begin.
#[derive(Debug, thiserror::Error)]
pub enum TuneError {
    /// The budget was refused.
    #[error(transparent)]
    Budget(#[from] crate::BudgetError),
    /// Locks, couplings or widths were refused.
    #[error(transparent)]
    Space(#[from] SpaceError),
    /// The journal was refused.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// The problem has nothing to tune on.
    #[error("no case to tune on, or none of its steps can be judged: {0}")]
    NoCase(String),
    /// The target is needed and not there.
    #[error("{0}")]
    Target(String),
    /// These formats cannot be built for the target.
    #[error("{0}")]
    Unbuildable(String),
}

/// Tunes the formats of `problem`. `on_target` builds and measures candidates; it is needed where
/// the budget or the cost speaks of cycles or flash.
///
/// # Errors
/// A budget, lock, width or journal that is refused, nothing to judge, a target that fails.
pub fn tune(
    problem: &Problem,
    options: &Options,
    on_target: Option<&OnTargetFn<'_>>,
    progress: &mut dyn FnMut(Progress),
) -> Result<Outcome, TuneError> {
    let begin = Instant::now();
    let budget = Budget::parse(&options.budget, problem)?;
    let found = ranges(problem, options.guard_bits, 0, options.seed);
    let restrictions = Restrictions {
        locked: options.locked.clone(),
        coupled: options.coupled.clone(),
        widths: options.effective_widths(),
    };
    let integer = found.nodes.iter().map(|range| range.integer).collect();
    let mut plain = Space::new(problem, integer, &restrictions)?;
    let prepared = prepare(problem)?;
    let pool = Pool::new(problem, &budget, &prepared, options.threads);
    let trimmed = trim::trimmed(problem, &prepared, &pool, &found, &plain);
    let mut space = plain.with_integer(&trimmed);
    if matches!(options.cost, Cost::Cycles(_)) {
        (plain, space) = (plain.in_containers(problem), space.in_containers(problem));
    }
    let mut run = Run {
        problem,
        options,
        budget: &budget,
        plain: &plain,
        space: &space,
        prepared: &prepared,
        pool: &pool,
        on_target,
        warnings: unexcited(&found)
            .chain(unraised(problem, &prepared))
            .collect(),
        evaluations: 0,
        measured: Vec::new(),
    };
    run.tune(&found, begin, progress)
}

struct Run<'a> {
    problem: &'a Problem,
    options: &'a Options,
    budget: &'a Budget,
    /// The choices with the integer bits of the ranges.
    plain: &'a Space,
    /// Those with the integer bits that are left after trimming.
    space: &'a Space,
    prepared: &'a [Prepared<'a>],
    pool: &'a Pool<'a>,
    on_target: Option<&'a OnTargetFn<'a>>,
    warnings: Vec<String>,
    evaluations: u64,
    measured: Vec<Candidate>,
}

impl Run<'_> {
    fn tune(
        &mut self,
        ranges: &Ranges,
        begin: Instant,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Outcome, TuneError> {
        let baseline = self.candidate("uniform 32 bit", &self.plain.uniform(LONGEST));
        let uniform = self.best_uniform();
        let (levels, feasible) = self.search(uniform.as_ref(), progress)?;
        let mut formats = self.space.formats(&levels);
        if let Some((_, uniform)) = &uniform
            && (!feasible || self.cost(uniform) < self.cost(&formats))
        {
            // A length shorter than a range: the groups' own choices do not hold it.
            formats.clone_from(uniform);
        }
        let feasible = feasible || uniform.is_some();
        let mut pareto = Vec::new();
        if feasible {
            pareto = self.pareto(&levels, progress);
            // A search that was ended early may be behind its own front.
            let within = pareto.iter().filter(|point| point.limit_factor <= 1.0);
            let cheapest = within.min_by(|a, b| a.cost.total_cmp(&b.cost));
            if let Some(point) = cheapest.filter(|point| point.cost < self.cost(&formats)) {
                formats = point.formats.0.iter().map(|(_, format)| *format).collect();
            }
            self.relax(&mut formats);
        }
        let mut best = self.candidate("best", &formats);
        let mut best_uniform =
            uniform.map(|(word, formats)| self.candidate(&format!("uniform {word} bit"), &formats));
        let by_cycles = matches!(self.options.cost, Cost::Cycles(_));
        if by_cycles || self.budget.needs_target() {
            self.measured_if_it_fits(&mut best, &formats)?;
            if let Some(uniform) = &mut best_uniform {
                let formats: Vec<Format> = uniform.formats.0.iter().map(|(_, f)| *f).collect();
                if builds(self.problem, &formats) {
                    self.measured_if_it_fits(uniform, &formats)?;
                }
            }
        }
        if by_cycles {
            (best, formats) = self.cheapest_measured(best, formats)?;
            if best.cycles.is_none() {
                return Err(TuneError::Target(format!(
                    "no candidate could be built for the target: {}",
                    self.warnings.last().map_or("", String::as_str)
                )));
            }
        }
        let stretched = |reached: &&Reached| reached.ratio.is_none_or(|ratio| ratio > 1.0);
        let on_target_missed = best
            .reached
            .iter()
            .find(stretched)
            .map(|r| r.constraint.clone());
        let feasible = feasible && on_target_missed.is_none();
        let binding = (!feasible).then(|| worst(&best)).flatten();
        if !feasible {
            pareto.clear();
        }
        let verification = self.verify(&formats);
        let verified = verification.iter().all(|case| case.pass);
        if feasible && !verified {
            self.warnings.push(
                "the result misses the budget on held-out inputs: tune on a longer or richer run, or \
                 leave a margin in the budget"
                    .into(),
            );
        }
        Ok(Outcome {
            feasible,
            verified: feasible && verified,
            binding,
            method: Method::ALL
                .iter()
                .find(|(method, _)| *method == self.options.method)
                .map_or("", |(_, name)| name),
            cost: self.options.cost.name(),
            evaluations: self.evaluations,
            seconds: begin.elapsed().as_secs_f64(),
            baseline,
            best_uniform,
            best,
            pareto,
            measured: std::mem::take(&mut self.measured),
            verification,
            sensitivities: sensitivities(self.problem, &formats, true, self.options.seed),
            ranges: ranges.nodes.clone(),
            warnings: std::mem::take(&mut self.warnings),
        })
    }

    fn cost(&self, formats: &[Format]) -> f64 {
        let tape = &self.prepared[0].case.tape;
        self.options.cost.of(self.problem, tape, formats)
    }

    fn candidate(&self, name: &str, formats: &[Format]) -> Candidate {
        let score = self.pool.score(formats);
        let tape = &self.prepared[0].case.tape;
        let bundled = Coefficients::bundled().ok();
        let own = match &self.options.cost {
            Cost::Area(own) | Cost::Cycles(own) => Some((**own).clone()),
            Cost::Bits => bundled,
        };
        let reached = reached(&self.budget.0, &score.values);
        let is_error = |c: &&Constraint| matches!(c.measure, Measure::Error(..));
        let error = self
            .budget
            .0
            .iter()
            .zip(&score.values)
            .find(|(c, _)| is_error(c));
        Candidate {
            name: name.to_owned(),
            bits: bits(formats),
            area: own.as_ref().map(|own| area(&own.area, tape, formats)),
            cycles_estimated: own
                .as_ref()
                .map(|own| own.cycles.of(&counts(self.problem, tape, formats))),
            error: error
                .map(|(_, value)| *value)
                .filter(|value| value.is_finite()),
            reached,
            formats: NamedFormats::new(&self.problem.nodes, formats),
            ..Candidate::default()
        }
    }

    /// The uniform word length that meets the budget at the least cost: with the integer bits of the
    /// ranges, or with trimmed ones.
    fn best_uniform(&mut self) -> Option<(u32, Vec<Format>)> {
        let mut all = self.options.effective_widths();
        if all.is_empty() {
            all = (1..=LONGEST).collect();
        }
        let each = all
            .iter()
            .flat_map(|&word| [self.plain, self.space].map(|space| (word, space.uniform(word))));
        let (words, batch): (Vec<u32>, Vec<Vec<Format>>) = each.unzip();
        let scores = self.pool.scores(&batch, true);
        let feasible = words
            .into_iter()
            .zip(batch)
            .zip(&scores)
            .filter(|(_, score)| score.is_feasible());
        feasible.map(|(found, _)| found).min_by(|a, b| {
            self.cost(&a.1)
                .total_cmp(&self.cost(&b.1))
                .then(a.0.cmp(&b.0))
        })
    }

    /// Runs the search; the best formats, or the closest, and whether they meet the budget.
    fn search(
        &mut self,
        uniform: Option<&(u32, Vec<Format>)>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<(Levels, bool), TuneError> {
        let journal = match &self.options.journal {
            None => None,
            Some(path) => {
                let (journal, note) = Journal::open(path, &self.options.identity(self.problem))?;
                self.warnings.extend(note);
                Some(journal)
            }
        };
        let limits = Limits {
            evaluations: self.options.evaluations,
            time: self
                .options
                .seconds
                .and_then(|s| Duration::try_from_secs_f64(s).ok()),
            patience: self.options.patience,
        };
        let mut report = |evaluations: u64, best: Option<f64>| {
            progress(Progress {
                stage: "search",
                evaluations,
                best,
            });
        };
        let mut context = Context::new(
            self.problem,
            self.budget,
            self.prepared,
            self.space,
            &self.options.cost,
            self.pool,
            limits,
            journal,
            &mut report,
        );
        let start = uniform.and_then(|(word, _)| uniform_levels(self.space, *word));
        if let Some(start) = &start {
            context.score(start);
        }
        search(
            self.options.method,
            &mut context,
            start.as_ref(),
            self.options.seed,
        )?;
        self.evaluations = context.evaluations;
        self.warnings.extend(
            context
                .journal_problem()
                .map(|what| format!("the journal is not kept: {what}")),
        );
        let widest = self.space.widest();
        Ok(match (context.best, context.closest) {
            (Some((levels, _)), _) => (levels, true),
            (None, Some((levels, _))) => (levels, false),
            (None, None) => (widest, false),
        })
    }

    /// The result on every case, held-out ones included, to their ends.
    fn verify(&self, formats: &[Format]) -> Vec<Verification> {
        let held_out: Vec<Prepared<'_>> = self
            .problem
            .held_out
            .iter()
            .map(|case| Prepared::new(self.problem, case))
            .collect();
        let score = |one: &Prepared<'_>| {
            let case = std::slice::from_ref(one);
            let score = Evaluator::new(self.problem, self.budget, case).score(formats, false);
            (one.case.name.clone(), score)
        };
        let tuned: Vec<(String, Score)> = self.prepared.iter().map(score).collect();
        let largest = tuned
            .iter()
            .fold(0.0, |worst: f64, (_, s)| worst.max(s.ratio));
        let held: Vec<(String, Score)> = held_out.iter().map(score).collect();
        let all = tuned
            .iter()
            .map(|one| (one, false))
            .chain(held.iter().map(|one| (one, true)));
        all.map(|((case, score), held_out)| Verification {
            case: case.clone(),
            held_out,
            reached: reached(&self.budget.0, &score.values),
            pass: score.is_feasible(),
            over_tuning: (held_out && largest > 0.0).then_some(score.ratio / largest),
        })
        .collect()
    }
}

/// The name of the constraint that a candidate stretches most.
fn worst(candidate: &Candidate) -> Option<String> {
    let size = |reached: &Reached| reached.ratio.unwrap_or(f64::INFINITY);
    let largest = candidate
        .reached
        .iter()
        .max_by(|a, b| size(a).total_cmp(&size(b)));
    largest.map(|reached| reached.constraint.clone())
}

fn reached(constraints: &[Constraint], values: &[f64]) -> Vec<Reached> {
    let one = |(constraint, value): (&Constraint, &f64)| {
        let finite = |value: f64| value.is_finite().then_some(value);
        // A noiseless node is infinitely good, a target figure not measured yet is within its limit.
        let ratio = match *value {
            f64::NEG_INFINITY | f64::INFINITY => Some(0.0),
            value => finite(constraint.ratio(value)),
        };
        Reached {
            constraint: constraint.text.clone(),
            value: finite(*value),
            ratio,
        }
    };
    constraints.iter().zip(values).map(one).collect()
}

fn uniform_levels(space: &Space, word: u32) -> Option<Levels> {
    let level = |group: &crate::space::Group| {
        let at = group.widths.iter().position(|&width| width >= word)?;
        u8::try_from(at).ok()
    };
    space.groups.iter().map(level).collect()
}
