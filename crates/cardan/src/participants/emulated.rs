//! The emulated participant: the chip on its board; makes the conversions.

use cardan_bench::app::Party;
use cardan_bench::{Conversion, EngineError, Sink, SinkError, Truth};
use cardan_emulator::Pin;
use cardan_frontend::Inner;
use cardan_link::stream::{Events, Frames, Instants, Nodes, Signals, Stages};
use cardan_link::{Instant, NodeWord, Session, SignalValue, Writer};

use super::streams::MARK;
use super::{
    CONFIGURATION, Models, SUMMARY, StageWriter, engine_failure, events_of, lost, node_index,
};
use crate::dump::{Signal, Stage};
use crate::failure::Failure;
use crate::run_options::Setup;

/// Length of summaries is a multiple of this.
const SUMMARY_BLOCK: usize = 4096;

/// Publishes what the board shows.
struct Publisher {
    events: Writer<Events>,
    /// Readings of the comparator so far.
    comparators: u64,
    nodes: Writer<Nodes>,
    frames: Writer<Frames>,
    instants: Writer<Instants>,
    stages: StageWriter,
    models: Models,
    /// Members of the product's group.
    members: usize,
    signals: Writer<Signals>,
    wanted: Wanted,
}

/// The signals to publish, with their numbers in the stream.
#[derive(Default)]
struct Wanted {
    pins: Vec<(Pin, u16)>,
    inner: Vec<(u8, Stage, u16)>,
}

impl Wanted {
    fn new(signals: &[Signal]) -> Self {
        let mut wanted = Self::default();
        for signal in signals {
            match (*signal, signal.published()) {
                (Signal::Pin(pin), Some(number)) => wanted.pins.push((pin, number)),
                (Signal::Inner(channel, stage), Some(number)) => {
                    wanted.inner.push((channel, stage, number));
                }
                // The others are always published.
                _ => {}
            }
        }
        wanted
    }
}

impl Wanted {
    fn is_any(&self) -> bool {
        !self.pins.is_empty() || !self.inner.is_empty()
    }
}

impl Sink for Publisher {
    fn conversion(&mut self, conversion: &Conversion) -> Result<(), SinkError> {
        let (told, own) = events_of(conversion, self.comparators);
        if let Some(told) = told {
            self.comparators += 1;
            self.events.push(told)?;
        }
        self.events.push(own)?;
        match self.models.conversion(conversion, &mut self.stages) {
            Ok(()) => Ok(()),
            Err(EngineError::Link(error)) => Err(error),
            Err(EngineError::Input(what)) => Err(what.into()),
        }
    }

    fn word(&mut self, node: usize, value: i64, cycle: u64) -> Result<(), SinkError> {
        Ok(self.nodes.push(NodeWord {
            cycle,
            value,
            node: node_index(node)?,
        })?)
    }

    fn frame(&mut self, cycle: u64, bytes: &[u8]) -> Result<(), SinkError> {
        Ok(self.frames.push(super::native::frame(cycle, bytes)?)?)
    }

    fn pin(&mut self, cycle: u64, pin: Pin, level: bool) -> Result<(), SinkError> {
        let Some(&(_, signal)) = self.wanted.pins.iter().find(|(wanted, _)| *wanted == pin) else {
            return Ok(());
        };
        Ok(self.signals.push(SignalValue {
            cycle,
            value: f64::from(u8::from(level)),
            signal,
        })?)
    }

    fn inner(&mut self, cycle: u64, channel: u8, inner: &Inner) -> Result<(), SinkError> {
        for &(wanted, stage, signal) in &self.wanted.inner {
            let value = stage.of(inner).filter(|_| wanted == channel);
            if let Some(value) = value {
                self.signals.push(SignalValue {
                    cycle,
                    value,
                    signal,
                })?;
            }
        }
        Ok(())
    }

    fn truth(&mut self, truth: &Truth) -> Result<(), SinkError> {
        self.instants.push(Instant {
            cycle: truth.cycle,
            time_s: truth.time_s,
        })?;
        if self.wanted.is_any() {
            self.signals.push(SignalValue {
                cycle: truth.cycle + 1,
                value: 0.0,
                signal: MARK,
            })?;
        }
        // The truth is the first stage.
        for member in 0..self.members {
            let value = truth
                .values
                .as_ref()
                .map_or(f64::NAN, |values| values[member]);
            self.stages.put(0, member, value, truth.cycle)?;
        }
        Ok(())
    }
}

/// Runs the device and publishes everything it shows; pins and inner voltages as far as `signals`
/// asks for them.
pub(crate) fn run(session: Session, setup: &Setup, signals: &[Signal]) -> Result<(), Failure> {
    let (mut configuration, mut engine) = setup
        .app
        .emulated(&setup.scenario, setup.seed, setup.seconds, &setup.firmware)
        .map_err(Failure::input)?;
    configuration.shares = setup.shares;
    configuration.request = setup.request();
    let group = setup.app.outputs(&configuration).group;
    let mut blobs = session.blob_writer().map_err(lost)?;
    let text = serde_json::to_vec(&configuration).map_err(Failure::participant)?;
    blobs.send(CONFIGURATION, &text).map_err(lost)?;
    let mut publisher = Publisher {
        events: session.writer(Events).map_err(lost)?,
        comparators: 0,
        nodes: session.writer(Nodes).map_err(lost)?,
        frames: session.writer(Frames).map_err(lost)?,
        instants: session.writer(Instants).map_err(lost)?,
        stages: StageWriter(session.writer(Stages).map_err(lost)?),
        models: Models::new(setup.app, &configuration, Party::Emulated),
        members: group.map_or(0, |group| group.members.len()),
        signals: session.writer(Signals).map_err(lost)?,
        wanted: Wanted::new(signals),
    };
    for &(_, signal) in &publisher.wanted.pins {
        publisher
            .signals
            .push(SignalValue {
                cycle: 0,
                value: 0.0,
                signal,
            })
            .map_err(lost)?;
    }
    let summary = engine.run(&mut publisher).map_err(engine_failure)?;
    let Publisher {
        events,
        nodes,
        frames,
        instants,
        stages,
        signals,
        ..
    } = publisher;
    events.finish().map_err(lost)?;
    nodes.finish().map_err(lost)?;
    frames.finish().map_err(lost)?;
    instants.finish().map_err(lost)?;
    stages.0.finish().map_err(lost)?;
    signals.finish().map_err(lost)?;
    let mut text = serde_json::to_vec(&summary).map_err(Failure::participant)?;
    // Host times have more or fewer digits; padded, equal runs send equally many bytes.
    text.resize(text.len().next_multiple_of(SUMMARY_BLOCK), b' ');
    blobs.send(SUMMARY, &text).map_err(lost)?;
    blobs.finish().map_err(lost)?;
    session.close().map(drop).map_err(lost)
}
