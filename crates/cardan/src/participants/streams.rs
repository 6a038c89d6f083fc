//! What a session publishes, read side by side: one window of solutions after another.

use std::collections::{BTreeMap, VecDeque};

use cardan_bench::app::Configuration;
use cardan_bench::{Conversion, Summary};
use cardan_compare::Expectation;
use cardan_link::stream::{
    Events, Frames, Instants, Nodes, RealNodes, Signals, Stages, Statuses, Stream,
};
use cardan_link::{
    BlobReader, Event, Frame, NodeReal, NodeWord, Reader, Role, Session, SignalValue, StageValue,
};

use super::diff::{Collected, Streams};
use super::{Conversions, SUMMARY, configuration, lost};
use crate::failure::Failure;

/// What a window is cut by.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    /// Values per solution, by node; 0 for nodes that take none.
    pub(crate) per_solution: Vec<usize>,
    /// The same by node of the golden model.
    pub(crate) golden_per_solution: Vec<usize>,
    /// Whether the image has taps.
    pub(crate) taps: bool,
    /// Stages that are published, with steps of the rounding behind them: by participant.
    pub(crate) stages: [Vec<usize>; 3],
    /// Members of the group.
    pub(crate) members: usize,
    /// Nodes whose cycles are wanted.
    pub(crate) timed: Vec<usize>,
    /// Whether signals are published.
    pub(crate) signals: bool,
}

/// The signal that only says up to which cycle all others are there.
pub(crate) const MARK: u16 = u16::MAX;

/// Publishers of stages, in the order of [`Layout::stages`].
const STAGE_ROLES: [Role; 3] = [Role::Emulated, Role::Golden, Role::Native];

/// A stream with what was read of it and is in no window yet.
struct Ahead<S: Stream> {
    reader: Reader<S>,
    records: VecDeque<S::Record>,
    has_ended: bool,
}

impl<S: Stream> Ahead<S> {
    fn new(session: &Session, writer: Role, stream: S) -> Result<Self, Failure> {
        Ok(Self {
            reader: session.reader(writer, stream).map_err(lost)?,
            records: VecDeque::new(),
            has_ended: false,
        })
    }

    /// Reads on; false at the end.
    fn more(&mut self) -> Result<bool, Failure> {
        match self.reader.next_batch().map_err(lost)? {
            Some(batch) => self.records.extend(batch),
            None => self.has_ended = true,
        }
        Ok(!self.has_ended)
    }

    /// The next records, as many as there are up to `count`.
    fn take(&mut self, count: usize) -> Result<Vec<S::Record>, Failure> {
        while self.records.len() < count && !self.has_ended && self.more()? {}
        let count = count.min(self.records.len());
        Ok(self.records.drain(..count).collect())
    }

    /// The records up to a cycle.
    fn until(
        &mut self,
        cycle: u64,
        of: impl Fn(&S::Record) -> u64,
    ) -> Result<Vec<S::Record>, Failure> {
        loop {
            let is_beyond = self.records.back().is_some_and(|last| of(last) > cycle);
            if is_beyond || self.has_ended || !self.more()? {
                break;
            }
        }
        let count = self.records.partition_point(|record| of(record) <= cycle);
        Ok(self.records.drain(..count).collect())
    }
}

/// Values by node of a stream in which nodes take turns, with the records that lie ahead.
struct ByNode<S: Stream, T> {
    ahead: Ahead<S>,
    values: Vec<VecDeque<T>>,
    of: fn(&S::Record) -> (u16, T),
}

impl<S: Stream, T> ByNode<S, T> {
    fn new(
        session: &Session,
        writer: Role,
        stream: S,
        of: fn(&S::Record) -> (u16, T),
    ) -> Result<Self, Failure> {
        Ok(Self {
            ahead: Ahead::new(session, writer, stream)?,
            values: Vec::new(),
            of,
        })
    }

    fn sort_in(&mut self) {
        for record in self.ahead.records.drain(..) {
            let (node, value) = (self.of)(&record);
            let node = usize::from(node);
            if self.values.len() <= node {
                self.values.resize_with(node + 1, VecDeque::new);
            }
            self.values[node].push_back(value);
        }
    }

    /// The values of the next solutions, by node; those of nodes of which none are expected too.
    fn take(&mut self, solutions: usize, per_solution: &[usize]) -> Result<Streams<T>, Failure> {
        loop {
            self.sort_in();
            let lacks = |(node, &count): (usize, &usize)| {
                let have = self.values.get(node).map_or(0, VecDeque::len);
                have < count.saturating_mul(solutions)
            };
            let is_short = per_solution.iter().enumerate().any(lacks);
            if !is_short || self.ahead.has_ended || !self.ahead.more()? {
                break;
            }
        }
        self.sort_in();
        let mut window = Streams::new();
        for (node, values) in self.values.iter_mut().enumerate() {
            let count = match per_solution.get(node) {
                Some(&count) if count > 0 => count.saturating_mul(solutions).min(values.len()),
                _ => values.len(),
            };
            if count > 0 {
                window.insert(node, values.drain(..count).collect());
            }
        }
        Ok(window)
    }
}

/// Real values of a node with what rounding is expected to make of them.
type Real = (f64, Expectation);

fn word(record: &NodeWord) -> (u16, (i64, u64)) {
    (record.node, (record.value, record.cycle))
}

fn real(record: &NodeReal) -> (u16, Real) {
    let NodeReal {
        bias, deviation, ..
    } = *record;
    (record.node, (record.value, Expectation { bias, deviation }))
}

/// All streams of a session.
pub(crate) struct Published {
    session: Session,
    blobs: [BlobReader; 2],
    configuration: Configuration,
    events: Ahead<Events>,
    conversions: Conversions,
    instants: Ahead<Instants>,
    emulated: ByNode<Nodes, (i64, u64)>,
    native: ByNode<Nodes, (i64, u64)>,
    real: ByNode<RealNodes, Real>,
    golden: ByNode<RealNodes, Real>,
    real_status: Ahead<Statuses>,
    golden_status: Ahead<Statuses>,
    frames: [Ahead<Frames>; 2],
    stages: Vec<Ahead<Stages>>,
    signals: Ahead<Signals>,
    is_over: bool,
}

/// What is known when all streams have ended.
#[derive(Clone, Debug, Default)]
pub struct Tail {
    /// What the emulated engine counted.
    pub emulated: Summary,
    /// What the native engine counted.
    pub native: Summary,
    /// Messages on the link.
    pub messages: u64,
    /// Bytes on the link.
    pub bytes: u64,
    /// Messages lost on the link.
    pub lost: u64,
}

impl Published {
    /// Opens all streams and waits for the run's configuration.
    pub(crate) fn open(session: Session) -> Result<Self, Failure> {
        let blobs = |role| session.blob_reader(role).map_err(lost);
        let mut blobs = [blobs(Role::Emulated)?, blobs(Role::Native)?];
        let configuration = configuration(&mut blobs[0])?;
        let stages = STAGE_ROLES.map(|role| Ahead::new(&session, role, Stages));
        Ok(Self {
            configuration,
            blobs,
            events: Ahead::new(&session, Role::Emulated, Events)?,
            conversions: Conversions::default(),
            instants: Ahead::new(&session, Role::Emulated, Instants)?,
            emulated: ByNode::new(&session, Role::Emulated, Nodes, word)?,
            native: ByNode::new(&session, Role::Native, Nodes, word)?,
            real: ByNode::new(&session, Role::Native, RealNodes, real)?,
            golden: ByNode::new(&session, Role::Golden, RealNodes, real)?,
            real_status: Ahead::new(&session, Role::Native, Statuses)?,
            golden_status: Ahead::new(&session, Role::Golden, Statuses)?,
            frames: [
                Ahead::new(&session, Role::Native, Frames)?,
                Ahead::new(&session, Role::Emulated, Frames)?,
            ],
            stages: stages.into_iter().collect::<Result<_, _>>()?,
            signals: Ahead::new(&session, Role::Emulated, Signals)?,
            is_over: false,
            session,
        })
    }

    pub(crate) const fn configuration(&self) -> &Configuration {
        &self.configuration
    }

    /// The next `solutions`, or what is left of the run; none when nothing is.
    pub(crate) fn window(
        &mut self,
        layout: &Layout,
        solutions: usize,
    ) -> Result<Option<Collected>, Failure> {
        if self.is_over {
            return Ok(None);
        }
        let instants = self.instants.take(solutions)?;
        // The last window takes whatever is left over in any stream.
        self.is_over = instants.len() < solutions;
        let solutions = if self.is_over { usize::MAX } else { solutions };
        let cycle = match instants.last() {
            Some(last) if !self.is_over => last.cycle,
            _ => u64::MAX,
        };
        let events = self.events.until(cycle, |event: &Event| event.cycle)?;
        // Signals may be rare: those of a dump are marked at every solution, others are not waited for.
        let signals = match layout.signals || self.is_over {
            true => self
                .signals
                .until(cycle, |value: &SignalValue| value.cycle)?,
            false => Vec::new(),
        };
        let signals = signals.into_iter().filter(|value| value.signal != MARK);
        let conversions = events
            .iter()
            .filter_map(|event| self.conversions.next(event));
        let conversions: Vec<Conversion> = conversions.collect();
        let emulated = match layout.taps {
            true => words(self.emulated.take(solutions, &layout.per_solution)?, &[]).0,
            false => Streams::new(),
        };
        let native = self.native.take(solutions, &layout.per_solution)?;
        let (native, native_cycles) = words(native, &layout.timed);
        let (real, expected) = reals(self.real.take(solutions, &layout.per_solution)?);
        let (golden, _) = reals(self.golden.take(solutions, &layout.golden_per_solution)?);
        let [native_frames, emulated_frames] = &mut self.frames;
        let native_frames = bytes(&native_frames.take(solutions)?).0;
        let (emulated_frames, emulated_frame_cycles) = bytes(&emulated_frames.take(solutions)?);
        let mut stages = BTreeMap::new();
        for (ahead, published) in self.stages.iter_mut().zip(&layout.stages) {
            let count = solutions.saturating_mul(published.len() * layout.members);
            for StageValue {
                stage,
                member,
                value,
                ..
            } in ahead.take(count)?
            {
                let of_stage: &mut Vec<Vec<f64>> = stages
                    .entry(usize::from(stage))
                    .or_insert_with(|| vec![Vec::new(); layout.members]);
                if let Some(values) = of_stage.get_mut(usize::from(member)) {
                    values.push(value);
                }
            }
        }
        Ok(Some(Collected {
            configuration: self.configuration.clone(),
            conversions,
            instants,
            emulated,
            native,
            native_cycles,
            signals: signals.collect(),
            real,
            expected,
            real_status: self.real_status.take(solutions)?,
            golden_status: self.golden_status.take(solutions)?,
            golden,
            stages,
            emulated_frames,
            emulated_frame_cycles,
            native_frames,
            tail: Tail::default(),
        }))
    }

    /// Ends the session.
    pub(crate) fn close(mut self) -> Result<Tail, Failure> {
        let [emulated, native] = &mut self.blobs;
        let emulated = summary(emulated, "emulated")?;
        let native = summary(native, "native")?;
        let counters = self.session.close().map_err(lost)?;
        Ok(Tail {
            emulated,
            native,
            messages: counters.received.messages,
            bytes: counters.received.bytes,
            lost: counters.lost,
        })
    }
}

/// Words, and cycles of the nodes in `timed`.
fn words(values: Streams<(i64, u64)>, timed: &[usize]) -> (Streams<i64>, Streams<u64>) {
    let (mut words, mut cycles) = (Streams::new(), Streams::new());
    for (node, values) in values {
        if timed.contains(&node) {
            cycles.insert(node, values.iter().map(|(_, cycle)| *cycle).collect());
        }
        words.insert(node, values.into_iter().map(|(word, _)| word).collect());
    }
    (words, cycles)
}

fn reals(values: Streams<Real>) -> (Streams<f64>, Streams<Expectation>) {
    let (mut reals, mut expected) = (Streams::new(), Streams::new());
    for (node, values) in values {
        let (of_reals, of_expected) = values.into_iter().unzip();
        reals.insert(node, of_reals);
        expected.insert(node, of_expected);
    }
    (reals, expected)
}

/// Frames and the cycles at which they ended.
fn bytes(frames: &[Frame]) -> (Vec<Vec<u8>>, Vec<u64>) {
    frames
        .iter()
        .map(|frame| (frame.bytes().to_vec(), frame.cycle()))
        .unzip()
}

fn summary(blobs: &mut BlobReader, who: &str) -> Result<Summary, Failure> {
    let bytes = blobs.expect(SUMMARY).map_err(lost)?;
    serde_json::from_slice(&bytes).map_err(|error| {
        Failure::participant(format!("'{who}' sent an unreadable summary: {error}"))
    })
}
