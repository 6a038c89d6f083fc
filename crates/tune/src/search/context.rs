//! What every method searches in: scores with their memory, stop rules, the best so far.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use crate::budget::Budget;
use crate::cost::Cost;
use crate::evaluate::{Prepared, Score};
use crate::pool::Pool;
use crate::problem::Problem;
use crate::search::Journal;
use crate::space::{Levels, Space, builds};

/// When a search ends before its own end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Limits {
    pub(crate) evaluations: Option<u64>,
    pub(crate) time: Option<Duration>,
    /// Evaluations without a better choice.
    pub(crate) patience: Option<u64>,
}

/// The state of a search.
pub(crate) struct Context<'a, 'p> {
    pub(crate) problem: &'a Problem,
    pub(crate) budget: &'a Budget,
    pub(crate) prepared: &'a [Prepared<'a>],
    pub(crate) space: &'a Space,
    pub(crate) cost: &'a Cost,
    pub(crate) evaluations: u64,
    pub(crate) best: Option<(Levels, f64)>,
    /// The choice that is nearest to feasible.
    pub(crate) closest: Option<(Levels, Score)>,
    pool: &'p Pool<'a>,
    limits: Limits,
    begin: Instant,
    last_gain: u64,
    known: HashMap<Levels, Score>,
    journal: Option<Journal>,
    /// Which search of several on one journal it is.
    leg: u16,
    progress: &'p mut dyn FnMut(u64, Option<f64>),
}

impl<'a, 'p> Context<'a, 'p> {
    #[expect(
        clippy::too_many_arguments,
        reason = "the parts of a search, named once"
    )]
    pub(crate) fn new(
        problem: &'a Problem,
        budget: &'a Budget,
        prepared: &'a [Prepared<'a>],
        space: &'a Space,
        cost: &'a Cost,
        pool: &'p Pool<'a>,
        limits: Limits,
        journal: Option<Journal>,
        progress: &'p mut dyn FnMut(u64, Option<f64>),
    ) -> Self {
        Self {
            problem,
            budget,
            prepared,
            space,
            cost,
            evaluations: 0,
            best: None,
            closest: None,
            pool,
            limits,
            begin: Instant::now(),
            last_gain: 0,
            known: HashMap::new(),
            journal,
            leg: 0,
            progress,
        }
    }

    /// As search number `leg` after `evaluations`, which found these values of whole runs.
    pub(crate) fn go_on(
        &mut self,
        leg: u16,
        evaluations: u64,
        known: impl Iterator<Item = (Levels, Vec<f64>)>,
    ) {
        self.leg = leg;
        (self.evaluations, self.last_gain) = (evaluations, evaluations);
        for (levels, values) in known {
            let score = self.rated(values);
            self.known.insert(levels, score);
        }
    }

    /// Every choice that meets the limits, with the values of its constraints.
    pub(crate) fn feasible(&self) -> Vec<(Levels, Vec<f64>)> {
        let feasible = self.known.iter().filter(|(_, score)| score.is_feasible());
        feasible
            .map(|(levels, score)| (levels.clone(), score.values.clone()))
            .collect()
    }

    /// The journal, for the next search.
    pub(crate) fn into_journal(self) -> Option<Journal> {
        self.journal
    }

    /// A choice as the journal knows it: runs end early by the limits of their own search.
    fn entry(&self, levels: &Levels) -> Levels {
        let mut entry = levels.clone();
        entry.extend(self.leg.to_le_bytes());
        entry
    }

    /// The cost of a choice.
    pub(crate) fn cost_of(&self, levels: &[u8]) -> f64 {
        let tape = &self.prepared[0].case.tape;
        self.cost
            .of(self.problem, tape, &self.space.formats(levels))
    }

    /// True when a stop rule says so.
    pub(crate) fn is_over(&self) -> bool {
        let counted = |limit: Option<u64>, count: u64| limit.is_some_and(|limit| count >= limit);
        counted(self.limits.evaluations, self.evaluations)
            || counted(self.limits.patience, self.evaluations - self.last_gain)
            || self
                .limits
                .time
                .is_some_and(|limit| self.begin.elapsed() >= limit)
    }

    /// How many evaluations are left.
    pub(crate) fn left(&self) -> usize {
        let left = |limit: u64| limit.saturating_sub(self.evaluations) as usize;
        self.limits.evaluations.map_or(usize::MAX, left)
    }

    /// The scores of a batch, in its order; a choice that the deployed arithmetic would not build is
    /// infinitely far off and costs no evaluation. Shorter when the evaluations run out.
    pub(crate) fn scores(&mut self, batch: &[Levels]) -> Vec<Score> {
        let mut fresh: Vec<Levels> = Vec::new();
        for levels in batch {
            if self.known.contains_key(levels) || fresh.contains(levels) {
                continue;
            }
            if !builds(self.problem, &self.space.formats(levels)) {
                let refused = Score {
                    values: vec![f64::NAN; self.budget.0.len()],
                    ratio: f64::INFINITY,
                    binding: 0,
                };
                self.known.insert(levels.clone(), refused);
                continue;
            }
            if fresh.len() < self.left() {
                fresh.push(levels.clone());
            }
        }
        self.evaluate(&fresh);
        for levels in batch {
            if let Some(score) = self.known.get(levels).cloned() {
                self.note(levels, &score);
            }
        }
        (self.progress)(self.evaluations, self.best.as_ref().map(|(_, cost)| *cost));
        let scored = batch
            .iter()
            .map_while(|levels| self.known.get(levels).cloned());
        scored.collect()
    }

    /// The score of one choice; `None` when the evaluations ran out.
    pub(crate) fn score(&mut self, levels: &Levels) -> Option<Score> {
        self.scores(std::slice::from_ref(levels)).pop()
    }

    /// A score that is known already.
    pub(crate) fn known(&self, levels: &[u8]) -> Option<&Score> {
        self.known.get(levels)
    }

    fn evaluate(&mut self, fresh: &[Levels]) {
        if fresh.is_empty() {
            return;
        }
        let mut wanted = Vec::new();
        for levels in fresh {
            // What an interrupted search evaluated counts as it did then.
            self.evaluations += 1;
            let entry = self.entry(levels);
            let known = self.journal.as_mut();
            match known.and_then(|journal| journal.take(&entry)) {
                Some(values) => {
                    let score = self.rated(values);
                    self.known.insert(levels.clone(), score);
                }
                None => wanted.push(levels.clone()),
            }
        }
        let formats: Vec<_> = wanted
            .iter()
            .map(|levels| self.space.formats(levels))
            .collect();
        let scores = self.pool.scores(&formats, true);
        for (levels, score) in wanted.into_iter().zip(scores) {
            let entry = self.entry(&levels);
            if let Some(journal) = &mut self.journal {
                journal.append(&entry, &score.values);
            }
            self.known.insert(levels, score);
        }
    }

    fn rated(&self, values: Vec<f64>) -> Score {
        let mut score = Score {
            ratio: 0.0,
            binding: 0,
            values,
        };
        for (at, (constraint, value)) in self.budget.0.iter().zip(&score.values).enumerate() {
            if *value == f64::NEG_INFINITY {
                continue;
            }
            let ratio = constraint.ratio(*value);
            if ratio > score.ratio {
                (score.ratio, score.binding) = (ratio, at);
            }
        }
        score
    }

    fn note(&mut self, levels: &Levels, score: &Score) {
        let is_closer = |closest: &(Levels, Score)| score.ratio < closest.1.ratio;
        if self.closest.as_ref().is_none_or(is_closer) {
            self.closest = Some((levels.clone(), score.clone()));
        }
        if !score.is_feasible() {
            return;
        }
        let cost = self.cost_of(levels);
        if self.best.as_ref().is_none_or(|(_, best)| cost < *best) {
            self.best = Some((levels.clone(), cost));
            self.last_gain = self.evaluations;
        }
    }
}
