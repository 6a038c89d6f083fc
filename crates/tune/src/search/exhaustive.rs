//! Every combination, cheapest first: the first feasible one is the optimum.

use super::Context;
use crate::space::{Levels, SpaceError};

/// Most combinations that are tried.
const MOST: u64 = 1_000_000;
/// Combinations per batch.
const BATCH: usize = 64;

pub(super) fn run(context: &mut Context<'_, '_>) -> Result<(), SpaceError> {
    let size = context.space.size();
    if size > MOST as f64 {
        return Err(SpaceError::TooLarge {
            count: size,
            most: MOST,
        });
    }
    let mut all: Vec<(f64, Levels)> = combinations(context)
        .into_iter()
        .map(|levels| (context.cost_of(&levels), levels))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
    for batch in all.chunks(BATCH) {
        if context.is_over()
            || context
                .best
                .as_ref()
                .is_some_and(|(_, cost)| *cost <= batch[0].0)
        {
            break;
        }
        let batch: Vec<Levels> = batch.iter().map(|(_, levels)| levels.clone()).collect();
        context.scores(&batch);
    }
    Ok(())
}

/// All choices of a small space.
pub(super) fn combinations(context: &Context<'_, '_>) -> Vec<Levels> {
    let mut all: Vec<Levels> = vec![Vec::new()];
    for group in &context.space.groups {
        let count = group.widths.len() as u8;
        all = all
            .iter()
            .flat_map(|levels| {
                (0..count).map(move |level| {
                    let mut levels = levels.clone();
                    levels.push(level);
                    levels
                })
            })
            .collect();
    }
    all
}
