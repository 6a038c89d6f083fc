//! Word lengths: ranges, sensitivities, budgets, search, Pareto front, cost models.
//!
//! A [`Problem`] is an algorithm recorded as a tape on some inputs, with what its outputs should be.
//! [`ranges()`] tells what values its nodes take, simulated and derived. [`tune()`] finds the formats
//! that meet a [`budget`] at the least [`cost`]; every trial is a run of the recorded tape on all
//! inputs, bit for bit what the deployed arithmetic would compute. The crate knows no application:
//! the attitude sensor is handed in by `cardan-bench`, a user's own algorithm by the user.

pub mod budget;
mod catalogue;
pub mod cost;
mod design;
mod deviation;
mod evaluate;
mod noise;
mod outcome;
pub mod output;
mod page;
mod pool;
mod problem;
mod ranges;
mod ranges_page;
mod rewrite;
mod search;
mod space;
mod statistics;
mod tune;
mod witness;

pub use budget::{Budget, BudgetError, Constraint};
pub use cost::Cost;
pub use evaluate::Score;
pub use noise::{NodeNoise, sensitivities};
pub use outcome::{
    Candidate, FlagCount, NamedFormats, OnTarget, Outcome, Point, Reached, Statistics, Stretch,
    Verification,
};
pub use page::page;
pub use problem::{Case, Combined, Problem, Quantity};
pub use ranges::{Bounds, NodeRange, Ranges, ranges};
pub use ranges_page::ranges_page;
pub use rewrite::rewritten;
pub use search::{JournalError, Method};
pub use space::SpaceError;
pub use statistics::CONTENT;
pub use tune::{FreshFn, OnTargetFn, Options, Progress, TuneError, tune, tune_with};
pub use witness::Witness;
