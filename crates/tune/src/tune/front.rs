//! The Pareto front: the best choice for tighter and looser limits.

use super::ladder::Ladder;
use super::{Progress, Run, TuneError};
use crate::budget::{Budget, Constraint, Measure};
use crate::outcome::Point;

impl Run<'_> {
    /// The best choice for limits times `margin` and the factors of the options.
    pub(super) fn pareto(
        &self,
        ladder: &mut Ladder,
        margin: f64,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Vec<Point>, TuneError> {
        let mut factors = self.options.pareto.clone();
        factors.sort_by(f64::total_cmp);
        let mut points: Vec<Point> = Vec::new();
        for factor in factors {
            let found = self.climb(ladder, margin * factor, "front", progress)?;
            let Some((levels, cost)) = found else {
                continue;
            };
            let formats = self.space.formats(&levels);
            let candidate = self.candidate("front", &formats);
            points.push(Point {
                limit_factor: factor,
                bits: candidate.bits,
                cost,
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
        Ok(front)
    }
}

/// The budget with its error limits times `factor`.
pub(super) fn scaled(budget: &Budget, factor: f64) -> Budget {
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
