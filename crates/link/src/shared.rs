//! The state that a session shares with its writers and readers: inputs, and who is to blame.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::cleanup;
use crate::error::{Death, LinkError};
use crate::options::Options;
use crate::port::{AnyInput, Input};
use crate::record::{Notice, Record};
use crate::role::Role;
use crate::session_id::SessionId;
use crate::stream::{Notices, Stream};
use crate::transport::{Domain, InPort, Transport, pause};
use crate::watch::Verdict;

/// How long a failed transfer waits for the watch to name the peer that caused it.
const BLAME_TIME: Duration = Duration::from_millis(1000);

/// By then every peer has noticed a death.
const NOTICE_TIME: Duration = Duration::from_millis(400);

/// The state that a session shares with its writers and readers.
pub(crate) struct Shared {
    pub(crate) options: Options,
    pub(crate) verdict: Arc<Verdict>,
    pub(crate) inputs: RefCell<Vec<Rc<dyn AnyInput>>>,
    notices: RefCell<Vec<Rc<Input<Notice>>>>,
    ready: [Cell<bool>; Role::ALL.len()],
    /// After the ports, which it outlives.
    pub(crate) domain: Domain,
    /// Last of all: by then this participant has left.
    _last: CleanUp,
}

/// Cleans up behind killed peers where no supervisor does.
struct CleanUp {
    session: SessionId,
    verdict: Arc<Verdict>,
    by_hand: bool,
}

impl Drop for CleanUp {
    fn drop(&mut self) {
        if !self.by_hand {
            return;
        }
        if let Err(LinkError::PeerDied {
            how: Death::Killed, ..
        }) = self.verdict.check()
        {
            // The others must have noticed before the traces are gone.
            std::thread::sleep(NOTICE_TIME);
        }
        cleanup::cleanup(&self.session);
    }
}

impl Shared {
    pub(crate) fn new(options: Options, verdict: Arc<Verdict>, domain: Domain) -> Self {
        let by_hand = !options.supervised && options.transport == Transport::Processes;
        let last = CleanUp {
            session: options.session.clone(),
            verdict: Arc::clone(&verdict),
            by_hand,
        };
        Self {
            options,
            verdict,
            inputs: RefCell::default(),
            notices: RefCell::default(),
            ready: Default::default(),
            domain,
            _last: last,
        }
    }

    pub(crate) fn role(&self) -> Role {
        self.options.role
    }

    /// True when every peer has told that it sees all streams.
    pub(crate) fn all_ready(&self) -> bool {
        let peers = self.options.peers();
        peers.iter().all(|peer| self.ready[peer.index()].get())
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
    pub(crate) fn drain_or_pause(&self, idle: &mut u64) -> Result<(), LinkError> {
        self.check()?;
        if self.drain().map_err(|error| self.explain(error))? {
            *idle = 0;
        } else {
            std::thread::sleep(pause(*idle));
            *idle += 1;
        }
        Ok(())
    }

    pub(crate) fn drain(&self) -> Result<bool, LinkError> {
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

impl Shared {
    pub(crate) fn add_input<S: Stream>(
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

    pub(crate) fn timeout(&self) -> LinkError {
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
