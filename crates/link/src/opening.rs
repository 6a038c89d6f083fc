//! Opening the ports of a role.

use std::any::Any;
use std::cell::Cell;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use crate::error::LinkError;
use crate::port::{AnyOutput, Output};
use crate::record::Notice;
use crate::session::Session;
use crate::shared::Shared;
use crate::stream::{Stream, Visitor, is_routed};
use crate::transport::GivesUp;

/// Opens a role's outputs, stream by stream.
pub(crate) struct OpenOutputs<'a>(pub(crate) &'a mut Session);

impl Visitor for OpenOutputs<'_> {
    fn visit<S: Stream>(&mut self, _: S) -> Result<(), LinkError> {
        let Shared {
            options,
            verdict,
            domain,
            ..
        } = &*self.0.shared;
        let role = options.role;
        if !S::WRITERS.contains(&role) {
            return Ok(());
        }
        let verdict = Arc::clone(verdict);
        let gives_up: GivesUp = Arc::new(move || verdict.failed());
        let port =
            domain.out_port::<S>((&options.session, role), options.capacity::<S>(), gives_up)?;
        let mut readers = options.peers();
        readers.retain(|&reader| is_routed::<S>(role, reader));
        let output = Rc::new(Output::new(S::NAME, port, readers, options.stamp()));
        let any: Rc<dyn Any> = Rc::clone(&output).as_any();
        if let Ok(notices) = any.downcast::<Output<Notice>>() {
            self.0.notices = Some(notices);
        }
        self.0.outputs.push((output, Cell::new(false)));
        Ok(())
    }
}

/// Opens a role's inputs, stream by stream, as soon as their writers have created them.
pub(crate) struct OpenInputs<'a> {
    pub(crate) session: &'a Session,
    pub(crate) deadline: Instant,
}

impl Visitor for OpenInputs<'_> {
    fn visit<S: Stream>(&mut self, _: S) -> Result<(), LinkError> {
        let Shared {
            options,
            verdict,
            domain,
            ..
        } = &*self.session.shared;
        for writer in options.peers() {
            if !is_routed::<S>(writer, options.role) {
                continue;
            }
            let mut port = None;
            self.session.wait_until(self.deadline, || {
                port = domain.in_port::<S>(&options.session, writer)?;
                Ok(port.is_some())
            })?;
            let Some(port) = port else { continue };
            self.session
                .shared
                .add_input::<S>(writer, port, Arc::clone(verdict));
        }
        Ok(())
    }
}
