//! Joining a session, waiting for each other, and leaving it together.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::time::Instant;

use crate::blob::{BlobReader, BlobWriter};
use crate::cleanup;
use crate::error::{Death, LinkError};
use crate::handle::{Reader, Writer};
use crate::opening::{OpenInputs, OpenOutputs};
use crate::options::Options;
use crate::port::{AnyInput, AnyOutput, Input, Output, Traffic};
use crate::record::Notice;
use crate::resources;
use crate::role::Role;
use crate::shared::Shared;
use crate::stream::{Blobs, Notices, Stream, for_each};
use crate::transport::{Domain, Transport, pause, peers};
use crate::watch::{Verdict, Watch, end_with_supervisor};

/// What crossed the link, as one participant saw it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// What this participant published (once, however many read it).
    pub sent: Traffic,
    /// What it received.
    pub received: Traffic,
    /// Messages lost: 0, since any loss is an error that ends the session.
    pub lost: u64,
}

/// A participant's place in a session. Leave it with [`close`](Session::close); dropping it
/// before tells the others to give up.
pub struct Session {
    /// Each with whether its writer is taken.
    pub(crate) outputs: Vec<(Rc<dyn AnyOutput>, Cell<bool>)>,
    untaken: RefCell<Vec<Rc<dyn AnyInput>>>,
    pub(crate) notices: Option<Rc<Output<Notice>>>,
    closed: bool,
    watch: Option<Watch>,
    pub(crate) shared: Rc<Shared>,
}

impl Session {
    /// Joins a session and waits until everyone expected is there and sees everyone's streams.
    ///
    /// # Errors
    /// [`LinkError::JoinTimeout`] names who did not come, [`LinkError::RoleTaken`] another
    /// participant of this role, [`LinkError::PeerDied`] one that went meanwhile.
    pub fn join(options: Options) -> Result<Self, LinkError> {
        crate::quieten();
        cleanup::await_management();
        let verdict = Arc::<Verdict>::default();
        end_with_supervisor();
        if options.transport == Transport::Processes {
            resources::check()?;
        }
        if !options.supervised && options.transport == Transport::Processes {
            cleanup::heal();
            cleanup::cleanup(&options.session);
        }
        let mut stale = peers(options.transport, &options.session)?;
        stale.retain(|peer| !peer.alive);
        let domain = Domain::new(options.transport, &options.session, options.role)?;
        let watch = Watch::start(
            options.transport,
            options.session.clone(),
            options.peers(),
            stale,
            // A supervisor looks after its children itself.
            (!options.supervised && options.transport == Transport::Processes)
                .then_some(options.stall_timeout),
            Arc::clone(&verdict),
        );
        let deadline = Instant::now() + options.join_timeout;
        let shared = Rc::new(Shared::new(options, verdict, domain));
        let mut session = Self {
            outputs: Vec::new(),
            untaken: RefCell::default(),
            notices: None,
            closed: false,
            watch: Some(watch),
            shared,
        };
        // All outputs first: each input waits for an output of somebody else.
        for_each(&mut OpenOutputs(&mut session))?;
        for_each(&mut OpenInputs {
            session: &session,
            deadline,
        })?;
        session.untaken = RefCell::new(session.shared.inputs.borrow().clone());
        session.meet(deadline)?;
        Ok(session)
    }

    /// The writer of one of this participant's streams. Each can be had once; a stream that is
    /// never asked for is ended, empty, by [`close`](Self::close).
    ///
    /// # Errors
    /// [`LinkError::NotRouted`] when this role does not publish it, or at the second time.
    pub fn writer<S: Stream>(&self, _: S) -> Result<Writer<S>, LinkError> {
        let role = self.shared.role();
        let missing = LinkError::NotRouted {
            stream: S::NAME,
            from: role,
            to: role,
        };
        let found = self
            .outputs
            .iter()
            .find(|(output, _)| output.stream() == S::NAME);
        let Some((output, taken)) = found.filter(|(_, taken)| !taken.get()) else {
            return Err(missing);
        };
        let output = Rc::clone(output).as_any();
        let output = output
            .downcast::<Output<S::Record>>()
            .map_err(|_| missing)?;
        taken.set(true);
        let capacity = self.shared.options.capacity::<S>().batch;
        Ok(Writer::new(Rc::clone(&self.shared), output, capacity))
    }

    /// The reader of a stream of another participant. Each can be had once; until then its
    /// records wait in memory.
    ///
    /// # Errors
    /// [`LinkError::NotRouted`] when it does not flow to this role, or at the second time.
    pub fn reader<S: Stream>(&self, writer: Role, _: S) -> Result<Reader<S>, LinkError> {
        let to = self.shared.role();
        let missing = LinkError::NotRouted {
            stream: S::NAME,
            from: writer,
            to,
        };
        let mut untaken = self.untaken.borrow_mut();
        let wanted =
            |input: &Rc<dyn AnyInput>| input.writer() == writer && input.stream() == S::NAME;
        let Some(at) = untaken.iter().position(wanted) else {
            return Err(missing);
        };
        let input: Rc<dyn Any> = untaken.swap_remove(at).as_any();
        let input = input.downcast::<Input<S::Record>>().map_err(|_| missing)?;
        Ok(Reader::new(Rc::clone(&self.shared), input, writer))
    }

    /// The writer of this participant's blobs.
    ///
    /// # Errors
    /// As [`writer`](Self::writer).
    pub fn blob_writer(&self) -> Result<BlobWriter, LinkError> {
        self.writer(Blobs).map(BlobWriter)
    }

    /// The reader of a participant's blobs.
    ///
    /// # Errors
    /// As [`reader`](Self::reader).
    pub fn blob_reader(&self, writer: Role) -> Result<BlobReader, LinkError> {
        self.reader(writer, Blobs).map(BlobReader::new)
    }

    /// Fails once the session cannot succeed any more; for long work between transfers.
    ///
    /// # Errors
    /// Whatever ended the session.
    pub fn check(&self) -> Result<(), LinkError> {
        self.shared.check()
    }

    /// What crossed the link so far, without the session's own notices.
    #[must_use]
    pub fn counters(&self) -> Counters {
        let data = |stream: &str| stream != Notices::NAME;
        let sent = self.outputs.iter().map(|(output, _)| output);
        let sent = sent
            .filter(|output| data(output.stream()))
            .map(|output| output.traffic());
        let inputs = self.shared.inputs.borrow();
        let received = inputs.iter().filter(|input| data(input.stream()));
        Counters {
            sent: sent.fold(Traffic::default(), Traffic::plus),
            received: received
                .map(|input| input.traffic())
                .fold(Traffic::default(), Traffic::plus),
            lost: 0,
        }
    }

    /// Leaves the session when everyone has everything: waits until all streams of the others
    /// have ended here, and all readers have seen the end of this participant's streams.
    ///
    /// # Errors
    /// [`LinkError::Unfinished`] when a writer was not finished, else whatever ended the session.
    pub fn close(mut self) -> Result<Counters, LinkError> {
        let data = |stream: &str| stream != Notices::NAME;
        let open = self
            .outputs
            .iter()
            .filter(|(output, _)| !output.is_finished());
        let (taken, untaken): (Vec<_>, Vec<_>) = open
            .filter(|(output, _)| data(output.stream()))
            .partition(|(_, taken)| taken.get());
        if let Some((output, _)) = taken.first() {
            let role = self.shared.role();
            return Err(LinkError::Unfinished {
                role,
                stream: output.stream(),
            });
        }
        for (output, _) in untaken {
            output.end().map_err(|error| self.shared.explain(error))?;
        }
        self.wait_for_ends(data)?;
        // The last word, after which peers do not mind if this participant is gone.
        if let Some(notices) = &self.notices {
            notices.end().map_err(|error| self.shared.explain(error))?;
        }
        self.wait_for_ends(|_| true)?;
        self.closed = true;
        Ok(self.counters())
    }

    /// Waits until the chosen streams have ended, here and at the others.
    fn wait_for_ends(&self, chosen: impl Fn(&str) -> bool) -> Result<(), LinkError> {
        let have_ended = || {
            let inputs = self.shared.inputs.borrow();
            inputs
                .iter()
                .all(|input| !chosen(input.stream()) || input.has_ended())
                && self
                    .outputs
                    .iter()
                    .all(|(o, _)| !chosen(o.stream()) || o.readers() == 0)
        };
        let mut idle = 0;
        while !have_ended() {
            self.shared.drain_or_pause(&mut idle)?;
        }
        Ok(())
    }

    /// Waits for all ports, then tells so, then waits until all others have told so. Only then
    /// has every reader connected to every writer, and nothing that is sent can miss anyone.
    fn meet(&self, deadline: Instant) -> Result<(), LinkError> {
        self.wait_until(deadline, || {
            let outputs = self.outputs.iter();
            let mut all = outputs.fold(true, |all, (o, _)| {
                all & (o.readers() == o.expected_readers())
            });
            for input in self.shared.inputs.borrow().iter() {
                all &= input.connect()?;
            }
            Ok(all)
        })?;
        let ready = Notice {
            kind: Notice::READY,
            about: 0,
            death: 0,
        };
        self.tell(ready)
            .map_err(|error| self.shared.explain(error))?;
        self.wait_until(deadline, || {
            self.shared.drain()?;
            Ok(self.shared.all_ready())
        })
    }

    pub(crate) fn wait_until(
        &self,
        deadline: Instant,
        mut done: impl FnMut() -> Result<bool, LinkError>,
    ) -> Result<(), LinkError> {
        let mut round = 0;
        loop {
            self.shared.check()?;
            if done().map_err(|error| self.shared.explain(error))? {
                return Ok(());
            }
            if Instant::now() >= deadline {
                return Err(self.shared.timeout());
            }
            std::thread::sleep(pause(round));
            round += 1;
        }
    }

    /// Tells the others that this participant leaves early, and because of whom.
    fn abort(&self) {
        let (role, how) = match self.shared.check() {
            Err(LinkError::PeerDied { role, how }) => (role, how),
            _ => (self.shared.role(), Death::Aborted),
        };
        let notice = Notice {
            kind: Notice::ABORT,
            about: role.index() as u8,
            death: how.code(),
        };
        // Those who are left read it; those who are not need not.
        let _ = self.tell(notice);
    }

    fn tell(&self, notice: Notice) -> Result<(), LinkError> {
        self.notices
            .as_ref()
            .map_or(Ok(()), |notices| notices.send(&[notice]))
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        if !self.closed {
            self.abort();
        }
        drop(self.watch.take());
    }
}
