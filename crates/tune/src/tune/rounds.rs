//! Rounds of search and verification. A run on which a result does not hold is tuned on from then on.

use cardan_datapath::Format;

use super::ladder::Ladder;
use super::verify::Checked;
use super::{FreshFn, Progress, Run, TuneError};
use crate::problem::{Case, Problem};

/// What a round of search and verification found.
pub(super) struct Found {
    pub(super) formats: Vec<Format>,
    pub(super) feasible: bool,
    /// What the limits were taken times.
    pub(super) margin: f64,
    pub(super) checked: Checked,
    pub(super) fresh: Vec<Case>,
}

/// Rounds of search and verification at most, each on fresh runs of its own.
pub(super) const ROUNDS: u64 = 6;
/// Runs beside those tuned on that only ranges are taken from. They do not depend on the budget: a
/// looser one must not search in another space.
const RANGED: u64 = 20;
/// Fresh runs are recorded so many at a time: a result that does not hold is soon known.
const AT_A_TIME: u64 = 30;
/// What limits are taken times at first where fresh runs verify.
const FIRST_MARGIN: f64 = 0.9;
/// A limit that is missed by less than this is taken tighter in the next round; what misses by more is a
/// matter of ranges, which no limit mends.
const NEARLY: f64 = 1.25;
/// A round more takes limits at most times this.
const TIGHTER: f64 = 0.96;
/// Runs that a round adds to those tuned on, at most.
const ADDED: usize = 3;

/// What goes from one round to the next.
pub(super) struct Rounds<'a> {
    fresh: Option<&'a FreshFn<'a>>,
    pub(super) ladder: Ladder,
    round: u64,
    margin: f64,
}

/// How a round ended.
pub(super) enum Round {
    /// It holds, or no further round would mend it.
    Found(Box<Found>),
    /// It does not hold on these runs.
    Missed(Vec<Case>),
}

impl<'a> Rounds<'a> {
    pub(super) fn new(fresh: Option<&'a FreshFn<'a>>, ladder: Ladder) -> Self {
        Self {
            fresh,
            ladder,
            round: 0,
            margin: if fresh.is_some() { FIRST_MARGIN } else { 1.0 },
        }
    }

    /// Adds the runs that ranges are taken from too.
    pub(super) fn ranged(&self, problem: &mut Problem) -> Result<(), TuneError> {
        if let Some(fresh) = self.fresh {
            problem.held_out.extend(fresh(0..RANGED)?);
        }
        Ok(())
    }

    /// Fresh runs of this round, from number `from` of its own.
    fn record(&self, from: u64, to: u64, each: u64) -> Result<Vec<Case>, TuneError> {
        let first = RANGED + self.round * each;
        self.fresh
            .map_or(Ok(Vec::new()), |fresh| fresh(first + from..first + to))
    }
}

/// Runs on which a result did not hold are tuned on.
pub(super) fn tune_on(problem: &mut Problem, missed: Vec<Case>) {
    problem
        .held_out
        .retain(|held| missed.iter().all(|case| case.name != held.name));
    problem.tuning.extend(missed);
}

impl Run<'_> {
    /// Searches and verifies, for tighter limits each time, until what was found holds or there is a run
    /// that it has to be tuned on.
    pub(super) fn rounds(
        &mut self,
        rounds: &mut Rounds<'_>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Round, TuneError> {
        loop {
            let found = self.round(rounds, progress)?;
            let checked = &found.checked;
            let is_last = rounds.round == ROUNDS || rounds.ladder.is_over;
            if !found.feasible || rounds.fresh.is_none() || checked.holds || is_last {
                return Ok(Round::Found(Box::new(found)));
            }
            if checked.stretch < NEARLY {
                rounds.margin *= (0.99 / checked.stretch).min(TIGHTER);
            } else {
                rounds.ladder.again();
                return Ok(Round::Missed(self.missed(checked, &found.fresh)));
            }
        }
    }

    fn round(
        &mut self,
        rounds: &mut Rounds<'_>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Found, TuneError> {
        let (mut formats, mut feasible) =
            self.search(&mut rounds.ladder, rounds.margin, progress)?;
        if !feasible && rounds.margin < 1.0 {
            // Not even tuned on is there room for a margin.
            rounds.margin = 1.0;
            (formats, feasible) = self.search(&mut rounds.ladder, 1.0, progress)?;
        }
        rounds.ladder.evaluations += std::mem::take(&mut self.evaluations);
        let each = self.options.fresh;
        let mut fresh: Vec<Case> = Vec::new();
        let mut checked = self.check(&formats, &fresh);
        while feasible && checked.holds_so_far() && (fresh.len() as u64) < each {
            let from = fresh.len() as u64;
            let more = rounds.record(from, each.min(from + AT_A_TIME), each)?;
            if more.is_empty() {
                break;
            }
            fresh.extend(more);
            checked = self.check(&formats, &fresh);
        }
        rounds.round += 1;
        if let Some(statistics) = &mut checked.statistics {
            statistics.rounds = rounds.round;
        }
        Ok(Found {
            formats,
            feasible,
            margin: rounds.margin,
            checked,
            fresh,
        })
    }

    /// The runs on which it holds least.
    fn missed(&self, checked: &Checked, fresh: &[Case]) -> Vec<Case> {
        let mut missed: Vec<(f64, &str)> = checked.missed().collect();
        missed.sort_by(|a, b| b.0.total_cmp(&a.0));
        missed.truncate(ADDED);
        let all = || self.problem.held_out.iter().chain(fresh);
        let case = |(_, name): &(f64, &str)| all().find(|case| case.name == *name).cloned();
        missed.iter().filter_map(case).collect()
    }

    /// The best formats for limits times `margin`, or the closest, and whether they meet them.
    fn search(
        &mut self,
        ladder: &mut Ladder,
        margin: f64,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<(Vec<Format>, bool), TuneError> {
        let found = self.climb(ladder, margin, "search", progress)?;
        let searched = found.map(|(levels, _)| self.space.formats(&levels));
        let uniform = self
            .uniform_at(margin)
            .map(|uniform| uniform.formats.clone());
        // A length shorter than a range: the groups' own choices do not hold it.
        let all = [searched, uniform].into_iter().flatten();
        let cheapest = all.min_by(|a, b| self.cost(a).total_cmp(&self.cost(b)));
        let Some(mut formats) = cheapest else {
            return Ok((self.space.formats(&self.closest(ladder)), false));
        };
        self.relax(&mut formats, margin);
        Ok((formats, true))
    }
}
