//! The emulated participant: the chip on its board; makes the conversions.

use cardan_bench::{Conversion, Sink, SinkError, Truth};
use cardan_link::stream::{Conversions, Frames, Nodes, Truth as Truths};
use cardan_link::{NodeWord, Session, TruthSample, Writer};

use super::{CONFIGURATION, SUMMARY, engine_failure, lost, node_index, to_link};
use crate::failure::Failure;
use crate::run_options::Setup;

/// Length of summaries is a multiple of this.
const SUMMARY_BLOCK: usize = 4096;

/// Publishes what the board shows.
struct Publisher {
    conversions: Writer<Conversions>,
    nodes: Writer<Nodes>,
    frames: Writer<Frames>,
    truths: Writer<Truths>,
}

impl Sink for Publisher {
    fn conversion(&mut self, conversion: &Conversion) -> Result<(), SinkError> {
        Ok(self.conversions.push(to_link(conversion))?)
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

    fn truth(&mut self, truth: &Truth) -> Result<(), SinkError> {
        let [yaw_rad, pitch_rad, roll_rad] = truth.yaw_pitch_roll_rad.unwrap_or([f64::NAN; 3]);
        let sample = TruthSample {
            time_s: truth.time_s,
            roll_rad,
            pitch_rad,
            yaw_rad,
        };
        Ok(self.truths.push(sample)?)
    }
}

/// Runs the device and publishes everything it shows.
pub(crate) fn run(session: Session, setup: &Setup) -> Result<(), Failure> {
    let (configuration, mut engine) = setup
        .app
        .emulated(&setup.scenario, setup.seed, setup.seconds, &setup.firmware)
        .map_err(Failure::input)?;
    let mut blobs = session.blob_writer().map_err(lost)?;
    let text = serde_json::to_vec(&configuration).map_err(Failure::participant)?;
    blobs.send(CONFIGURATION, &text).map_err(lost)?;
    let mut publisher = Publisher {
        conversions: session.writer(Conversions).map_err(lost)?,
        nodes: session.writer(Nodes).map_err(lost)?,
        frames: session.writer(Frames).map_err(lost)?,
        truths: session.writer(Truths).map_err(lost)?,
    };
    let summary = engine
        .run(&mut std::iter::empty(), &mut publisher)
        .map_err(engine_failure)?;
    let Publisher {
        conversions,
        nodes,
        frames,
        truths,
    } = publisher;
    conversions.finish().map_err(lost)?;
    nodes.finish().map_err(lost)?;
    frames.finish().map_err(lost)?;
    truths.finish().map_err(lost)?;
    let mut text = serde_json::to_vec(&summary).map_err(Failure::participant)?;
    // Host times have more or fewer digits; padded, equal runs send equally many bytes.
    text.resize(text.len().next_multiple_of(SUMMARY_BLOCK), b' ');
    blobs.send(SUMMARY, &text).map_err(lost)?;
    blobs.finish().map_err(lost)?;
    session.close().map(drop).map_err(lost)
}
