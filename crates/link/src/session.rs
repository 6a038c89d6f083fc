//! Joining a session, waiting for each other, and leaving it together.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::blob::{BlobReader, BlobWriter};
use crate::cleanup;
use crate::error::{Death, LinkError};
use crate::handle::{Reader, Writer};
use crate::port::{AnyInput, AnyOutput, Input, Output, Stamp, Traffic};
use crate::record::{Notice, Record};
use crate::role::Role;
use crate::session_id::SessionId;
use crate::stream::{Blobs, Notices, Stream, Visitor, for_each, is_routed};
use crate::supervisor::SUPERVISED;
use crate::transport::{Capacity, Domain, GivesUp, InPort, Transport, pause, peers};
use crate::watch::{Verdict, Watch, watch_supervisor};

/// Slices per reader that a participant's notices may occupy: it sends two.
const NOTICE_SLICES: usize = 4;

/// Bytes of a blob per slice.
const BLOB_BATCH: usize = 64 * 1024;

/// How long a failed transfer waits for the watch to name the peer that caused it.
const BLAME_TIME: Duration = Duration::from_millis(1000);

/// By then every peer has noticed a death.
const NOTICE_TIME: Duration = Duration::from_millis(400);

/// How to take part in a session.
#[derive(Debug, Clone)]
pub struct Options {
    /// This participant's part.
    pub role: Role,
    /// Where to meet.
    pub session: SessionId,
    /// Who takes part; this participant itself may be in it or not.
    pub expected: Vec<Role>,
    /// Processes or threads.
    pub transport: Transport,
    /// Hash of the format table; all participants must have the same.
    pub format_hash: u64,
    /// How long to wait for the others.
    pub join_timeout: Duration,
    /// Records per slice.
    pub batch_records: usize,
    /// Slices that wait per reader before the writer must wait.
    pub buffered_batches: usize,
    /// A supervisor holds standard input open and cleans up. Set in the environment by
    /// [`Supervisor`](crate::Supervisor).
    pub supervised: bool,
}

impl Options {
    /// All four roles, 10 s to join, batches of 256 records, 16 of which are buffered per reader.
    #[must_use]
    pub fn new(role: Role, session: SessionId) -> Self {
        Self {
            role,
            session,
            expected: Role::ALL.to_vec(),
            transport: Transport::Processes,
            format_hash: 0,
            join_timeout: Duration::from_secs(10),
            batch_records: 256,
            buffered_batches: 16,
            supervised: std::env::var_os(SUPERVISED).is_some(),
        }
    }

    fn stamp(&self) -> Stamp {
        Stamp {
            session: self.session.hash(),
            format: self.format_hash,
        }
    }

    fn peers(&self) -> Vec<Role> {
        let mut peers: Vec<_> = self
            .expected
            .iter()
            .copied()
            .filter(|&role| role != self.role)
            .collect();
        peers.sort_unstable();
        peers.dedup();
        peers
    }

    fn capacity<S: Stream>(&self) -> Capacity {
        let batches = self.buffered_batches.max(1);
        match S::NAME {
            Notices::NAME => Capacity {
                batch: 1,
                batches: NOTICE_SLICES,
            },
            Blobs::NAME => Capacity {
                batch: BLOB_BATCH,
                batches,
            },
            _ => Capacity {
                batch: self.batch_records.max(1),
                batches,
            },
        }
    }
}

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

/// The state that a session shares with its writers and readers.
pub(crate) struct Shared {
    options: Options,
    verdict: Arc<Verdict>,
    inputs: RefCell<Vec<Rc<dyn AnyInput>>>,
    notices: RefCell<Vec<Rc<Input<Notice>>>>,
    ready: [Cell<bool>; Role::ALL.len()],
    /// After the ports, which it outlives.
    domain: Domain,
    /// Last of all: by then this participant has left.
    _last: CleanUp,
}

/// Cleans up behind a killed peer where no supervisor does.
struct CleanUp {
    session: SessionId,
    verdict: Arc<Verdict>,
    by_hand: bool,
}

impl Drop for CleanUp {
    fn drop(&mut self) {
        let killed = Err(Death::Killed);
        let how = self.verdict.check().map_err(|error| match error {
            LinkError::PeerDied { how, .. } => how,
            _ => Death::Left,
        });
        if self.by_hand && how == killed {
            // The others must have noticed before the traces are gone.
            std::thread::sleep(NOTICE_TIME);
            cleanup::cleanup(&self.session);
        }
    }
}

impl Shared {
    pub(crate) fn role(&self) -> Role {
        self.options.role
    }

    pub(crate) fn check(&self) -> Result<(), LinkError> {
        self.verdict.check()
    }

    /// The next slice of one input; drains the others while there is none.
    pub(crate) fn next_batch<T: Record>(
        &self,
        input: &Input<T>,
    ) -> Result<Option<Vec<T>>, LinkError> {
        let mut idle = 0;
        loop {
            self.check()?;
            if let Some(batch) = input.take() {
                return Ok(Some(batch));
            }
            if input.receive().map_err(|error| self.explain(error))? {
                continue;
            }
            if input.has_ended() {
                return Ok(None);
            }
            self.drain_or_pause(&mut idle)?;
        }
    }

    /// Drains every input; sleeps a little when there was nothing.
    fn drain_or_pause(&self, idle: &mut u64) -> Result<(), LinkError> {
        self.check()?;
        if self.drain().map_err(|error| self.explain(error))? {
            *idle = 0;
        } else {
            std::thread::sleep(pause(*idle));
            *idle += 1;
        }
        Ok(())
    }

    fn drain(&self) -> Result<bool, LinkError> {
        let mut any = false;
        for input in self.inputs.borrow().iter() {
            any |= input.drain()?;
        }
        self.read_notices();
        Ok(any)
    }

    fn read_notices(&self) {
        for input in self.notices.borrow().iter() {
            while let Some(notices) = input.take() {
                notices
                    .iter()
                    .for_each(|notice| self.obey(input.writer(), *notice));
            }
        }
    }

    fn obey(&self, writer: Role, notice: Notice) {
        if notice.kind == Notice::READY {
            self.ready[writer.index()].set(true);
        } else {
            let role = Role::from_index(notice.about).unwrap_or(writer);
            // A peer that gives up because of us tells us nothing new about us.
            let role = if role == self.role() { writer } else { role };
            self.verdict.fail(LinkError::PeerDied {
                role,
                how: Death::from_code(notice.death),
            });
        }
    }

    /// The reason behind an error of the transport: usually a peer that is gone, whom the watch
    /// will name in a moment. Any other error stands for itself. Ends the session.
    pub(crate) fn explain(&self, error: LinkError) -> LinkError {
        let patience = match error {
            LinkError::Transport { .. } => BLAME_TIME,
            _ => Duration::ZERO,
        };
        let start = Instant::now();
        while !self.verdict.failed() && start.elapsed() < patience {
            std::thread::sleep(Duration::from_millis(5));
            for notices in self.notices.borrow().iter() {
                // Only what is still readable counts here.
                let _ = notices.drain();
            }
            self.read_notices();
        }
        self.verdict.fail(error.clone());
        self.verdict.check().err().unwrap_or(error)
    }
}

/// A participant's place in a session. Leave it with [`close`](Session::close); dropping it
/// before tells the others to give up.
pub struct Session {
    outputs: Vec<(Rc<dyn AnyOutput>, Cell<bool>)>,
    untaken: RefCell<Vec<Rc<dyn AnyInput>>>,
    notices: Option<Rc<Output<Notice>>>,
    closed: bool,
    watch: Option<Watch>,
    shared: Rc<Shared>,
}

impl Session {
    /// Joins a session and waits until everyone expected is there and sees everyone's streams.
    ///
    /// # Errors
    /// [`LinkError::JoinTimeout`] names who did not come, [`LinkError::RoleTaken`] another
    /// participant of this role, [`LinkError::PeerDied`] one that went meanwhile.
    pub fn join(options: Options) -> Result<Self, LinkError> {
        crate::quieten();
        cleanup::remove_unfinished_management();
        let verdict = Arc::<Verdict>::default();
        if options.supervised {
            watch_supervisor(Arc::clone(&verdict));
        } else if options.transport == Transport::Processes {
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
            Arc::clone(&verdict),
        );
        let deadline = Instant::now() + options.join_timeout;
        let by_hand = !options.supervised && options.transport == Transport::Processes;
        let (session, blame) = (options.session.clone(), Arc::clone(&verdict));
        let last = CleanUp {
            session,
            verdict: blame,
            by_hand,
        };
        let shared = Rc::new(Shared {
            options,
            verdict,
            inputs: RefCell::default(),
            notices: RefCell::default(),
            ready: Default::default(),
            domain,
            _last: last,
        });
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
        let peers = self.shared.options.peers();
        self.wait_until(deadline, || {
            self.shared.drain()?;
            Ok(peers
                .iter()
                .all(|peer| self.shared.ready[peer.index()].get()))
        })
    }

    fn wait_until(
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

impl Shared {
    fn add_input<S: Stream>(
        &self,
        writer: Role,
        port: Box<dyn InPort<S::Record>>,
        verdict: Arc<Verdict>,
    ) {
        // The end of its notices is a participant's last word.
        let on_end = (S::NAME == Notices::NAME)
            .then(|| -> Box<dyn Fn()> { Box::new(move || verdict.finish(writer)) });
        let stamp = self.options.stamp();
        let input = Rc::new(Input::new(S::NAME, writer, port, stamp, on_end));
        let any: Rc<dyn Any> = Rc::clone(&input).as_any();
        if let Ok(notices) = any.downcast::<Input<Notice>>() {
            self.notices.borrow_mut().push(notices);
        }
        self.inputs.borrow_mut().push(input);
    }

    fn timeout(&self) -> LinkError {
        let peers = self.options.peers();
        let unseen = peers
            .iter()
            .copied()
            .filter(|&peer| !self.verdict.has_seen(peer));
        let mut missing: Vec<_> = unseen.collect();
        if missing.is_empty() {
            missing.extend(peers.iter().filter(|peer| !self.ready[peer.index()].get()));
        }
        LinkError::JoinTimeout {
            session: self.options.session.to_string(),
            missing,
            waited: self.options.join_timeout,
        }
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

/// Opens a role's outputs, stream by stream.
struct OpenOutputs<'a>(&'a mut Session);

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
struct OpenInputs<'a> {
    session: &'a Session,
    deadline: Instant,
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
