//! The native participant: the firmware on the host, on the emulated converter's codes; the same algorithm in
//! its real interpretation, with what rounding is expected to make of it; and the steps between the two.

use cardan_bench::{App, Sink, SinkError};
use cardan_datapath::Format;
use cardan_link::stream::{Frames, Nodes, RealNodes, Stages, Statuses};
use cardan_link::{LinkError, NodeReal, NodeWord, Role, Session, Status, Writer};
use cardan_numerics::tape::Expected;

use super::{SUMMARY, StageWriter, configuration, each_conversion, lost, node_index};
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

/// Publishes a model's values and status words on the codes.
pub(super) struct Model {
    nodes: Writer<RealNodes>,
    statuses: Writer<Statuses>,
}

impl Model {
    pub(super) fn new(session: &Session) -> Result<Self, LinkError> {
        Ok(Self {
            nodes: session.writer(RealNodes)?,
            statuses: session.writer(Statuses)?,
        })
    }

    pub(super) fn finish(self) -> Result<(), LinkError> {
        self.nodes.finish()?;
        self.statuses.finish()
    }
}

impl Sink for Model {
    fn real(&mut self, node: usize, value: f64, cycle: u64) -> Result<(), SinkError> {
        let exact = Expected {
            value,
            bias: 0.0,
            deviation: 0.0,
        };
        self.expected(node, exact, cycle)
    }

    fn expected(&mut self, node: usize, expected: Expected, cycle: u64) -> Result<(), SinkError> {
        Ok(self.nodes.push(NodeReal {
            cycle,
            value: expected.value,
            bias: expected.bias,
            deviation: expected.deviation,
            node: node_index(node)?,
        })?)
    }

    fn status(&mut self, set: u16, doubtful: u16, cycle: u64) -> Result<(), SinkError> {
        Ok(self.statuses.push(Status {
            cycle,
            set: set.into(),
            doubtful: doubtful.into(),
        })?)
    }
}

/// Runs the firmware natively on the codes, and its real interpretation beside it, conversion by
/// conversion as they come.
pub(crate) fn run(
    session: Session,
    app: &'static dyn App,
    formats: Option<&[Format]>,
) -> Result<(), Failure> {
    let mut blobs_in = session.blob_reader(Role::Emulated).map_err(lost)?;
    let configuration = configuration(&mut blobs_in)?;
    let mut words = Words {
        nodes: session.writer(Nodes).map_err(lost)?,
        frames: session.writer(Frames).map_err(lost)?,
    };
    let mut model = Model::new(&session).map_err(lost)?;
    let mut native = app
        .native(&configuration, formats)
        .map_err(Failure::input)?;
    let mut expectation = app
        .expectation(&configuration, formats)
        .map_err(Failure::input)?;
    let steps = || app.rounding_steps(&configuration, formats);
    let mut steps = (configuration.shares.then(steps).transpose()).map_err(Failure::input)?;
    let mut stages = StageWriter(session.writer(Stages).map_err(lost)?);
    each_conversion(&session, |conversion| {
        native.conversion(conversion, &mut words)?;
        expectation.conversion(conversion, &mut model)?;
        match &mut steps {
            Some(steps) => steps.conversion(conversion, &mut stages),
            None => Ok(()),
        }
    })?;
    stages.0.finish().map_err(lost)?;
    words.nodes.finish().map_err(lost)?;
    words.frames.finish().map_err(lost)?;
    model.finish().map_err(lost)?;

    let mut blobs = session.blob_writer().map_err(lost)?;
    let text = serde_json::to_vec(&native.summary()).map_err(Failure::participant)?;
    blobs.send(SUMMARY, &text).map_err(lost)?;
    blobs.finish().map_err(lost)?;
    session.close().map(drop).map_err(lost)
}
