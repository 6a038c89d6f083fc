//! Out of a local optimum: one node gains a bit so that others may lose more. The model ranks the
//! exchanges, simulation decides. Small spaces are looked through as a whole.

use super::Context;
use super::exhaustive::combinations;
use super::model::{BATCH, Model, settle};
use crate::space::Levels;

/// Spaces up to this size are looked through.
pub(crate) const SMALL: f64 = 300_000.0;
/// Exchanges that are simulated before a choice counts as good, in larger spaces.
const TRIED: usize = 64;
/// Groups that lose, and groups that gain, among which exchanges are made.
const CONSIDERED: usize = 24;

pub(super) fn run(context: &mut Context<'_, '_>, model: &mut Model<'_>, levels: &mut Levels) {
    if context.space.size() <= SMALL {
        look_through(context, model, levels);
        return;
    }
    while !context.is_over() {
        let moves = exchanges(context, model, levels);
        let Some(better) = first_feasible(context, &moves, TRIED) else {
            return;
        };
        *levels = better;
        model.calibrate(context, levels);
        settle(context, model, levels);
    }
}

/// The first feasible choice of a list, in batches.
fn first_feasible(context: &mut Context<'_, '_>, moves: &[Levels], most: usize) -> Option<Levels> {
    for batch in moves[..moves.len().min(most)].chunks(BATCH) {
        if context.is_over() {
            return None;
        }
        let scores = context.scores(batch);
        let found = batch
            .iter()
            .zip(&scores)
            .find(|(_, score)| score.is_feasible());
        if let Some((levels, _)) = found {
            return Some(levels.clone());
        }
    }
    None
}

/// Choices that cost less than `levels`, by one group's gain and two steps of loss elsewhere, the
/// most promising first.
fn exchanges(context: &Context<'_, '_>, model: &Model<'_>, levels: &Levels) -> Vec<Levels> {
    let shares = model.shares(context, levels);
    let widest = context.space.widest();
    let cost = context.cost_of(levels);
    let mut by_share: Vec<usize> = (0..levels.len()).collect();
    by_share.sort_by(|a, b| shares[*b].total_cmp(&shares[*a]).then(a.cmp(b)));
    let gaining = by_share
        .iter()
        .filter(|&&g| levels[g] < widest[g])
        .take(CONSIDERED);
    let losing: Vec<usize> = by_share
        .iter()
        .rev()
        .filter(|&&group| levels[group] > 0)
        .take(CONSIDERED)
        .copied()
        .collect();
    let mut keyed = Vec::new();
    for &gain in gaining {
        for (at, &first) in losing.iter().enumerate() {
            for &second in &losing[at..] {
                if first == gain || second == gain || (first == second && levels[first] < 2) {
                    continue;
                }
                let mut next = levels.clone();
                next[gain] += 1;
                next[first] -= 1;
                next[second] -= 1;
                if context.known(&next).is_some() || context.cost_of(&next) >= cost {
                    continue;
                }
                // A step down quadruples a share, a step up quarters it.
                let losses = if first == second {
                    15.0 * shares[first]
                } else {
                    3.0 * (shares[first] + shares[second])
                };
                keyed.push((losses - 0.75 * shares[gain], next));
            }
        }
    }
    keyed.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
    keyed.into_iter().map(|(_, levels)| levels).collect()
}

/// Beyond this predicted stretch of the limits a choice is not simulated.
const HOPELESS: f64 = 2.0;

/// Every cheaper choice of a small space that may still be feasible, the most promising first: not
/// those that lie below one that is known to miss the budget.
fn look_through(context: &mut Context<'_, '_>, model: &mut Model<'_>, levels: &mut Levels) {
    let start = context.cost_of(levels);
    let mut all: Vec<(f64, f64, Levels)> = combinations(context)
        .into_iter()
        .map(|choice| (context.cost_of(&choice), choice))
        .filter(|(cost, _)| *cost < start)
        .map(|(cost, choice)| (model.ratio(context, &choice), cost, choice))
        .filter(|(ratio, ..)| *ratio <= HOPELESS)
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.2.cmp(&b.2)));
    let mut missed: Vec<Levels> = Vec::new();
    loop {
        let cost = context.cost_of(levels);
        let below = |choice: &Levels, missed: &Levels| {
            choice.iter().zip(missed).all(|(own, other)| own <= other)
        };
        all.retain(|(_, other, choice)| {
            *other < cost
                && context.known(choice).is_none_or(crate::Score::is_feasible)
                && !missed.iter().any(|missed| below(choice, missed))
        });
        missed.clear();
        if all.is_empty() || context.is_over() {
            return;
        }
        let batch: Vec<Levels> = all
            .iter()
            .take(BATCH)
            .map(|(.., choice)| choice.clone())
            .collect();
        let scores = context.scores(&batch);
        let mut best: Option<(f64, Levels)> = None;
        for (choice, score) in batch.iter().zip(&scores) {
            if score.is_feasible() {
                let own = context.cost_of(choice);
                if best.as_ref().is_none_or(|(cost, _)| own < *cost) {
                    best = Some((own, choice.clone()));
                }
            } else {
                missed.push(choice.clone());
            }
        }
        if let Some((_, found)) = best {
            *levels = found;
            settle(context, model, levels);
        }
        if scores.len() < batch.len() {
            return;
        }
    }
}
