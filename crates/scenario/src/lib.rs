//! What the device experiences: trajectories, recordings and the Earth field.
//!
//! A [`Scenario`] is the file (or a bundled one): motion, field, parameters of sensors, analog
//! chain and converter, tolerances. [`Trajectory::new`] makes its motion ready to run; that gives
//! the [`Experience`] at any instant through the seam [`Stimulus`], and the true attitude. Numbers
//! that were assumed are listed by [`report::assumptions`], with their reasons.
//!
//! Frames: reference magnetic north, east, down; body x forward, y right, z down when level. The
//! unit of specific force is local gravity.

mod check;
pub mod corners;
mod error;
pub mod experience;
pub mod field;
pub mod grid;
pub mod hardware;
pub mod mounting;
pub mod overlay;
pub mod parameter;
pub mod poses;
mod print;
pub mod random;
pub mod recording;
mod recording_columns;
pub mod recording_file;
mod recording_gaps;
mod recording_lines;
mod recording_plausible;
mod recording_table;
pub mod report;
pub mod rotation;
pub mod scenario;
pub mod source;
pub mod sweep;
mod syntax;
pub mod third_tilt;
pub mod tolerance;
pub mod trajectory;
pub mod tumble;

pub use error::Error;
pub use experience::{Experience, Stimulus};
pub use poses::Poses;
pub use print::print_scenario;
pub use scenario::Scenario;
pub use trajectory::Trajectory;
