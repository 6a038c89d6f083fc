//! The search for the cheapest choice that meets the budget.

mod context;
mod exchange;
mod exhaustive;
mod greedy;
mod journal;
mod model;
mod shake;

use serde::Serialize;

pub(crate) use context::{Context, Limits};
pub(crate) use exchange::SMALL;
pub(crate) use journal::Journal;
pub use journal::JournalError;

use crate::space::{Levels, SpaceError};
use model::Model;

/// How to search.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// A start from the noise model, repaired by simulation, then local descent and exchanges.
    #[default]
    Sensitivity,
    /// From the best uniform width down, each time the node that harms least per cost saved.
    MaxMinusOne,
    /// From each node's own least width up, each time the node that helps most per cost.
    MinPlusOne,
    /// Every combination in order of cost.
    Exhaustive,
    /// One width for all nodes.
    Uniform,
}

impl Method {
    /// All methods with their names.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Sensitivity, "sensitivity"),
        (Self::MaxMinusOne, "max-1"),
        (Self::MinPlusOne, "min+1"),
        (Self::Exhaustive, "exhaustive"),
        (Self::Uniform, "uniform"),
    ];
}

/// Searches; the best choice stands in the context afterwards. `start` is a feasible choice, if one
/// is known.
pub(crate) fn search(
    method: Method,
    context: &mut Context<'_, '_>,
    start: Option<&Levels>,
    kind: Kind,
    seed: u64,
) -> Result<(), SpaceError> {
    match method {
        Method::Sensitivity => {
            let mut model = Model::new(context, seed);
            model::run(context, &mut model, start, kind, seed);
        }
        Method::MaxMinusOne => greedy::down(context, start),
        Method::MinPlusOne => greedy::up(context),
        Method::Exhaustive => exhaustive::run(context)?,
        Method::Uniform => {}
    }
    Ok(())
}

/// How far a search goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// From nothing to the end.
    Whole,
    /// From nothing, as the first of several.
    First,
    /// From a good choice for somewhat tighter limits: down, exchanges, shakes.
    Thorough,
    /// From such a choice down.
    Near,
}

/// Goes on from `start`, a good choice for somewhat tighter limits.
pub(crate) fn search_on(
    method: Method,
    context: &mut Context<'_, '_>,
    start: Option<&Levels>,
    kind: Kind,
    seed: u64,
) {
    match (method, start) {
        (Method::MinPlusOne, _) => greedy::up(context),
        (Method::Sensitivity, Some(start)) => model::go_on(context, start, kind, seed),
        (_, start) => greedy::down(context, start),
    }
}
