//! From a problem and a budget to formats.

mod front;
mod inputs;
mod ladder;
mod options;
mod own;
mod relax;
mod rounds;
mod target;
mod trim;
mod uniform;
mod verify;

use self::inputs::{prepare, unexcited, unraised};
pub use self::options::Options;

use std::ops::Range;
use std::time::Instant;

use cardan_datapath::Format;

use self::ladder::Ladder;
use self::rounds::{Found, Round, Rounds, tune_on};
use self::uniform::Uniform;
use crate::budget::{Budget, Constraint, Measure};
use crate::cost::{Coefficients, Cost, area, bits, counts};
use crate::design::wraps_by_design;
use crate::evaluate::{Prepared, Score};
use crate::noise::sensitivities;
use crate::outcome::{Candidate, NamedFormats, OnTarget, Outcome, Reached};
use crate::pool::Pool;
use crate::problem::{Case, Problem};
use crate::ranges::{Ranges, ranges};
use crate::search::{Journal, JournalError, Method};
use crate::space::{LONGEST, Restrictions, Space, SpaceError, builds};

/// Builds formats and measures them on the target.
pub type OnTargetFn<'a> = dyn Fn(&[Format]) -> Result<OnTarget, TuneError> + 'a;

/// Records fresh runs of the same kind as those tuned on, by their numbers from 0: runs that nothing was
/// tuned on.
pub type FreshFn<'a> = dyn Fn(Range<u64>) -> Result<Vec<Case>, TuneError> + 'a;

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
    tune_with(problem, options, (on_target, None), progress)
}

/// As [`tune`], with a source of fresh runs: the result is verified on `options.fresh` of them, with
/// statistics; when it does not hold, the search is done again for tighter limits and verified on
/// others.
///
/// # Errors
/// As [`tune`], and fresh runs that cannot be recorded.
pub fn tune_with(
    problem: &Problem,
    options: &Options,
    (on_target, fresh): (Option<&OnTargetFn<'_>>, Option<&FreshFn<'_>>),
    progress: &mut dyn FnMut(Progress),
) -> Result<Outcome, TuneError> {
    let begin = Instant::now();
    let budget = Budget::parse(&options.budget, problem)?;
    let mut problem = problem.clone();
    prepare(&problem)?;
    let mut warnings = Vec::new();
    let mut ladder = Ladder::default();
    if let Some(path) = &options.journal {
        let (journal, note) = Journal::open(path, &options.identity(&problem))?;
        warnings.extend(note);
        ladder.journal = Some(journal);
    }
    let mut rounds = Rounds::new(fresh, ladder);
    rounds.ranged(&mut problem)?;
    loop {
        let missed = {
            let by_design = wraps_by_design(&problem);
            let found = ranges(&problem, options.guard_bits, 0, options.seed);
            let restrictions = Restrictions {
                locked: options.locked.clone(),
                coupled: options.coupled.clone(),
                widths: options.effective_widths(),
            };
            let integer = found.nodes.iter().map(|range| range.integer).collect();
            let mut plain = Space::new(&problem, integer, &restrictions, &by_design)?;
            let prepared = prepare(&problem)?;
            let pool = Pool::new(&problem, &budget, &prepared, &by_design, options.threads);
            let trimmed = trim::trimmed(&problem, &prepared, (&budget, &pool), &found, &plain);
            let mut space = plain.with_integer(&trimmed);
            if matches!(options.cost, Cost::Cycles(_)) {
                (plain, space) = (plain.in_containers(&problem), space.in_containers(&problem));
            }
            let uniforms = uniform::all(options, &pool, [&plain, &space]);
            let mut run = Run {
                problem: &problem,
                options,
                budget: &budget,
                by_design: &by_design,
                plain: &plain,
                space: &space,
                prepared: &prepared,
                pool: &pool,
                uniforms,
                on_target,
                begin,
                warnings: unexcited(&found)
                    .chain(unraised(&problem, &prepared))
                    .chain(warnings.iter().cloned())
                    .collect(),
                evaluations: 0,
                measured: Vec::new(),
            };
            match run.rounds(&mut rounds, progress)? {
                Round::Found(round) => return run.outcome(*round, rounds.ladder, &found, progress),
                Round::Missed(cases) => cases,
            }
        };
        tune_on(&mut problem, missed);
    }
}

struct Run<'a> {
    problem: &'a Problem,
    options: &'a Options,
    budget: &'a Budget,
    /// Per node, whether wrapping is right.
    by_design: &'a [bool],
    /// The choices with the integer bits of the ranges.
    plain: &'a Space,
    /// Those with the integer bits that are left after trimming.
    space: &'a Space,
    prepared: &'a [Prepared<'a>],
    pool: &'a Pool<'a>,
    uniforms: Vec<Uniform>,
    on_target: Option<&'a OnTargetFn<'a>>,
    begin: Instant,
    warnings: Vec<String>,
    /// Beside those of the ladder.
    evaluations: u64,
    measured: Vec<Candidate>,
}

impl Run<'_> {
    fn outcome(
        &mut self,
        mut found: Found,
        mut ladder: Ladder,
        ranges: &Ranges,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Outcome, TuneError> {
        let baseline = self.candidate("uniform 32 bit", &self.plain.uniform(LONGEST));
        let deployed = self.candidate("deployed", &self.problem.deployed());
        let mut pareto = Vec::new();
        if found.feasible {
            pareto = self.pareto(&mut ladder, found.margin, progress)?;
        }
        let journal_lost = ladder.journal.as_ref().and_then(Journal::problem);
        let mut best = self.candidate("best", &found.formats);
        let uniform = self
            .uniform_at(found.margin)
            .or_else(|| self.uniform_at(1.0));
        let mut best_uniform = uniform.map(|uniform| {
            let name = format!("uniform {} bit", uniform.word);
            (
                self.candidate(&name, &uniform.formats),
                uniform.formats.clone(),
            )
        });
        let by_cycles = matches!(self.options.cost, Cost::Cycles(_));
        if by_cycles || self.budget.needs_target() {
            let formats = found.formats.clone();
            self.measured_if_it_fits(&mut best, &formats)?;
            if let Some((uniform, formats)) = &mut best_uniform
                && builds(self.problem, formats)
            {
                self.measured_if_it_fits(uniform, formats)?;
            }
        }
        if by_cycles {
            let searched = found.formats.clone();
            (best, found.formats) = self.cheapest_measured(best, searched.clone())?;
            if best.cycles.is_none() {
                return Err(TuneError::Target(format!(
                    "no candidate could be built for the target: {}",
                    self.warnings.last().map_or("", String::as_str)
                )));
            }
            if found.formats != searched {
                found.checked = self.check(&found.formats, &found.fresh);
            }
        }
        let stretched = |reached: &&Reached| reached.ratio.is_none_or(|ratio| ratio > 1.0);
        let is_missed = best.reached.iter().any(|reached| stretched(&reached));
        let feasible = found.feasible && !is_missed;
        let binding = (!feasible).then(|| worst(&best)).flatten();
        if !feasible {
            pareto.clear();
        }
        self.told(&found, feasible);
        let reason = if feasible { None } else { self.own_error() };
        let methods = Method::ALL.iter();
        let name = methods.filter(|(method, _)| *method == self.options.method);
        Ok(Outcome {
            feasible,
            verified: feasible && found.checked.holds,
            binding,
            reason,
            method: name.map(|(_, name)| *name).next().unwrap_or_default(),
            cost: self.options.cost.name(),
            evaluations: ladder.evaluations + self.evaluations,
            seconds: self.begin.elapsed().as_secs_f64(),
            baseline,
            deployed,
            best_uniform: best_uniform.map(|(candidate, _)| candidate),
            best,
            pareto,
            measured: std::mem::take(&mut self.measured),
            verification: found.checked.verification,
            statistics: found.checked.statistics,
            tolerances: found.checked.tolerances,
            proven: self.proven(&found.formats),
            assumptions: self.assumptions(),
            sensitivities: sensitivities(self.problem, &found.formats, true, self.options.seed),
            ranges: ranges.nodes.clone(),
            warnings: std::mem::take(&mut self.warnings),
            journal_lost,
        })
    }

    /// Whether the limits times `margin` are met.
    fn is_within(&self, score: &Score, margin: f64) -> bool {
        let budget = front::scaled(self.budget, margin);
        let mut pairs = budget.0.iter().zip(&score.values);
        pairs.all(|(c, &value)| value == f64::NEG_INFINITY || c.ratio(value) <= 1.0)
    }

    /// Warns of what does not hold.
    fn told(&mut self, found: &Found, feasible: bool) {
        if feasible && !found.checked.holds {
            self.warnings.push(
                "the result is not verified: it misses the budget on runs that it was not tuned on; tune \
                 on more runs, with guard bits, or give a looser budget"
                    .into(),
            );
        }
        let beyond = self.beyond(&found.formats);
        for (value, (name, format)) in beyond.iter().zip(
            self.problem
                .nodes
                .iter()
                .zip(&found.formats)
                .map(|(n, f)| (n.name, f)),
        ) {
            if let Some(value) = value {
                self.warnings.push(format!(
                    "node '{name}': the constant {value} is beyond its {} bits and saturates",
                    format.word
                ));
            }
        }
    }

    /// What proofs assume of the inputs.
    fn assumptions(&self) -> Vec<String> {
        let mut all: Vec<String> = Vec::new();
        for case in self.problem.cases() {
            for (port, (lo, hi)) in case.ports.iter().enumerate() {
                let told = if (*lo, *hi) == (i32::MIN, i32::MAX) {
                    format!("port {port}: anything")
                } else {
                    format!("port {port}: raw {lo} to {hi}")
                };
                if !all.contains(&told) {
                    all.push(told);
                }
            }
        }
        all
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
