//! The golden participant: the f64 model on the codes and on the ideal voltages.

use cardan_bench::App;
use cardan_bench::app::{Feed, Party};
use cardan_link::stream::Stages;
use cardan_link::{Role, Session};

use super::native::Model;
use super::{Models, StageWriter, configuration, each_conversion, lost};
use crate::failure::Failure;

/// Runs the golden model on both, conversion by conversion as they come.
pub(crate) fn run(session: Session, app: &'static dyn App) -> Result<(), Failure> {
    let mut blobs = session.blob_reader(Role::Emulated).map_err(lost)?;
    let configuration = configuration(&mut blobs)?;
    let mut model = Model::new(&session).map_err(lost)?;
    let mut stages = StageWriter(session.writer(Stages).map_err(lost)?);
    let mut on_codes = app.golden(&configuration, Feed::Codes);
    let mut models = Models::new(app, &configuration, Party::Golden);
    each_conversion(&session, |conversion| {
        on_codes.conversion(conversion, &mut model)?;
        models.conversion(conversion, &mut stages)
    })?;
    model.finish().map_err(lost)?;
    stages.0.finish().map_err(lost)?;
    // Golden publishes no blobs; its stream of them ends at once.
    session
        .blob_writer()
        .map_err(lost)?
        .finish()
        .map_err(lost)?;
    session.close().map(drop).map_err(lost)
}
