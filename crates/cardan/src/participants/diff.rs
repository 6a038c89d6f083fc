//! The judging participant: reads the streams of all others side by side, window by window.

use std::collections::BTreeMap;

use cardan_bench::Conversion;
use cardan_bench::app::Configuration;
use cardan_compare::Expectation;
use cardan_link::{Instant, Session, SignalValue, Status};

use super::streams::Published;
pub use super::streams::Tail;
use crate::failure::Failure;
use crate::judge::{self, Names, Outcome, Wanted};
use crate::run_options::Setup;

/// Solutions that are judged together.
const WINDOW: usize = 128;

/// Values per node in the order of their writing.
pub type Streams<T> = BTreeMap<usize, Vec<T>>;

/// Values along the chain, by stage (steps of the rounding behind them): per member, per solution.
pub type StageStreams = BTreeMap<usize, Vec<Vec<f64>>>;

/// What was published in a session, or in a window of it.
#[derive(Clone, Debug)]
pub struct Collected {
    /// What the run was made of.
    pub configuration: Configuration,
    /// Conversions of the emulated converter.
    pub conversions: Vec<Conversion>,
    /// The instants that solutions stand for.
    pub instants: Vec<Instant>,
    /// Words of the emulated chip.
    pub emulated: Streams<i64>,
    /// Words of the native firmware.
    pub native: Streams<i64>,
    /// Cycle of the conversion that caused each of native's words, of the nodes asked for.
    pub native_cycles: Streams<u64>,
    /// What `emulated` published for the dump.
    pub signals: Vec<SignalValue>,
    /// Values of the real interpretation.
    pub real: Streams<f64>,
    /// What rounding is expected to make of each value of `real`.
    pub expected: Streams<Expectation>,
    /// Status words of the real interpretation, with the bits that rounding decides.
    pub real_status: Vec<Status>,
    /// Golden's status words.
    pub golden_status: Vec<Status>,
    /// By shared node.
    pub golden: Streams<f64>,
    /// Of stages that are published as such.
    pub stages: StageStreams,
    /// Frames off the emulated line.
    pub emulated_frames: Vec<Vec<u8>>,
    /// Cycle at which each of them ended.
    pub emulated_frame_cycles: Vec<u64>,
    /// Frames of the native firmware.
    pub native_frames: Vec<Vec<u8>>,
    /// What is known at the end; of a window nothing.
    pub tail: Tail,
}

/// Judges a session as it runs.
pub(crate) fn judge(
    session: Session,
    setup: &Setup,
    names: Names<'_>,
    wanted: &Wanted<'_>,
) -> Result<Outcome, Failure> {
    let mut published = Published::open(session)?;
    let configuration = published.configuration().clone();
    setup.check_request(&configuration.request)?;
    let mut judging = judge::Session::new(setup, &configuration, names, wanted)?;
    let layout = judging.layout()?;
    while let Some(window) = published.window(&layout, WINDOW)? {
        judging.add(&window)?;
    }
    judging.finish(&published.close()?)
}

/// Collects a whole session.
pub(crate) fn collect(session: Session, setup: &Setup) -> Result<Collected, Failure> {
    let mut published = Published::open(session)?;
    let configuration = published.configuration().clone();
    let layout = judge::layout(setup, &configuration, (Vec::new(), false))?;
    let whole = published.window(&layout, usize::MAX)?;
    let tail = published.close()?;
    let whole = whole.ok_or_else(|| Failure::participant("'emulated' published nothing"))?;
    Ok(Collected { tail, ..whole })
}
