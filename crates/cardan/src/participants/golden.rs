//! The golden participant: the f64 model on the codes and on the ideal voltages.

use cardan_bench::app::Feed;
use cardan_bench::{App, Sink, SinkError};
use cardan_link::stream::IdealNodes;
use cardan_link::{NodeReal, Role, Session, Writer};

use super::native::Model;
use super::{configuration, each_conversion, lost, node_index};
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

/// Runs the golden model on both, conversion by conversion as they come.
pub(crate) fn run(session: Session, app: &'static dyn App) -> Result<(), Failure> {
    let mut blobs = session.blob_reader(Role::Emulated).map_err(lost)?;
    let configuration = configuration(&mut blobs)?;
    let mut model = Model::new(&session).map_err(lost)?;
    let mut ideals = Ideals(session.writer(IdealNodes).map_err(lost)?);
    let mut on_codes = app.golden(&configuration, Feed::Codes);
    let mut on_volts = app.golden(&configuration, Feed::IdealVolts);
    each_conversion(&session, |conversion| {
        on_codes.conversion(conversion, &mut model)?;
        on_volts.conversion(conversion, &mut ideals)
    })?;
    model.finish().map_err(lost)?;
    ideals.0.finish().map_err(lost)?;
    // Golden publishes no blobs; its stream of them ends at once.
    session
        .blob_writer()
        .map_err(lost)?
        .finish()
        .map_err(lost)?;
    session.close().map(drop).map_err(lost)
}
