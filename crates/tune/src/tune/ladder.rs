//! Searches for one limit after the other, from tight to loose: a looser limit starts from what the
//! tighter ones found, and takes the cheapest of all that was evaluated on the way.
//!
//! The limits are rungs that do not depend on the budget: powers of 2^(1/4), from where the longest
//! words are good enough. So a search for a looser limit evaluates all that a search for a tighter one
//! does, and more slack never costs anything.

use std::collections::BTreeMap;
use std::time::Duration;

use super::front::scaled;
use super::trim::size;
use super::{Progress, Run, TuneError};
use crate::budget::{Constraint, Measure};
use crate::evaluate::Score;
use crate::pool::Pool;
use crate::search::{Context, Journal, Kind, Limits, Method, SMALL, search, search_on};
use crate::space::Levels;

/// Rungs per octave.
const STEPS: i32 = 4;
/// Octaves under the size of the output with all rungs; under these, one rung per octave.
const FINE_OCTAVES: i32 = 18;
/// Rungs that are multiples of it are searched more thoroughly.
const THOROUGH: i32 = 4;

/// What was evaluated so far.
#[derive(Default)]
pub(super) struct Ladder {
    /// Choices that met some rung's limits: their costs, and the values of all constraints.
    found: BTreeMap<Levels, (f64, Vec<f64>)>,
    /// The rung that was searched last.
    done: Option<i32>,
    /// The choice that came nearest to the limits of the last search that met none.
    closest: Option<(Levels, Score)>,
    pub(super) evaluations: u64,
    legs: u16,
    pub(super) journal: Option<Journal>,
    /// A stop rule ended it.
    pub(super) is_over: bool,
}

impl Ladder {
    /// For a problem with other runs: what was evaluated on those before counts as effort only.
    pub(super) fn again(&mut self) {
        self.found.clear();
        (self.done, self.closest, self.legs) = (None, None, 0);
        if let Some(journal) = &mut self.journal {
            journal.next_problem();
        }
    }
}

/// Limits that a factor scales.
fn is_scalable(constraint: &Constraint) -> bool {
    matches!(
        constraint.measure,
        Measure::Error(..) | Measure::Lsb(_) | Measure::Sqnr(_)
    )
}

impl Run<'_> {
    /// The cheapest choice known for limits times `factor`, with all rungs up to there searched.
    pub(super) fn climb(
        &self,
        ladder: &mut Ladder,
        factor: f64,
        stage: &'static str,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Option<(Levels, f64)>, TuneError> {
        let Some((limit, first)) = self.rungs() else {
            // Nothing to climb, or a space that is searched as a whole.
            self.leg(ladder, factor, (Kind::Whole, stage), None, progress)?;
            return Ok(self.cheapest(ladder, factor));
        };
        let position = f64::from(STEPS) * libm::log2(limit * factor);
        let last = position.ceil() as i32;
        if f64::from(first) > position {
            self.leg(ladder, factor, (Kind::Whole, stage), None, progress)?;
            return Ok(self.cheapest(ladder, factor));
        }
        let mut rung = ladder.done.map_or(first, |done| self.next_rung(done));
        while rung <= last.max(first) && !ladder.is_over {
            let own = libm::exp2(f64::from(rung) / f64::from(STEPS)) / limit;
            let best = self.cheapest(ladder, own).map(|(levels, _)| levels);
            let kind = match &best {
                None => Kind::First,
                Some(_) if rung % THOROUGH == 0 => Kind::Thorough,
                Some(_) => Kind::Near,
            };
            self.leg(ladder, own, (kind, stage), best.as_ref(), progress)?;
            ladder.done = Some(rung);
            rung = self.next_rung(rung);
        }
        if self.cheapest(ladder, factor).is_none() && !ladder.is_over {
            self.leg(ladder, factor, (Kind::Whole, stage), None, progress)?;
        }
        Ok(self.cheapest(ladder, factor))
    }

    /// The choice that came nearest where none is feasible.
    pub(super) fn closest(&self, ladder: &Ladder) -> Levels {
        let closest = ladder.closest.as_ref().map(|(levels, _)| levels.clone());
        closest.unwrap_or_else(|| self.space.widest())
    }

    /// The first scalable limit as a number that is to be small, and the first rung; none where no
    /// ladder is needed.
    fn rungs(&self) -> Option<(f64, i32)> {
        let method = self.options.method;
        let whole = matches!(method, Method::Exhaustive | Method::Uniform)
            || method == Method::Sensitivity && self.space.size() <= SMALL;
        let primary = self.budget.0.iter().find(|c| is_scalable(c))?;
        if whole {
            return None;
        }
        let limit = match primary.measure {
            Measure::Sqnr(_) => libm::pow(10.0, -primary.limit / 20.0),
            _ => primary.limit,
        };
        // How good the longest words are.
        let score = self.pool.score(&self.space.formats(&self.space.widest()));
        let pairs = self.budget.0.iter().zip(&score.values);
        let ratio = pairs
            .filter(|(constraint, value)| is_scalable(constraint) && value.is_finite())
            .map(|(constraint, value)| constraint.ratio(*value))
            .fold(1e-12, f64::max);
        let first = (f64::from(STEPS) * libm::log2(limit * ratio)).ceil() as i32 + 1;
        Some((limit, first))
    }

    fn next_rung(&self, rung: i32) -> i32 {
        let size = match self
            .budget
            .0
            .iter()
            .find(|c| is_scalable(c))
            .map(|c| c.measure)
        {
            Some(Measure::Error(_, subject, _)) => size(self.problem, self.prepared, subject),
            _ => 1.0,
        };
        let size = libm::log2(size.max(1e-12)).floor() as i32;
        if rung + 1 < STEPS * (size - FINE_OCTAVES) {
            STEPS * (rung.div_euclid(STEPS) + 1)
        } else {
            rung + 1
        }
    }

    /// One search, for limits times `factor`.
    fn leg(
        &self,
        ladder: &mut Ladder,
        factor: f64,
        (kind, stage): (Kind, &'static str),
        start: Option<&Levels>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<(), TuneError> {
        let budget = scaled(self.budget, factor);
        let threads = self.options.threads;
        let pool = Pool::new(
            self.problem,
            &budget,
            self.prepared,
            self.by_design,
            threads,
        );
        let mut report = |evaluations: u64, best: Option<f64>| {
            progress(Progress {
                stage,
                evaluations,
                best,
            });
        };
        let left = |seconds: f64| {
            let whole = Duration::try_from_secs_f64(seconds).ok()?;
            Some(whole.saturating_sub(self.begin.elapsed()))
        };
        // The same on every ladder: a rung must not depend on those after it.
        let own = match kind {
            Kind::Whole => u64::MAX,
            Kind::First => 2000,
            Kind::Thorough => 800,
            Kind::Near => 250,
        };
        let most = self.options.evaluations.unwrap_or(u64::MAX);
        let limits = Limits {
            evaluations: Some(most.min(ladder.evaluations.saturating_add(own))),
            time: self.options.seconds.and_then(left),
            patience: self.options.patience,
        };
        let mut context = Context::new(
            self.problem,
            &budget,
            self.prepared,
            self.space,
            &self.options.cost,
            &pool,
            limits,
            ladder.journal.take(),
            &mut report,
        );
        let known = ladder.found.iter();
        let known = known.map(|(levels, (_, values))| (levels.clone(), values.clone()));
        context.go_on(ladder.legs, ladder.evaluations, known);
        ladder.legs += 1;
        let uniform = self.uniform_levels(factor);
        let start = start.or(uniform.as_ref());
        if let Some(start) = start {
            context.score(start);
        }
        let seed = self.options.seed;
        match kind {
            Kind::Whole | Kind::First => {
                search(self.options.method, &mut context, start, kind, seed)?;
            }
            kind => search_on(self.options.method, &mut context, start, kind, seed),
        }
        ladder.evaluations = context.evaluations;
        let seconds = self.options.seconds;
        ladder.is_over = ladder.evaluations >= most
            || seconds.is_some_and(|most| self.begin.elapsed().as_secs_f64() >= most);
        if context.best.is_none() {
            ladder.closest = context.closest.take();
        }
        for (levels, values) in context.feasible() {
            let cost = || self.cost(&self.space.formats(&levels));
            ladder
                .found
                .entry(levels.clone())
                .or_insert_with(|| (cost(), values));
        }
        ladder.journal = context.into_journal();
        Ok(())
    }

    /// The cheapest choice that meets the limits times `factor`.
    fn cheapest(&self, ladder: &Ladder, factor: f64) -> Option<(Levels, f64)> {
        let budget = scaled(self.budget, factor);
        let is_within = |values: &Vec<f64>| {
            let mut pairs = budget.0.iter().zip(values);
            pairs.all(|(c, &value)| value == f64::NEG_INFINITY || c.ratio(value) <= 1.0)
        };
        let all = ladder
            .found
            .iter()
            .filter(|(_, (_, values))| is_within(values));
        let cheapest = all.min_by(|a, b| a.1.0.total_cmp(&b.1.0).then_with(|| a.0.cmp(b.0)));
        cheapest.map(|(levels, (cost, _))| (levels.clone(), *cost))
    }
}
