//! Iterated local search: some groups gain a bit, and simulation takes from all the others what
//! that allows. What comes out cheaper, or as cheap with more room to the limits, is gone on from.

use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

use super::Context;
use super::model::{BATCH, Model, order};
use crate::evaluate::Score;
use crate::space::Levels;

/// Random draws of two to four groups that are tried in vain before the search ends.
const DRAWS: usize = 160;
/// A step down is not simulated if the model expects this many times the room that is left: the
/// model may be wrong, but rarely by that.
const HOPELESS: f64 = 8.0;

pub(super) fn run(
    context: &mut Context<'_, '_>,
    model: &mut Model<'_>,
    levels: &mut Levels,
    seed: u64,
) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let Some(mut score) = context.score(levels) else {
        return;
    };
    while let Some((found, reached)) = better(context, model, levels, &score, &mut rng) {
        (*levels, score) = (found, reached);
        model.calibrate(context, levels);
    }
}

/// The first shake that ends better than `levels`: single groups, then random draws.
fn better(
    context: &mut Context<'_, '_>,
    model: &Model<'_>,
    levels: &Levels,
    score: &Score,
    rng: &mut ChaCha8Rng,
) -> Option<(Levels, Score)> {
    let shares = model.shares(context, levels);
    let widest = context.space.widest();
    let mut groups: Vec<usize> = (0..levels.len())
        .filter(|&group| shares[group] > 0.0 && levels[group] < widest[group])
        .collect();
    groups.sort_by(|a, b| shares[*b].total_cmp(&shares[*a]).then(a.cmp(b)));
    if groups.is_empty() {
        return None;
    }
    let mut below = |limit: usize| rng.next_u32() as usize % limit;
    let mut draw = |_| -> Vec<usize> {
        let count = 2 + below(3);
        (0..count).map(|_| groups[below(groups.len())]).collect()
    };
    let draws: Vec<Vec<usize>> = (0..DRAWS).map(&mut draw).collect();
    let cost = context.cost_of(levels);
    let singles = groups.iter().map(std::slice::from_ref);
    for shake in singles.chain(draws.iter().map(Vec::as_slice)) {
        if context.is_over() {
            return None;
        }
        let Some((found, reached)) = shaken(context, model, levels, shake) else {
            continue;
        };
        let other = context.cost_of(&found);
        if other < cost || other == cost && reached.ratio < score.ratio {
            return Some((found, reached));
        }
    }
    None
}

/// `levels` with a bit more for `raised`, and what the others can then lose.
fn shaken(
    context: &mut Context<'_, '_>,
    model: &Model<'_>,
    levels: &Levels,
    raised: &[usize],
) -> Option<(Levels, Score)> {
    let widest = context.space.widest();
    let mut next = levels.clone();
    for &group in raised {
        next[group] = (next[group] + 1).min(widest[group]);
    }
    let mut score = context.score(&next)?;
    if !score.is_feasible() {
        return None;
    }
    while let Some((lower, reached)) = lowered(context, model, &next, &score, raised) {
        (next, score) = (lower, reached);
    }
    Some((next, score))
}

/// The first feasible step down of a group that was not raised.
fn lowered(
    context: &mut Context<'_, '_>,
    model: &Model<'_>,
    levels: &Levels,
    score: &Score,
    raised: &[usize],
) -> Option<(Levels, Score)> {
    let shares = model.shares(context, levels);
    let room = 1.0 - score.ratio.powi(2);
    let candidates: Vec<Levels> = order(context, model, levels)
        .into_iter()
        .filter(|group| levels[*group] > 0 && !raised.contains(group))
        // A step down quadruples a share.
        .filter(|&group| 3.0 * shares[group] <= HOPELESS * room)
        .map(|group| {
            let mut next = levels.clone();
            next[group] -= 1;
            next
        })
        .collect();
    for batch in candidates.chunks(BATCH) {
        if context.is_over() {
            return None;
        }
        let scores = context.scores(batch);
        let found = batch.iter().zip(scores).find(|(_, s)| s.is_feasible());
        if let Some((next, score)) = found {
            return Some((next.clone(), score));
        }
    }
    None
}
