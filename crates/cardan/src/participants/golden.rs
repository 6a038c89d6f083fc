//! The golden participant: the f64 model on the codes and on the ideal voltages.

use cardan_bench::app::Feed;
use cardan_bench::{App, Sink, SinkError};
use cardan_link::stream::IdealNodes;
use cardan_link::{NodeReal, Role, Session, Writer};

use super::native::Model;
use super::{configuration, conversions, engine_failure, feed, lost, node_index};
use crate::failure::Failure;

struct Ideals(Writer<IdealNodes>);

impl Sink for Ideals {
    fn real(&mut self, node: usize, value: f64, cycle: u64) -> Result<(), SinkError> {
        Ok(self.0.push(NodeReal {
            cycle,
            value,
            bias: 0.0,
            deviation: 0.0,
            node: node_index(node)?,
        })?)
    }
}

/// Runs the golden model twice.
pub(crate) fn run(session: Session, app: &'static dyn App) -> Result<(), Failure> {
    let mut blobs = session.blob_reader(Role::Emulated).map_err(lost)?;
    let configuration = configuration(&mut blobs)?;
    let conversions = conversions(&session)?;
    let mut model = Model::new(&session).map_err(lost)?;
    app.golden(&configuration, Feed::Codes)
        .run(&mut feed(&conversions), &mut model)
        .map_err(engine_failure)?;
    model.finish().map_err(lost)?;
    let mut ideals = Ideals(session.writer(IdealNodes).map_err(lost)?);
    app.golden(&configuration, Feed::IdealVolts)
        .run(&mut feed(&conversions), &mut ideals)
        .map_err(engine_failure)?;
    ideals.0.finish().map_err(lost)?;
    // Golden publishes no blobs; its stream of them ends at once.
    session
        .blob_writer()
        .map_err(lost)?
        .finish()
        .map_err(lost)?;
    session.close().map(drop).map_err(lost)
}
