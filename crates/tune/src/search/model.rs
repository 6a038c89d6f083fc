//! The default method: the noise model gives a start, simulation repairs it, and a local descent and
//! exchanges that the model ranks take what is left.

use cardan_numerics::tape::Tape;

use super::{Context, Kind, exchange, shake};
use crate::budget::{Measure, Statistic, Subject};
use crate::noise::{Gains, gains_to};
use crate::space::Levels;

/// Candidates per batch: fixed, so that results do not depend on the number of threads.
pub(super) const BATCH: usize = 8;

/// Gains that matter to one constraint, with the scales of their outputs squared.
struct Part {
    constraint: usize,
    gains: Vec<(Gains, f64)>,
    limit: f64,
    /// What simulation found over what the model predicted.
    factor: f64,
}

/// The noise model of all constraints.
pub(super) struct Model<'a> {
    tape: &'a Tape,
    parts: Vec<Part>,
}

impl<'a> Model<'a> {
    pub(super) fn new(context: &Context<'a, '_>, seed: u64) -> Self {
        let prepared = &context.prepared[0];
        let quantities = &context.problem.quantities;
        let of = |at: usize| {
            let quantity = &quantities[at];
            (
                gains_to(prepared, quantity.node, seed),
                quantity.scale.powi(2),
            )
        };
        let mut parts = Vec::new();
        for (at, constraint) in context.budget.0.iter().enumerate() {
            let (gains, factor) = match constraint.measure {
                Measure::Error(_, subject, statistic) => {
                    let gains = match subject {
                        Subject::Quantity(at) => vec![of(at)],
                        Subject::Combined(_) => (0..quantities.len()).map(of).collect(),
                    };
                    let factor = match statistic {
                        Statistic::Rms => 1.0,
                        Statistic::P99 => 2.6,
                        Statistic::Max => 4.0,
                    };
                    (gains, factor)
                }
                Measure::Sqnr(node) | Measure::Lsb(node) => {
                    (vec![(gains_to(prepared, node, seed), 1.0)], 1.0)
                }
                _ => continue,
            };
            parts.push(Part {
                constraint: at,
                gains,
                limit: constraint.limit,
                factor,
            });
        }
        Self {
            tape: &prepared.case.tape,
            parts,
        }
    }

    /// Predicted error power of each part, per node, over the limit's square.
    fn powers(&self, context: &Context<'_, '_>, levels: &[u8]) -> Vec<Vec<f64>> {
        let formats = context.space.formats(levels);
        let power = |part: &Part| {
            let mut sum = vec![0.0; formats.len()];
            for (gains, scale) in &part.gains {
                for (sum, power) in sum.iter_mut().zip(gains.per_node(self.tape, &formats)) {
                    *sum += power * scale;
                }
            }
            let unit = match context.budget.0[part.constraint].measure {
                Measure::Lsb(node) => formats[node].lsb(),
                // Only how it changes with the formats counts; the factor holds the signal.
                Measure::Sqnr(_) => 1.0,
                _ => part.limit,
            };
            let scale = (part.factor / unit).powi(2);
            sum.iter().map(|power| power * scale).collect()
        };
        self.parts.iter().map(power).collect()
    }

    /// Predicted stretch of the limits.
    pub(super) fn ratio(&self, context: &Context<'_, '_>, levels: &[u8]) -> f64 {
        let parts = self.powers(context, levels);
        let total = parts.iter().map(|powers| powers.iter().sum::<f64>());
        total.fold(0.0, f64::max).sqrt()
    }

    /// Per group: predicted share of the error, the larger of all constraints.
    pub(super) fn shares(&self, context: &Context<'_, '_>, levels: &[u8]) -> Vec<f64> {
        let parts = self.powers(context, levels);
        let share = |nodes: &Vec<usize>| {
            let of_part = |powers: &Vec<f64>| nodes.iter().map(|&n| powers[n]).sum::<f64>();
            parts.iter().map(of_part).fold(0.0, f64::max)
        };
        context
            .space
            .groups
            .iter()
            .map(|group| share(&group.nodes))
            .collect()
    }

    /// Per group: power gain to the limits, the larger of all constraints.
    fn gain(&self, group: &[usize]) -> f64 {
        let of = |part: &Part| {
            let own = |(gains, scale): &(Gains, f64)| {
                let sum: f64 = group.iter().map(|&n| gains.of_node(self.tape, n)).sum();
                sum * scale
            };
            part.gains.iter().map(own).sum::<f64>() * (part.factor / part.limit.max(1e-300)).powi(2)
        };
        self.parts.iter().map(of).fold(0.0, f64::max)
    }

    /// Sets the factors to what simulation found at `levels`.
    pub(super) fn calibrate(&mut self, context: &Context<'_, '_>, levels: &[u8]) {
        let Some(score) = context.known(levels) else {
            return;
        };
        let values = score.values.clone();
        let predicted = self.powers(context, levels);
        for (part, powers) in self.parts.iter_mut().zip(predicted) {
            let predicted = powers.iter().sum::<f64>().sqrt();
            let found = context.budget.0[part.constraint].ratio(values[part.constraint]);
            if predicted > 0.0 && found.is_finite() && found > 0.0 {
                part.factor *= (found / predicted).clamp(0.01, 100.0);
            }
        }
    }
}

/// From `start`, a good choice for somewhat tighter limits, down; then out of local optima.
pub(super) fn go_on(context: &mut Context<'_, '_>, start: &Levels, kind: Kind, seed: u64) {
    if !context
        .score(start)
        .is_some_and(|score| score.is_feasible())
    {
        return;
    }
    let mut model = Model::new(context, seed);
    let mut levels = start.clone();
    model.calibrate(context, &levels);
    if kind == Kind::Thorough {
        descend(context, &mut levels);
    }
    settle(context, &mut model, &mut levels);
    if kind == Kind::Thorough {
        exchange::run(context, &mut model, &mut levels);
        shake::run(context, &mut model, &mut levels, seed);
    }
}

/// How much finer than the model's boundary the descent begins, in halves of a bit: simulation then
/// decides which nodes lose what.
const HEAD_START: i32 = 4;
/// At most this share of the feasible steps down is taken before they are measured again.
const AT_ONCE: usize = 4;

pub(super) fn run(
    context: &mut Context<'_, '_>,
    model: &mut Model<'_>,
    start: Option<&Levels>,
    kind: Kind,
    seed: u64,
) {
    let Some(mut levels) = begin(context, model, start) else {
        return;
    };
    model.calibrate(context, &levels);
    // What the model sees no effect of first: it may go far at once.
    let unseen: Vec<usize> = (0..levels.len())
        .filter(|&group| model.gain(&context.space.groups[group].nodes) == 0.0)
        .collect();
    for group in unseen {
        lower(context, group, &mut levels, true);
    }
    descend(context, &mut levels);
    settle(context, model, &mut levels);
    if kind == Kind::Whole {
        exchange::run(context, model, &mut levels);
        shake::run(context, model, &mut levels, seed);
    }
}

/// Steepest descent by simulation: every single step down is tried, and those that stretch the limits
/// least for what they save are taken together, as far as their sum allows.
fn descend(context: &mut Context<'_, '_>, levels: &mut Levels) {
    while !context.is_over() {
        let Some(here) = context.score(levels) else {
            return;
        };
        let cost = context.cost_of(levels);
        let groups: Vec<usize> = (0..levels.len())
            .filter(|&group| levels[group] > 0)
            .collect();
        let lowered = |group: &usize| {
            let mut next = levels.clone();
            next[*group] -= 1;
            next
        };
        let batch: Vec<Levels> = groups.iter().map(lowered).collect();
        let scores = context.scores(&batch);
        let mut steps: Vec<(f64, f64, usize)> = Vec::new();
        for ((group, next), score) in groups.iter().zip(&batch).zip(&scores) {
            let saved = cost - context.cost_of(next);
            if score.is_feasible() && saved > 0.0 {
                let harm = (score.ratio.powi(2) - here.ratio.powi(2)).max(0.0);
                steps.push((harm / saved, harm, *group));
            }
        }
        steps.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        let most = steps.len().div_ceil(AT_ONCE);
        let mut room = 1.0 - here.ratio.powi(2);
        let fits = |(_, harm, _): &&(f64, f64, usize)| {
            room -= harm;
            room >= 0.0
        };
        let mut count = steps.iter().take(most).take_while(fits).count().max(1);
        if steps.is_empty() {
            return;
        }
        loop {
            let mut next = levels.clone();
            for (.., group) in &steps[..count] {
                next[*group] -= 1;
            }
            match context.score(&next) {
                Some(score) if score.is_feasible() => {
                    *levels = next;
                    break;
                }
                Some(_) if count > 1 => count /= 2,
                _ => return,
            }
        }
    }
}

/// A feasible choice near the model's optimum: all nodes bring the same error, and the whole is moved
/// up or down together until simulation agrees.
fn begin(
    context: &mut Context<'_, '_>,
    model: &Model<'_>,
    start: Option<&Levels>,
) -> Option<Levels> {
    let gains: Vec<f64> = context
        .space
        .groups
        .iter()
        .map(|group| model.gain(&group.nodes))
        .collect();
    let deployed = context.problem.deployed();
    let widest = context.space.widest();
    let choice = |context: &Context<'_, '_>, offset: f64| -> Levels {
        let level = |group: usize| {
            let members = &context.space.groups[group].nodes;
            let own = members
                .iter()
                .map(|&node| deployed[node].frac)
                .max()
                .unwrap_or(0);
            let frac = if gains[group] > 0.0 {
                0.5 * libm::log2(gains[group]) + offset
            } else {
                // The model knows nothing of it: as the designer chose it, and finer with the rest.
                f64::from(own).max(offset)
            };
            context.space.level_for(group, frac).min(widest[group])
        };
        (0..widest.len()).map(level).collect()
    };
    // In halves of a bit: from far too coarse to far too fine.
    let (mut low, mut high) = (-16_i32, 64_i32);
    let mut found = None;
    while low < high && !context.is_over() {
        let middle = (low + high).div_euclid(2);
        let levels = choice(context, f64::from(middle) / 2.0);
        if context.score(&levels)?.is_feasible() {
            high = middle;
            found = Some(levels);
        } else {
            low = middle + 1;
        }
    }
    let known = start.filter(|start| context.known(start).is_some_and(crate::Score::is_feasible));
    if found.is_some() {
        let ahead = choice(context, f64::from(high + HEAD_START) / 2.0);
        if context.score(&ahead)?.is_feasible() {
            found = Some(ahead);
        }
    }
    match (found, known) {
        (Some(found), _) => Some(found),
        (None, Some(start)) => Some(start.clone()),
        (None, None) => context.score(&widest)?.is_feasible().then_some(widest),
    }
}

/// Takes from every group what simulation allows, until no single step down is feasible: first those
/// that the model expects to harm least for what they save.
pub(super) fn settle(context: &mut Context<'_, '_>, model: &mut Model<'_>, levels: &mut Levels) {
    let mut is_first = true;
    loop {
        let mut order = order(context, model, levels);
        order.retain(|&group| levels[group] > 0);
        let mut moved = false;
        for group in order {
            if context.is_over() {
                return;
            }
            moved |= lower(context, group, levels, is_first);
        }
        is_first = false;
        if !moved {
            return;
        }
        model.calibrate(context, levels);
    }
}

/// Groups by predicted harm of one step down per cost saved.
pub(super) fn order(context: &Context<'_, '_>, model: &Model<'_>, levels: &Levels) -> Vec<usize> {
    let shares = model.shares(context, levels);
    let cost = context.cost_of(levels);
    let mut keyed: Vec<(f64, usize)> = (0..levels.len())
        .map(|group| {
            let mut next = levels.clone();
            next[group] = next[group].saturating_sub(1);
            let saved = (cost - context.cost_of(&next)).max(1e-9);
            (shares[group] / saved, group)
        })
        .collect();
    keyed.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    keyed.into_iter().map(|(_, group)| group).collect()
}

/// Lowers one group: far at first, where the model may know nothing, then step by step.
fn lower(context: &mut Context<'_, '_>, group: usize, levels: &mut Levels, far: bool) -> bool {
    let from = levels[group];
    let mut reached = from;
    if far && from > 2 {
        // Bisection takes feasibility as monotone; the later steps do not.
        let (mut low, mut high) = (0, from);
        while low < high && !context.is_over() {
            let middle = low + (high - low) / 2;
            let mut next = levels.clone();
            next[group] = middle;
            // First near where it stands: most groups have little to give.
            if high == from && low == 0 {
                next[group] = from - 1;
            }
            let tried = next[group];
            match context.score(&next) {
                Some(score) if score.is_feasible() => {
                    high = tried;
                    reached = tried;
                }
                Some(_) => low = tried + 1,
                None => break,
            }
        }
    } else {
        while reached > 0 && !context.is_over() {
            let mut next = levels.clone();
            next[group] = reached - 1;
            match context.score(&next) {
                Some(score) if score.is_feasible() => reached -= 1,
                _ => break,
            }
        }
    }
    levels[group] = reached;
    reached < from
}
