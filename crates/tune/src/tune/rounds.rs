//! Rounds of search and verification, for tighter limits each time.

use cardan_datapath::Format;

use super::ladder::Ladder;
use super::verify::Checked;
use super::{Progress, Run, TuneError};
use crate::problem::Case;

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
pub(super) const ROUNDS: u64 = 4;
/// What limits are taken times at first where fresh runs verify.
const FIRST_MARGIN: f64 = 0.94;
/// A round more takes limits at most times this.
const TIGHTER: f64 = 0.96;
/// And at least times this: what misses by more is a matter of ranges, which no limit mends.
const TIGHTEST: f64 = 0.75;

impl Run<'_> {
    /// Searches and verifies; with fresh runs until the result holds, for tighter limits each time.
    pub(super) fn verified(
        &mut self,
        ladder: &mut Ladder,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Found, TuneError> {
        let mut margin = if self.fresh.is_some() {
            FIRST_MARGIN
        } else {
            1.0
        };
        let mut found: Option<Found> = None;
        for round in 0..ROUNDS {
            let (formats, feasible) = self.search(ladder, margin, progress)?;
            if !feasible {
                if let Some(found) = found {
                    // Nothing is good enough to hold: what was found before is shown.
                    return Ok(found);
                }
                if margin < 1.0 {
                    // Not even tuned on is there room for a margin.
                    margin = 1.0;
                    let (formats, feasible) = self.search(ladder, margin, progress)?;
                    return self.round(round, (formats, feasible), margin);
                }
            }
            let next = self.round(round, (formats, feasible), margin)?;
            let stretch = next.checked.stretch;
            let is_done = next.checked.holds || self.fresh.is_none() || !feasible;
            found = Some(next);
            if is_done {
                break;
            }
            margin *= (0.99 / stretch).clamp(TIGHTEST, TIGHTER);
        }
        found.ok_or_else(|| TuneError::NoCase("nothing was searched".into()))
    }

    /// What one round found, checked on fresh runs of its own.
    fn round(
        &self,
        round: u64,
        (formats, feasible): (Vec<Format>, bool),
        margin: f64,
    ) -> Result<Found, TuneError> {
        let count = self.options.fresh;
        let fresh = match self.fresh {
            Some(fresh) if feasible => fresh(round * count..(round + 1) * count)?,
            _ => Vec::new(),
        };
        let mut checked = self.check(&formats, &fresh);
        if let Some(statistics) = &mut checked.statistics {
            statistics.rounds = round + 1;
        }
        Ok(Found {
            formats,
            feasible,
            margin,
            checked,
            fresh,
        })
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
