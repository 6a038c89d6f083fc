//! The judging participant: collects every stream of the others.

use std::collections::BTreeMap;

use cardan_bench::app::Configuration;
use cardan_bench::{Conversion, Summary};
use cardan_compare::Expectation;
use cardan_link::stream::{Frames, IdealNodes, Nodes, RealNodes, Signals, Statuses, Truth};
use cardan_link::{
    BlobReader, NodeReal, NodeWord, Role, Session, SignalValue, Status, TruthSample,
};

use super::{SUMMARY, configuration, conversions, lost};
use crate::failure::Failure;

/// Values per node in the order of their writing.
pub type Streams<T> = BTreeMap<usize, Vec<T>>;

/// Everything that was published in a session.
#[derive(Clone, Debug)]
pub struct Collected {
    /// What the run was made of.
    pub configuration: Configuration,
    /// Conversions of the emulated converter.
    pub conversions: Vec<Conversion>,
    /// Truth at each solution's output instant.
    pub truths: Vec<TruthSample>,
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
    /// By shared node.
    pub golden_ideal: Streams<f64>,
    /// Frames off the emulated line.
    pub emulated_frames: Vec<Vec<u8>>,
    /// Cycle at which each of them ended.
    pub emulated_frame_cycles: Vec<u64>,
    /// Frames of the native firmware.
    pub native_frames: Vec<Vec<u8>>,
    /// What the emulated engine counted.
    pub emulated_summary: Summary,
    /// What the native engine counted.
    pub native_summary: Summary,
    /// Messages on the link.
    pub messages: u64,
    /// Bytes on the link.
    pub bytes: u64,
    /// Messages lost on the link.
    pub lost: u64,
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
    let (emulated_frames, emulated_frame_cycles) = frames(&session, Role::Emulated)?;
    let emulated_summary = summary(&mut emulated_blobs, "emulated")?;
    let (native, native_cycles) = words(&session, Role::Native, timed)?;
    let (native_frames, _) = frames(&session, Role::Native)?;
    let records = session
        .reader(Role::Native, RealNodes)
        .map_err(lost)?
        .collect()
        .map_err(lost)?;
    let expected = expectations(&records);
    let real = reals(records);
    let real_status = statuses(&session, Role::Native)?;
    let native_summary = summary(&mut native_blobs, "native")?;
    let golden = reals(
        session
            .reader(Role::Golden, RealNodes)
            .map_err(lost)?
            .collect()
            .map_err(lost)?,
    );
    let golden_status = statuses(&session, Role::Golden)?;
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
        expected,
        real_status,
        golden_status,
        golden,
        golden_ideal,
        emulated_frames,
        emulated_frame_cycles,
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

fn expectations(records: &[NodeReal]) -> Streams<Expectation> {
    let mut streams = Streams::new();
    for record in records {
        let node = usize::from(record.node);
        streams
            .entry(node)
            .or_insert_with(Vec::new)
            .push(Expectation {
                bias: record.bias,
                deviation: record.deviation,
            });
    }
    streams
}

fn statuses(session: &Session, role: Role) -> Result<Vec<Status>, Failure> {
    let reader = session.reader(role, Statuses).map_err(lost)?;
    reader.collect().map_err(lost)
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

/// Frames and the cycles at which they ended.
fn frames(session: &Session, role: Role) -> Result<(Vec<Vec<u8>>, Vec<u64>), Failure> {
    let records = session
        .reader(role, Frames)
        .map_err(lost)?
        .collect()
        .map_err(lost)?;
    Ok(records
        .iter()
        .map(|frame| (frame.bytes().to_vec(), frame.cycle()))
        .unzip())
}

fn summary(blobs: &mut BlobReader, who: &str) -> Result<Summary, Failure> {
    let bytes = blobs.expect(SUMMARY).map_err(lost)?;
    serde_json::from_slice(&bytes).map_err(|error| {
        Failure::participant(format!("'{who}' sent an unreadable summary: {error}"))
    })
}
