//! The cases to tune on: whether they can be judged, and what they do not exercise.

use cardan_numerics::tape::Op;

use super::TuneError;
use crate::evaluate::Prepared;
use crate::problem::Problem;
use crate::ranges::Ranges;

pub(super) fn prepare(problem: &Problem) -> Result<Vec<Prepared<'_>>, TuneError> {
    let prepared: Vec<Prepared<'_>> = problem
        .tuning
        .iter()
        .map(|case| Prepared::new(problem, case))
        .collect();
    for one in &prepared {
        if !one.judged().contains(&true) {
            let name = &one.case.name;
            return Err(TuneError::NoCase(format!(
                "'{name}' has no solution without status flags and with a known reference"
            )));
        }
    }
    if prepared.is_empty() {
        return Err(TuneError::NoCase("the problem has none".into()));
    }
    Ok(prepared)
}

/// A warning for each node that takes one value only.
pub(super) fn unexcited(ranges: &Ranges) -> impl Iterator<Item = String> + '_ {
    let unexcited = ranges.nodes.iter().filter(|node| node.unexcited);
    unexcited.map(|node| {
        format!(
            "node '{}' took the value {} only: the scenario does not excite it, its range means \
             nothing",
            node.name,
            node.min.unwrap_or_default()
        )
    })
}

/// A warning if the algorithm can raise status bits that no case raises: then nothing holds what
/// only they depend on to anything, and the search cuts it away.
pub(super) fn unraised(problem: &Problem, prepared: &[Prepared<'_>]) -> Option<String> {
    let mut possible = problem.domain_flag;
    let mut raised = 0;
    for one in prepared {
        for entry in &one.case.tape.steady {
            if let Op::Raise(flags, _) = entry.op {
                possible |= flags;
            }
        }
        raised |= one.reals.status.iter().fold(0, |all, status| all | status);
    }
    let missing = possible & !raised;
    (missing != 0).then(|| {
        format!(
            "status bits {missing:#06x} are raised by no input: formats that only they depend on are \
             held to nothing; tune on a scenario that raises them, or lock those nodes"
        )
    })
}
