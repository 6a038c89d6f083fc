//! The participants of a session: what each reads, runs and publishes.
//!
//! `emulated` makes the conversions, `native` and `golden` work on them, `diff` judges. Each is a
//! function of its session, whether it runs in a process of its own or in a thread.

pub(crate) mod diff;
pub(crate) mod emulated;
pub(crate) mod golden;
pub(crate) mod native;
pub(crate) mod streams;

use std::time::Duration;

use cardan_bench::app::{Configuration, Party};
use cardan_bench::{App, Conversion, EngineError, Sink, SinkError, ThirdTilt};
use cardan_link::stream::{Events, Stages};
use cardan_link::{
    BlobReader, Event, LinkError, Options, Role, Session, SessionId, StageValue, Transport, Writer,
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

/// From events to conversions: what the comparator told goes with the conversion behind it.
#[derive(Debug, Default)]
struct Conversions {
    third_tilt: Option<ThirdTilt>,
}

impl Conversions {
    fn next(&mut self, event: &Event) -> Option<Conversion> {
        match event.kind {
            Event::COMPARATOR => {
                self.third_tilt = Some(ThirdTilt {
                    upside_down: event.value != 0,
                    truly_upside_down: None,
                });
                None
            }
            Event::CONVERSION => Some(Conversion {
                sequence: event.sequence,
                cycle: event.cycle,
                channel: event.channel,
                // A converter's code has ten bits.
                code: event.value as u16,
                ideal_volts: event.ideal,
                direct_code: f64::NAN,
                experienced_code: event.expected,
                late: event.is_late(),
                lost: event.is_lost(),
                third_tilt: self.third_tilt.take(),
            }),
            _ => None,
        }
    }
}

/// A conversion as events: before it what the comparator told, where there is one, as the `comparators`-th of
/// its kind.
fn events_of(conversion: &Conversion, comparators: u64) -> (Option<Event>, Event) {
    let flag = |set: bool, bit: u8| if set { bit } else { 0 };
    let own = Event {
        sequence: conversion.sequence,
        cycle: conversion.cycle,
        ideal: conversion.ideal_volts,
        expected: conversion.experienced_code,
        value: conversion.code.into(),
        kind: Event::CONVERSION,
        channel: conversion.channel,
        flags: flag(conversion.late, Event::LATE) | flag(conversion.lost, Event::LOST),
    };
    let told = conversion.third_tilt.map(|third| Event {
        sequence: comparators,
        ideal: f64::NAN,
        expected: f64::NAN,
        value: third.upside_down.into(),
        kind: Event::COMPARATOR,
        channel: 0,
        flags: 0,
        ..own
    });
    (told, own)
}

/// Does `work` with every conversion of the run as it comes.
fn each_conversion(
    session: &Session,
    mut work: impl FnMut(&Conversion) -> Result<(), EngineError>,
) -> Result<(), Failure> {
    let mut reader = session.reader(Role::Emulated, Events).map_err(lost)?;
    let mut conversions = Conversions::default();
    while let Some(event) = reader.next().map_err(lost)? {
        if let Some(conversion) = conversions.next(&event) {
            work(&conversion).map_err(engine_failure)?;
        }
    }
    Ok(())
}

/// Publishes values along the chain.
struct StageWriter(Writer<Stages>);

impl StageWriter {
    fn put(
        &mut self,
        stage: usize,
        member: usize,
        value: f64,
        cycle: u64,
    ) -> Result<(), SinkError> {
        Ok(self.0.push(StageValue {
            cycle,
            value,
            stage: node_index(stage)?,
            member: node_index(member)?,
        })?)
    }
}

impl Sink for StageWriter {
    fn stage(
        &mut self,
        stage: usize,
        member: usize,
        value: f64,
        cycle: u64,
    ) -> Result<(), SinkError> {
        self.put(stage, member, value, cycle)
    }
}

/// Runs golden on other inputs than the device's, and publishes what it makes of the group's members.
struct Models {
    engines: cardan_bench::app::Models,
    /// By node of the golden model: the member that it holds.
    members: Vec<Option<usize>>,
}

/// What a model shows of a stage.
struct OfStage<'a> {
    stages: &'a mut StageWriter,
    members: &'a [Option<usize>],
    stage: usize,
}

impl Sink for OfStage<'_> {
    fn real(&mut self, node: usize, value: f64, cycle: u64) -> Result<(), SinkError> {
        match self.members.get(node).copied().flatten() {
            Some(member) => self.stages.put(self.stage, member, value, cycle),
            None => Ok(()),
        }
    }
}

impl Models {
    fn new(app: &dyn App, configuration: &Configuration, party: Party) -> Self {
        let group = app.outputs(configuration).group;
        let members = group.map(|group| group.members).unwrap_or_default();
        let member = |node: usize| {
            let name = app.nodes()[node].name;
            members.iter().position(|member| member.node == name)
        };
        Self {
            engines: app.models(configuration, party),
            members: app.golden_nodes().into_iter().map(member).collect(),
        }
    }

    fn conversion(
        &mut self,
        conversion: &Conversion,
        stages: &mut StageWriter,
    ) -> Result<(), EngineError> {
        let members = &self.members;
        for (stage, engine) in &mut self.engines {
            let stage = *stage;
            engine.conversion(
                conversion,
                &mut OfStage {
                    stages,
                    members,
                    stage,
                },
            )?;
        }
        Ok(())
    }
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
