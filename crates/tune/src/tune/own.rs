//! What the algorithm misses by itself, whatever the formats.

use super::Run;
use crate::budget::{Against, Measure, Subject};
use crate::evaluate::own_value;

impl Run<'_> {
    /// Names the budget that the algorithm misses on real numbers.
    pub(super) fn own_error(&self) -> Option<String> {
        self.budget.0.iter().find_map(|constraint| {
            let Measure::Error(against, subject, statistic) = constraint.measure else {
                return None;
            };
            let values = self.prepared.iter().map(|one| {
                own_value(self.problem, one, (against, subject), statistic)
            });
            let own = values.fold(0.0, f64::max);
            (own > constraint.limit).then(|| {
                let from = match (against, subject) {
                    (Against::Truth, _) => "the truth",
                    (Against::Golden, Subject::Quantity(_) | Subject::Combined(_)) => "its reference",
                };
                format!(
                    "{}: the algorithm itself, on real numbers, is off {from} by {own:.3e}; no word \
                     lengths can meet a limit below that",
                    constraint.text
                )
            })
        })
    }
}
