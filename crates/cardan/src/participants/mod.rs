//! The participants of a session: what each reads, runs and publishes.
//!
//! `emulated` makes the conversions, `native` and `golden` work on them, `diff` judges. Each is a
//! function of its session, whether it runs in a process of its own or in a thread.

pub(crate) mod diff;
pub(crate) mod emulated;
pub(crate) mod golden;
pub(crate) mod native;

use std::time::Duration;

use cardan_bench::app::Configuration;
use cardan_bench::{Conversion, EngineError, SinkError, ThirdTilt};
use cardan_link::stream::Conversions;
use cardan_link::{
    BlobReader, Conversion as Record, LinkError, Options, Role, Session, SessionId, Transport,
};
use clap::Args;

use crate::failure::Failure;

/// Names of the blobs.
pub(crate) const CONFIGURATION: &str = "configuration";
pub(crate) const SUMMARY: &str = "summary";

/// Where participants meet.
#[derive(Args, Clone, Debug)]
pub(crate) struct JoinOptions {
    /// Session in which the participants meet
    #[arg(long, value_name = "ID")]
    pub(crate) session: String,
    #[command(flatten)]
    pub(crate) patience: Patience,
}

/// How long participants wait for each other.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Patience {
    /// Seconds to wait for the others to join
    #[arg(long, value_name = "S", default_value = "10", value_parser = seconds,
        allow_negative_numbers = true)]
    pub(crate) join_timeout: Duration,
    /// Seconds that a participant may be stopped (SIGSTOP, Ctrl-Z) before the run ends with its name
    #[arg(long, value_name = "S", default_value = "30", value_parser = seconds,
        allow_negative_numbers = true)]
    pub(crate) stall_timeout: Duration,
}

impl Patience {
    /// The same as arguments for a child process.
    pub(crate) fn arguments(self) -> [String; 4] {
        let text = |time: Duration| time.as_secs_f64().to_string();
        [
            "--join-timeout".to_owned(),
            text(self.join_timeout),
            "--stall-timeout".to_owned(),
            text(self.stall_timeout),
        ]
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let time = text.parse().ok().map(Duration::try_from_secs_f64);
    match time {
        Some(Ok(time)) => Ok(time),
        _ => Err("expected seconds, at least 0".to_owned()),
    }
}

impl JoinOptions {
    pub(crate) fn join(&self, role: Role, formats_hash: u64) -> Result<Session, Failure> {
        let session: SessionId = self.session.parse().map_err(Failure::input)?;
        let transport = Transport::Processes;
        join(role, session, formats_hash, transport, self.patience)
    }
}

pub(crate) fn join(
    role: Role,
    session: SessionId,
    format_hash: u64,
    transport: Transport,
    patience: Patience,
) -> Result<Session, Failure> {
    let options = Options {
        transport,
        format_hash,
        join_timeout: patience.join_timeout,
        stall_timeout: patience.stall_timeout,
        ..Options::new(role, session)
    };
    Session::join(options).map_err(lost)
}

/// Whatever ends a session early is exit 3.
pub(crate) fn lost(error: LinkError) -> Failure {
    Failure::participant(error)
}

/// The run's configuration, as the emulated participant announced it.
fn configuration(blobs: &mut BlobReader) -> Result<Configuration, Failure> {
    let bytes = blobs.expect(CONFIGURATION).map_err(lost)?;
    serde_json::from_slice(&bytes).map_err(|error| {
        Failure::participant(format!(
            "'emulated' sent an unreadable configuration: {error}"
        ))
    })
}

/// All conversions of the run.
fn conversions(session: &Session) -> Result<Vec<Conversion>, Failure> {
    let reader = session.reader(Role::Emulated, Conversions).map_err(lost)?;
    Ok(reader
        .collect()
        .map_err(lost)?
        .iter()
        .map(from_link)
        .collect())
}

fn from_link(record: &Record) -> Conversion {
    Conversion {
        sequence: record.sequence,
        cycle: record.cycle,
        channel: record.channel,
        code: record.code,
        ideal_volts: record.ideal_volts,
        direct_code: record.direct_code,
        experienced_code: record.experienced_code,
        late: record.is_late(),
        lost: record.is_lost(),
        third_tilt: record.has(Record::THIRD_TILT).then(|| ThirdTilt {
            upside_down: record.has(Record::UPSIDE_DOWN),
            truly_upside_down: record
                .has(Record::TRUTH)
                .then(|| record.has(Record::TRULY_UPSIDE_DOWN)),
        }),
    }
}

fn to_link(conversion: &Conversion) -> Record {
    let flag = |set: bool, bit: u8| if set { bit } else { 0 };
    let third = conversion.third_tilt;
    let upside_down = third.is_some_and(|third| third.upside_down);
    let truth = third.and_then(|third| third.truly_upside_down);
    Record {
        sequence: conversion.sequence,
        cycle: conversion.cycle,
        ideal_volts: conversion.ideal_volts,
        direct_code: conversion.direct_code,
        experienced_code: conversion.experienced_code,
        code: conversion.code,
        channel: conversion.channel,
        flags: flag(conversion.late, Record::LATE)
            | flag(conversion.lost, Record::LOST)
            | flag(third.is_some(), Record::THIRD_TILT)
            | flag(upside_down, Record::UPSIDE_DOWN)
            | flag(truth.is_some(), Record::TRUTH)
            | flag(truth == Some(true), Record::TRULY_UPSIDE_DOWN),
    }
}

/// Does `work` with every conversion of the run as it comes.
fn each_conversion(
    session: &Session,
    mut work: impl FnMut(&Conversion) -> Result<(), EngineError>,
) -> Result<(), Failure> {
    let mut reader = session.reader(Role::Emulated, Conversions).map_err(lost)?;
    while let Some(record) = reader.next().map_err(lost)? {
        work(&from_link(&record)).map_err(engine_failure)?;
    }
    Ok(())
}

/// What an engine's failure means: the link's own errors stay what they are.
fn engine_failure(error: EngineError) -> Failure {
    match error {
        EngineError::Input(message) => Failure::input(message),
        EngineError::Link(error) => Failure::participant(error),
    }
}

fn node_index(node: usize) -> Result<u16, SinkError> {
    u16::try_from(node).map_err(|_| format!("node {node}: at most 65,536 nodes").into())
}
