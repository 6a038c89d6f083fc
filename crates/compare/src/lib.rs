//! Alignment, metrics, tolerances, error budget, verdict and report.
//!
//! A pure library: plain data in ([`Comparison`]), a [`Report`] out, from which come the document of
//! `compare --json` (by serde), a table for people ([`table::render`]) and a self-contained page
//! ([`html::page`]). It touches no file and knows neither the transport nor
//! the firmware's inside.
//!
//! # Filling a [`Comparison`]
//!
//! * Values of a node are aligned by order: the k-th write of each participant belongs together, in
//!   solution k / per_solution. A missing value is a mismatch, never cut off in silence.
//! * Give every stream as far as it goes. What lies beyond the last complete solution (beyond
//!   `flags`) is compared bit by bit but has no status flags and so is not judged against golden;
//!   the report counts it as `unfinished`.
//! * `flags` are the native participant's, one word per solution. They decide what is judged.
//! * The values of a stage have one entry per solution, not numbers where it is unknown; an empty series is
//!   one that does not exist in this run (no reference, an image without taps).
//! * A run that is too long for the memory goes through [`Judge`] in windows of whole solutions.
//!
//! ```
//! use cardan_compare::{Comparison, Node, Tolerance, compare};
//!
//! let node = Node {
//!     name: "tilt_x".into(),
//!     unit: "g".into(),
//!     per_solution: 1,
//!     lsb: 0.25,
//!     native: vec![1, 2, 3],
//!     emulated: Some(vec![1, 2, 3]),
//!     golden: Some(vec![0.26, 0.5, 0.74]),
//!     tolerance: Some(Tolerance { max_abs: 0.02, reason: "half a step".into() }),
//!     ..Node::default()
//! };
//! let comparison = Comparison { nodes: vec![node], flags: vec![0; 3], ..Comparison::default() };
//! let report = compare(&comparison);
//! assert!(report.nodes[0].pass);
//! // No frames were compared, and that is not passed over:
//! assert_eq!(report.reasons.len(), 1);
//! ```

mod bits;
mod cause;
mod chain;
pub mod html;
mod input;
mod judge;
mod limit;
mod messages;
mod metrics;
mod nodes;
mod overflow;
mod plots;
mod reason;
mod report;
mod series;
mod spread;
pub mod table;
mod verdict;
mod window;

pub use cardan_page::format;

pub use bits::{BitComparison, BitMismatch, FrameComparison, FrameMismatch};
pub use chain::{BudgetDetail, ErrorBudget, GroupErrors, PartDetail, RoundingShare};
pub use input::{
    Assumed, Comparison, EmulatorStatistics, Expectation, Format, Frames, Limit, LinkStatistics,
    Messages, NOT_JUDGED, Node, NodeInput, OnOverflow, OutputLimit, Reference, Reproduce, Required,
    Run, Tolerance, TruthTolerance, TunedError, TunedTo,
};
pub use judge::{Judge, Planned, compare, compare_with_plots};
pub use messages::{FlagCount, OutputReport, Statistics};
pub use metrics::{Difference, Normalised, Violation};
pub use nodes::{NodeReport, NodeStatus, Occurrence};
pub use plots::Plots;
pub use reason::Reason;
pub use report::{Limits, Report};
pub use series::{Chain, RoundingStep, Series, StageValues};
pub use spread::Spread;
pub use verdict::Verdict;
