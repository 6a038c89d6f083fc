//! The judging participant: collects every stream of the others.

use std::collections::BTreeMap;

use cardan_bench::app::Configuration;
use cardan_bench::{Conversion, Summary};
use cardan_link::stream::{Frames, IdealNodes, Nodes, RealNodes, Signals, Truth};
use cardan_link::{BlobReader, NodeReal, NodeWord, Role, Session, SignalValue, TruthSample};

use super::{SUMMARY, configuration, conversions, lost};
use crate::failure::Failure;

/// Values per node in the order of their writing.
pub(crate) type Streams<T> = BTreeMap<usize, Vec<T>>;

/// Everything that was published in a session.
pub(crate) struct Collected {
    pub(crate) configuration: Configuration,
    pub(crate) conversions: Vec<Conversion>,
    pub(crate) truths: Vec<TruthSample>,
    pub(crate) emulated: Streams<i64>,
    pub(crate) native: Streams<i64>,
    /// Cycle of the conversion that caused each of native's words, of the nodes asked for.
    pub(crate) native_cycles: Streams<u64>,
    /// What `emulated` published for the dump.
    pub(crate) signals: Vec<SignalValue>,
    pub(crate) real: Streams<f64>,
    /// By shared node.
    pub(crate) golden: Streams<f64>,
    /// By shared node.
    pub(crate) golden_ideal: Streams<f64>,
    pub(crate) emulated_frames: Vec<Vec<u8>>,
    pub(crate) native_frames: Vec<Vec<u8>>,
    pub(crate) emulated_summary: Summary,
    pub(crate) native_summary: Summary,
    pub(crate) messages: u64,
    pub(crate) bytes: u64,
    pub(crate) lost: u64,
}

/// Collects the whole session, and the cycles of the nodes in `timed`.
pub(crate) fn collect(session: Session, timed: &[usize]) -> Result<Collected, Failure> {
    let mut emulated_blobs = session.blob_reader(Role::Emulated).map_err(lost)?;
    let mut native_blobs = session.blob_reader(Role::Native).map_err(lost)?;
    let configuration = configuration(&mut emulated_blobs)?;
    let conversions = conversions(&session)?;
    let truths = session
        .reader(Role::Emulated, Truth)
        .map_err(lost)?
        .collect()
        .map_err(lost)?;
    let signals = session
        .reader(Role::Emulated, Signals)
        .map_err(lost)?
        .collect()
        .map_err(lost)?;
    let (emulated, _) = words(&session, Role::Emulated, &[])?;
    let emulated_frames = frames(&session, Role::Emulated)?;
    let emulated_summary = summary(&mut emulated_blobs, "emulated")?;
    let (native, native_cycles) = words(&session, Role::Native, timed)?;
    let native_frames = frames(&session, Role::Native)?;
    let real = reals(
        session
            .reader(Role::Native, RealNodes)
            .map_err(lost)?
            .collect()
            .map_err(lost)?,
    );
    let native_summary = summary(&mut native_blobs, "native")?;
    let golden = reals(
        session
            .reader(Role::Golden, RealNodes)
            .map_err(lost)?
            .collect()
            .map_err(lost)?,
    );
    let golden_ideal = reals(
        session
            .reader(Role::Golden, IdealNodes)
            .map_err(lost)?
            .collect()
            .map_err(lost)?,
    );
    let counters = session.close().map_err(lost)?;
    Ok(Collected {
        configuration,
        conversions,
        truths,
        emulated,
        native,
        native_cycles,
        signals,
        real,
        golden,
        golden_ideal,
        emulated_frames,
        native_frames,
        emulated_summary,
        native_summary,
        messages: counters.received.messages,
        bytes: counters.received.bytes,
        lost: counters.lost,
    })
}

fn words(
    session: &Session,
    role: Role,
    timed: &[usize],
) -> Result<(Streams<i64>, Streams<u64>), Failure> {
    let records = session
        .reader(role, Nodes)
        .map_err(lost)?
        .collect()
        .map_err(lost)?;
    let (mut words, mut cycles) = (Streams::new(), Streams::new());
    for NodeWord { value, node, cycle } in records {
        let node = usize::from(node);
        words.entry(node).or_insert_with(Vec::new).push(value);
        if timed.contains(&node) {
            cycles.entry(node).or_insert_with(Vec::new).push(cycle);
        }
    }
    Ok((words, cycles))
}

fn reals(records: Vec<NodeReal>) -> Streams<f64> {
    let mut streams = Streams::new();
    for NodeReal { value, node, .. } in records {
        streams
            .entry(usize::from(node))
            .or_insert_with(Vec::new)
            .push(value);
    }
    streams
}

fn frames(session: &Session, role: Role) -> Result<Vec<Vec<u8>>, Failure> {
    let records = session
        .reader(role, Frames)
        .map_err(lost)?
        .collect()
        .map_err(lost)?;
    Ok(records.iter().map(|frame| frame.bytes().to_vec()).collect())
}

fn summary(blobs: &mut BlobReader, who: &str) -> Result<Summary, Failure> {
    let bytes = blobs.expect(SUMMARY).map_err(lost)?;
    serde_json::from_slice(&bytes).map_err(|error| {
        Failure::participant(format!("'{who}' sent an unreadable summary: {error}"))
    })
}
