//! The classical greedy methods, max-1 and min+1: what the default is measured against.

use super::Context;
use crate::space::Levels;

/// From a feasible choice down: each time the step that stretches the limits least per cost saved.
pub(super) fn down(context: &mut Context<'_, '_>, start: Option<&Levels>) {
    let mut levels = start.cloned().unwrap_or_else(|| context.space.widest());
    if !context
        .score(&levels)
        .is_some_and(|score| score.is_feasible())
    {
        return;
    }
    while !context.is_over() {
        let cost = context.cost_of(&levels);
        let batch = steps(&levels, |level| level.checked_sub(1));
        let scores = context.scores(&batch);
        let chosen = batch
            .iter()
            .zip(&scores)
            .filter(|(_, score)| score.is_feasible())
            .map(|(next, score)| (score.ratio / (cost - context.cost_of(next)).max(1e-9), next))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, next)) = chosen else {
            return;
        };
        levels.clone_from(next);
    }
}

/// From each group's least width (all others widest) up, until the limits are met.
pub(super) fn up(context: &mut Context<'_, '_>) {
    let widest = context.space.widest();
    let mut levels = widest.clone();
    for group in 0..widest.len() {
        let mut alone = widest.clone();
        while alone[group] > 0 && !context.is_over() {
            alone[group] -= 1;
            if !context
                .score(&alone)
                .is_some_and(|score| score.is_feasible())
            {
                alone[group] += 1;
                break;
            }
        }
        levels[group] = alone[group];
    }
    while !context.is_over() {
        match context.score(&levels) {
            Some(score) if !score.is_feasible() => {}
            _ => return,
        }
        let cost = context.cost_of(&levels);
        let batch: Vec<Levels> = steps(&levels, |level| level.checked_add(1))
            .into_iter()
            .filter(|next| next.iter().zip(&widest).all(|(level, most)| level <= most))
            .collect();
        let scores = context.scores(&batch);
        let chosen = batch
            .iter()
            .zip(&scores)
            .map(|(next, score)| (score.ratio * (context.cost_of(next) - cost).max(1e-9), next))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, next)) = chosen else {
            return;
        };
        levels.clone_from(next);
    }
}

/// Every choice that is one step from `levels`.
fn steps(levels: &Levels, step: impl Fn(u8) -> Option<u8>) -> Vec<Levels> {
    let moved = |group: usize| {
        let mut next = levels.clone();
        next[group] = step(levels[group])?;
        Some(next)
    };
    (0..levels.len()).filter_map(moved).collect()
}
