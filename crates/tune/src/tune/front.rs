//! The Pareto front: the best choice for tighter and looser limits.

use super::{Progress, Run};
use crate::budget::{Budget, Constraint, Measure};
use crate::outcome::Point;
use crate::pool::Pool;
use crate::search::{Context, Limits, search_near};
use crate::space::Levels;

impl Run<'_> {
    /// The best choice for scaled limits.
    pub(super) fn pareto(
        &mut self,
        start: &Levels,
        progress: &mut dyn FnMut(Progress),
    ) -> Vec<Point> {
        const EVALUATIONS: u64 = 1200;
        let mut points: Vec<Point> = Vec::new();
        for &factor in &self.options.pareto {
            let budget = scaled(self.budget, factor);
            let pool = Pool::new(self.problem, &budget, self.prepared, self.options.threads);
            let mut report = |evaluations: u64, best: Option<f64>| {
                progress(Progress {
                    stage: "front",
                    evaluations,
                    best,
                });
            };
            let limits = Limits {
                evaluations: Some(EVALUATIONS),
                ..Limits::default()
            };
            let mut context = Context::new(
                self.problem,
                &budget,
                self.prepared,
                self.space,
                &self.options.cost,
                &pool,
                limits,
                None,
                &mut report,
            );
            let bits = -libm::log2(factor).floor() as i32;
            search_near(&mut context, start, bits, self.options.seed);
            let Some((levels, cost)) = &context.best else {
                continue;
            };
            let formats = self.space.formats(levels);
            let candidate = self.candidate("front", &formats);
            points.push(Point {
                limit_factor: factor,
                bits: candidate.bits,
                cost: *cost,
                error: candidate.error,
                formats: candidate.formats,
            });
        }
        points.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        // Only those that none beats in both.
        let mut front: Vec<Point> = Vec::new();
        for point in points {
            let error = point.error.unwrap_or(f64::INFINITY);
            let is_better = |last: &Point| error < last.error.unwrap_or(f64::INFINITY);
            if front.last().is_none_or(is_better) {
                front.push(point);
            }
        }
        front
    }
}

/// The budget with its error limits times `factor`.
fn scaled(budget: &Budget, factor: f64) -> Budget {
    let scale = |constraint: &Constraint| {
        let limit = match constraint.measure {
            Measure::Error(..) | Measure::Lsb(_) => constraint.limit * factor,
            Measure::Sqnr(_) => constraint.limit - 20.0 * libm::log10(factor),
            _ => constraint.limit,
        };
        Constraint {
            limit,
            ..constraint.clone()
        }
    };
    Budget(budget.0.iter().map(scale).collect())
}
