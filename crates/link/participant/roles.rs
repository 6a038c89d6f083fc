//! Made-up data of every role, which every reader checks to the last bit.

use std::time::{Duration, Instant};

use cardan_link::stream::{
    Conversions, Frames, IdealNodes, Nodes, RealNodes, Statuses, Stream, Truth,
};
use cardan_link::{
    Conversion, Counters, Frame, LinkError, NodeReal, NodeWord, Options, Reader, Role, Session,
    Status, TruthSample,
};

/// One solution, that is one value per node and one frame, per so many conversions.
const PER_SOLUTION: u64 = 16;

/// How much there is to do, and how slowly.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Load {
    /// Conversions.
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

fn conversion(sequence: u64) -> Conversion {
    let code = code(sequence);
    Conversion {
        sequence,
        cycle: 1000 * sequence,
        ideal_volts: f64::from(code) * 5.0 / 1024.0,
        direct_code: f64::from(code) - 511.5,
        experienced_code: f64::from(code) - 511.25,
        code,
        channel: (sequence % 4) as u8,
        flags: 0,
    }
}

fn word(conversion: &Conversion) -> NodeWord {
    let value = -i64::from(conversion.code) << 40;
    NodeWord {
        cycle: conversion.cycle,
        value,
        node: conversion.channel.into(),
    }
}

fn real(conversion: &Conversion, value: f64) -> NodeReal {
    NodeReal {
        cycle: conversion.cycle,
        value,
        bias: 0.25,
        deviation: f64::INFINITY,
        node: conversion.channel.into(),
    }
}

fn status(conversion: &Conversion) -> Status {
    Status {
        cycle: conversion.cycle,
        set: conversion.code.into(),
        doubtful: conversion.channel.into(),
    }
}

fn frame(conversion: &Conversion) -> Frame {
    let bytes = conversion
        .sequence
        .to_le_bytes()
        .repeat(1 + usize::from(conversion.channel));
    Frame::new(conversion.cycle, &bytes).expect("at most 32 bytes")
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
    let (mut conversions, mut nodes) = (session.writer(Conversions)?, session.writer(Nodes)?);
    let (mut frames, mut truth) = (session.writer(Frames)?, session.writer(Truth)?);
    for sequence in 0..load.records {
        let now = conversion(sequence);
        conversions.push(now)?;
        if is_solution(sequence) {
            nodes.push(word(&now))?;
            frames.push(frame(&now))?;
            let time_s = sequence as f64;
            truth.push(TruthSample {
                time_s,
                roll_rad: 0.0,
                pitch_rad: 0.1,
                yaw_rad: 0.2,
            })?;
        }
        if sequence == load.records / 2 {
            std::thread::sleep(load.stall);
        }
    }
    conversions.finish()?;
    nodes.finish()?;
    frames.finish()?;
    truth.finish()?;
    blobs.send("summary", b"{}")?;
    blobs.finish()
}

fn compute(session: &Session, load: Load) -> Result<(), LinkError> {
    let mut blobs = session.blob_reader(Role::Emulated)?;
    assert_eq!(blobs.expect("scenario")?, blob(load.blob));
    let mut conversions = session.reader(Role::Emulated, Conversions)?;
    let (mut nodes, mut frames) = (session.writer(Nodes)?, session.writer(Frames)?);
    let mut count = 0;
    while let Some(now) = conversions.next()? {
        assert_eq!(now, conversion(count));
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
    let mut conversions = session.reader(Role::Emulated, Conversions)?;
    let (mut codes, mut ideals) = (session.writer(RealNodes)?, session.writer(IdealNodes)?);
    let mut statuses = session.writer(Statuses)?;
    let mut count = 0;
    while let Some(now) = conversions.next()? {
        assert_eq!(now, conversion(count));
        count += 1;
        if is_solution(now.sequence) {
            codes.push(real(&now, f64::from(now.code)))?;
            ideals.push(real(&now, now.ideal_volts))?;
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
    expected: impl Fn(&Conversion) -> S::Record,
) -> Result<(), LinkError>
where
    S::Record: PartialEq,
{
    let mut solutions = (0..load.records)
        .filter(|&s| is_solution(s))
        .map(conversion);
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
        real(c, f64::from(c.code))
    })?;
    check(session.reader(Role::Golden, IdealNodes)?, load, |c| {
        real(c, c.ideal_volts)
    })?;
    check(session.reader(Role::Golden, Statuses)?, load, status)?;
    check(session.reader(Role::Emulated, Frames)?, load, frame)?;
    check(session.reader(Role::Native, Frames)?, load, frame)?;
    let mut conversions = session.reader(Role::Emulated, Conversions)?;
    let mut count = 0;
    while let Some(batch) = conversions.next_batch()? {
        std::thread::sleep(load.slow);
        for record in batch {
            assert_eq!(record, conversion(count));
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
