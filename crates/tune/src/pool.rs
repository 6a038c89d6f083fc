//! Candidates evaluated on all cores: a batch is fixed beforehand and decided on in its order, so
//! that results do not depend on the number of threads.

use std::collections::HashMap;
use std::sync::Mutex;
use std::thread;

use cardan_datapath::Format;

use crate::budget::Budget;
use crate::evaluate::{Evaluator, Prepared, Score};
use crate::problem::Problem;

/// A worker per thread.
pub(crate) struct Pool<'a> {
    workers: Vec<Mutex<Evaluator<'a>>>,
}

impl<'a> Pool<'a> {
    pub(crate) fn new(
        problem: &'a Problem,
        budget: &'a Budget,
        cases: &'a [Prepared<'a>],
        by_design: &'a [bool],
        threads: usize,
    ) -> Self {
        let worker = |_| Mutex::new(Evaluator::new(problem, budget, cases, by_design));
        Self {
            workers: (0..threads.max(1)).map(worker).collect(),
        }
    }

    /// The score of one candidate, run to its end.
    pub(crate) fn score(&self, formats: &[Format]) -> Score {
        let mut scores = self.scores(&[formats.to_vec()], false);
        // One score per candidate.
        scores.remove(0)
    }

    /// The scores of a batch, in its order.
    pub(crate) fn scores(&self, batch: &[Vec<Format>], early: bool) -> Vec<Score> {
        let count = self.workers.len().min(batch.len());
        let work = |worker: usize| -> Vec<(usize, Score)> {
            let mut evaluator = match self.workers[worker].lock() {
                Ok(evaluator) => evaluator,
                Err(poisoned) => poisoned.into_inner(),
            };
            let own = (worker..batch.len()).step_by(count);
            own.map(|at| (at, evaluator.score(&batch[at], early)))
                .collect()
        };
        if count <= 1 {
            return (0..batch.len().min(1))
                .flat_map(|_| work(0))
                .map(|(_, score)| score)
                .collect();
        }
        let mut scored: HashMap<usize, Score> = thread::scope(|scope| {
            let work = &work;
            let handles: Vec<_> = (0..count)
                .map(|worker| scope.spawn(move || work(worker)))
                .collect();
            handles
                .into_iter()
                .flat_map(|handle| match handle.join() {
                    Ok(scores) => scores,
                    Err(panic) => std::panic::resume_unwind(panic),
                })
                .collect()
        });
        (0..batch.len())
            .filter_map(|at| scored.remove(&at))
            .collect()
    }
}
