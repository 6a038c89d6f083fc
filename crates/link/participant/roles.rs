//! Made-up data of every role, which every reader checks to the last bit.

use std::time::{Duration, Instant};

use cardan_link::stream::{Events, Frames, Instants, Nodes, RealNodes, Stages, Statuses, Stream};
use cardan_link::{
    Counters, Event, Frame, LinkError, NodeReal, NodeWord, Options, Reader, Role, Session,
    StageValue, Status,
};

/// One solution, that is one value per node and one frame, per so many events.
const PER_SOLUTION: u64 = 16;

/// How much there is to do, and how slowly.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Load {
    /// Events.
    pub(crate) records: u64,
    /// Diff's pause after each slice.
    pub(crate) slow: Duration,
    /// Bytes of the largest blob.
    pub(crate) blob: usize,
    /// Emulated computes for this long without touching the link, in the middle of the run.
    pub(crate) stall: Duration,
}

impl Default for Load {
    fn default() -> Self {
        Self {
            records: 20_000,
            slow: Duration::ZERO,
            blob: 100_000,
            stall: Duration::ZERO,
        }
    }
}

/// Plays one role from joining to leaving; returns the time between the two in seconds.
pub(crate) fn take_part(options: Options, load: Load) -> Result<(Counters, f64), LinkError> {
    let role = options.role;
    let session = Session::join(options)?;
    let start = Instant::now();
    match role {
        Role::Emulated => emulate(&session, load)?,
        Role::Native => compute(&session, load)?,
        Role::Golden => model(&session, load)?,
        Role::Diff => judge(&session, load)?,
    }
    Ok((session.close()?, start.elapsed().as_secs_f64()))
}

fn code(sequence: u64) -> u16 {
    (sequence.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 54) as u16
}

fn event(sequence: u64) -> Event {
    let code = code(sequence);
    Event {
        sequence,
        cycle: 1000 * sequence,
        ideal: f64::from(code) * 5.0 / 1024.0,
        expected: f64::from(code) - 511.25,
        value: code.into(),
        kind: Event::CONVERSION,
        channel: (sequence % 4) as u8,
        flags: 0,
    }
}

fn word(event: &Event) -> NodeWord {
    let value = -i64::from(event.value) << 40;
    NodeWord {
        cycle: event.cycle,
        value,
        node: event.channel.into(),
    }
}

fn real(event: &Event, value: f64) -> NodeReal {
    NodeReal {
        cycle: event.cycle,
        value,
        bias: 0.25,
        deviation: f64::INFINITY,
        node: event.channel.into(),
    }
}

fn ideal(event: &Event) -> StageValue {
    StageValue {
        cycle: event.cycle,
        value: event.ideal,
        stage: 3,
        member: event.channel.into(),
    }
}

fn status(event: &Event) -> Status {
    Status {
        cycle: event.cycle,
        set: event.value,
        doubtful: event.channel.into(),
    }
}

fn frame(event: &Event) -> Frame {
    let bytes = event
        .sequence
        .to_le_bytes()
        .repeat(1 + usize::from(event.channel));
    Frame::new(event.cycle, &bytes).expect("at most 32 bytes")
}

fn blob(len: usize) -> Vec<u8> {
    (0..len).map(|i| (i * 31 % 251) as u8).collect()
}

fn is_solution(sequence: u64) -> bool {
    sequence % PER_SOLUTION == PER_SOLUTION - 1
}

fn emulate(session: &Session, load: Load) -> Result<(), LinkError> {
    let mut blobs = session.blob_writer()?;
    blobs.send("scenario", &blob(load.blob))?;
    let (mut events, mut nodes) = (session.writer(Events)?, session.writer(Nodes)?);
    let (mut frames, mut instants) = (session.writer(Frames)?, session.writer(Instants)?);
    for sequence in 0..load.records {
        let now = event(sequence);
        events.push(now)?;
        if is_solution(sequence) {
            nodes.push(word(&now))?;
            frames.push(frame(&now))?;
            let time_s = sequence as f64;
            let cycle = now.cycle;
            instants.push(cardan_link::Instant { cycle, time_s })?;
        }
        if sequence == load.records / 2 {
            std::thread::sleep(load.stall);
        }
    }
    events.finish()?;
    nodes.finish()?;
    frames.finish()?;
    instants.finish()?;
    blobs.send("summary", b"{}")?;
    blobs.finish()
}

fn compute(session: &Session, load: Load) -> Result<(), LinkError> {
    let mut blobs = session.blob_reader(Role::Emulated)?;
    assert_eq!(blobs.expect("scenario")?, blob(load.blob));
    let mut events = session.reader(Role::Emulated, Events)?;
    let (mut nodes, mut frames) = (session.writer(Nodes)?, session.writer(Frames)?);
    let mut count = 0;
    while let Some(now) = events.next()? {
        assert_eq!(now, event(count));
        count += 1;
        if is_solution(now.sequence) {
            nodes.push(word(&now))?;
            frames.push(frame(&now))?;
        }
    }
    assert_eq!(count, load.records);
    nodes.finish()?;
    frames.finish()
}

fn model(session: &Session, load: Load) -> Result<(), LinkError> {
    let mut events = session.reader(Role::Emulated, Events)?;
    let (mut codes, mut ideals) = (session.writer(RealNodes)?, session.writer(Stages)?);
    let mut statuses = session.writer(Statuses)?;
    let mut count = 0;
    while let Some(now) = events.next()? {
        assert_eq!(now, event(count));
        count += 1;
        if is_solution(now.sequence) {
            codes.push(real(&now, f64::from(now.value)))?;
            ideals.push(ideal(&now))?;
            statuses.push(status(&now))?;
        }
    }
    assert_eq!(count, load.records);
    codes.finish()?;
    statuses.finish()?;
    ideals.finish()
}

fn check<S: Stream>(
    mut reader: Reader<S>,
    load: Load,
    expected: impl Fn(&Event) -> S::Record,
) -> Result<(), LinkError>
where
    S::Record: PartialEq,
{
    let mut solutions = (0..load.records).filter(|&s| is_solution(s)).map(event);
    while let Some(batch) = reader.next_batch()? {
        std::thread::sleep(load.slow);
        for record in batch {
            assert_eq!(Some(record), solutions.next().as_ref().map(&expected));
        }
    }
    assert_eq!(solutions.next(), None, "{} is too short", S::NAME);
    Ok(())
}

/// Reads stream after stream, the worst order for the writers' buffers.
fn judge(session: &Session, load: Load) -> Result<(), LinkError> {
    check(session.reader(Role::Native, Nodes)?, load, word)?;
    check(session.reader(Role::Emulated, Nodes)?, load, word)?;
    check(session.reader(Role::Golden, RealNodes)?, load, |c| {
        real(c, f64::from(c.value))
    })?;
    check(session.reader(Role::Golden, Stages)?, load, ideal)?;
    check(session.reader(Role::Golden, Statuses)?, load, status)?;
    check(session.reader(Role::Emulated, Frames)?, load, frame)?;
    check(session.reader(Role::Native, Frames)?, load, frame)?;
    let mut events = session.reader(Role::Emulated, Events)?;
    let mut count = 0;
    while let Some(batch) = events.next_batch()? {
        std::thread::sleep(load.slow);
        for record in batch {
            assert_eq!(record, event(count));
            count += 1;
        }
    }
    assert_eq!(count, load.records);
    let mut blobs = session.blob_reader(Role::Emulated)?;
    assert_eq!(blobs.expect("scenario")?, blob(load.blob));
    assert_eq!(blobs.expect("summary")?, b"{}");
    assert_eq!(blobs.next()?, None);
    Ok(())
}
