//! The native participant: the firmware on the host, on the emulated converter's codes; and the
//! same algorithm in its real interpretation.

use cardan_bench::{App, Sink, SinkError};
use cardan_datapath::Format;
use cardan_link::stream::{Frames, Nodes, RealNodes};
use cardan_link::{NodeReal, NodeWord, Role, Session, Writer};

use super::{SUMMARY, configuration, conversions, engine_failure, feed, lost, node_index};
use crate::failure::Failure;

struct Words {
    nodes: Writer<Nodes>,
    frames: Writer<Frames>,
}

impl Sink for Words {
    fn word(&mut self, node: usize, value: i64, cycle: u64) -> Result<(), SinkError> {
        Ok(self.nodes.push(NodeWord {
            cycle,
            value,
            node: node_index(node)?,
        })?)
    }

    fn frame(&mut self, cycle: u64, bytes: &[u8]) -> Result<(), SinkError> {
        Ok(self.frames.push(frame(cycle, bytes)?)?)
    }
}

/// A frame as a record.
pub(super) fn frame(cycle: u64, bytes: &[u8]) -> Result<cardan_link::Frame, SinkError> {
    cardan_link::Frame::new(cycle, bytes).ok_or_else(|| {
        format!(
            "a frame of {} bytes is longer than the link carries",
            bytes.len()
        )
        .into()
    })
}

/// Publishes real values.
pub(super) struct Reals(pub(super) Writer<RealNodes>);

impl Sink for Reals {
    fn real(&mut self, node: usize, value: f64, cycle: u64) -> Result<(), SinkError> {
        Ok(self.0.push(NodeReal {
            cycle,
            value,
            node: node_index(node)?,
        })?)
    }
}

/// Runs the firmware natively on the codes.
pub(crate) fn run(
    session: Session,
    app: &'static dyn App,
    formats: Option<&[Format]>,
) -> Result<(), Failure> {
    let mut blobs_in = session.blob_reader(Role::Emulated).map_err(lost)?;
    let configuration = configuration(&mut blobs_in)?;
    let conversions = conversions(&session)?;
    let mut words = Words {
        nodes: session.writer(Nodes).map_err(lost)?,
        frames: session.writer(Frames).map_err(lost)?,
    };
    let mut engine = app
        .native(&configuration, formats)
        .map_err(Failure::input)?;
    let summary = engine
        .run(&mut feed(&conversions), &mut words)
        .map_err(engine_failure)?;
    words.nodes.finish().map_err(lost)?;
    words.frames.finish().map_err(lost)?;

    let mut reals = Reals(session.writer(RealNodes).map_err(lost)?);
    let mut engine = app
        .real(&configuration, 0, formats)
        .map_err(Failure::input)?;
    engine
        .run(&mut feed(&conversions), &mut reals)
        .map_err(engine_failure)?;
    reals.0.finish().map_err(lost)?;

    let mut blobs = session.blob_writer().map_err(lost)?;
    let text = serde_json::to_vec(&summary).map_err(Failure::participant)?;
    blobs.send(SUMMARY, &text).map_err(lost)?;
    blobs.finish().map_err(lost)?;
    session.close().map(drop).map_err(lost)
}
