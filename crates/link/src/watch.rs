//! A thread that notices deaths: of peers through iceoryx2's node monitoring (a file lock that the
//! kernel drops with the process, so a peer that merely computes for minutes is never mistaken for
//! dead), and of the supervisor through the end of standard input.

use std::collections::BTreeSet;
use std::io::{ErrorKind, Read};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, Once, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::cleanup::{Owner, remove_unfinished};
use crate::error::{Death, LinkError};
use crate::resources::is_stopped;
use crate::role::Role;
use crate::session_id::SessionId;
use crate::supervisor::SUPERVISED;
use crate::transport::{Peer, Transport, peers};

/// Time between two looks at the peers.
const PERIOD: Duration = Duration::from_millis(100);

/// Looks in a row that must miss a peer before it has left: long enough for its own word, which
/// names the culprit, to arrive first.
const MISSES: u32 = 3;

/// Time that a participant gets to end by itself after its supervisor is gone.
const GRACE: Duration = Duration::from_millis(1200);

/// Exit code of a participant whose supervisor is gone.
const EXIT_DIED: i32 = 3;

/// What the watching thread and the participant share.
#[derive(Debug, Default)]
pub(crate) struct Verdict {
    failed: AtomicBool,
    error: Mutex<Option<LinkError>>,
    finished: [AtomicBool; Role::ALL.len()],
    seen: [AtomicBool; Role::ALL.len()],
}

impl Verdict {
    /// True once the session cannot succeed any more. Cheap.
    pub(crate) fn failed(&self) -> bool {
        self.failed.load(Ordering::Acquire)
    }

    /// The first failure.
    pub(crate) fn check(&self) -> Result<(), LinkError> {
        if !self.failed() {
            return Ok(());
        }
        let error = self.error.lock().unwrap_or_else(PoisonError::into_inner);
        error.clone().map_or(Ok(()), Err)
    }

    /// Records a failure; the first one stays.
    pub(crate) fn fail(&self, error: LinkError) {
        let mut first = self.error.lock().unwrap_or_else(PoisonError::into_inner);
        first.get_or_insert(error);
        self.failed.store(true, Ordering::Release);
    }

    /// The peer has said its last word, it may leave from now on.
    pub(crate) fn finish(&self, peer: Role) {
        self.finished[peer.index()].store(true, Ordering::Release);
    }

    /// True when a node of that role has been alive since the watch began.
    pub(crate) fn has_seen(&self, peer: Role) -> bool {
        self.seen[peer.index()].load(Ordering::Acquire)
    }

    fn may_leave(&self, peer: Role) -> bool {
        self.finished[peer.index()].load(Ordering::Acquire)
    }
}

/// The running thread; ends when dropped.
#[derive(Debug)]
pub(crate) struct Watch {
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Watch {
    /// Watches `expected`; nodes in `stale` are left over from an earlier session of this name.
    pub(crate) fn start(
        transport: Transport,
        session: SessionId,
        expected: Vec<Role>,
        stale: Vec<Peer>,
        stall_timeout: Option<Duration>,
        verdict: Arc<Verdict>,
    ) -> Self {
        let (stop, stopped) = channel();
        let mut rounds = Rounds {
            expected,
            stale,
            verdict,
            misses: [0; Role::ALL.len()],
            stall_timeout,
            stopped: [None; Role::ALL.len()],
        };
        let thread = std::thread::spawn(move || {
            loop {
                // A list that cannot be read now is read again in the next round.
                if let Ok(peers) = peers(transport, &session) {
                    rounds.judge(&peers);
                }
                if ORPHANED.load(Ordering::Acquire) {
                    rounds.verdict.fail(LinkError::SupervisorDied);
                }
                if stopped.recv_timeout(PERIOD) != Err(RecvTimeoutError::Timeout) {
                    return;
                }
            }
        });
        Self {
            stop: Some(stop),
            thread: Some(thread),
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic in there has been printed; there is nothing to add while dropping.
            let _ = thread.join();
        }
    }
}

/// The watch's memory between two looks.
struct Rounds {
    expected: Vec<Role>,
    stale: Vec<Peer>,
    verdict: Arc<Verdict>,
    misses: [u32; Role::ALL.len()],
    /// How long a peer may be stopped; none if somebody else looks after that.
    stall_timeout: Option<Duration>,
    /// Since when each is seen to be stopped.
    stopped: [Option<Instant>; Role::ALL.len()],
}

impl Rounds {
    /// Names a peer that is stopped for too long.
    fn judge_stopped(&mut self, now: &[Peer]) {
        let Some(timeout) = self.stall_timeout else {
            return;
        };
        for peer in now.iter().filter(|peer| peer.alive) {
            let pid = u32::try_from(Owner::of(peer.node).pid);
            let since = &mut self.stopped[peer.role.index()];
            if !pid.is_ok_and(is_stopped) {
                *since = None;
            } else if since.get_or_insert_with(Instant::now).elapsed() >= timeout {
                self.verdict.fail(LinkError::PeerDied {
                    role: peer.role,
                    how: Death::Stopped,
                });
            }
        }
    }

    fn judge(&mut self, now: &[Peer]) {
        let stale = |peer: &Peer| self.stale.iter().any(|old| old.node == peer.node);
        let now: Vec<_> = now.iter().filter(|peer| !stale(peer)).copied().collect();
        self.judge_stopped(&now);
        // Those that were killed first: others may have left because of them.
        let dead = |peer: &&Peer| !peer.alive && self.expected.contains(&peer.role);
        if let Some(peer) = now.iter().find(dead) {
            self.verdict.fail(LinkError::PeerDied {
                role: peer.role,
                how: Death::Killed,
            });
            // This participant may be waiting for something that will never be finished.
            remove_unfinished(&BTreeSet::from([Owner::of(peer.node)]));
        }
        for &role in &self.expected {
            let misses = &mut self.misses[role.index()];
            if now.iter().any(|peer| peer.role == role) {
                self.verdict.seen[role.index()].store(true, Ordering::Release);
                *misses = 0;
            } else if self.verdict.has_seen(role) && !self.verdict.may_leave(role) {
                *misses += 1;
                if *misses >= MISSES {
                    self.verdict.fail(LinkError::PeerDied {
                        role,
                        how: Death::Left,
                    });
                }
            }
        }
    }
}

/// Ties this process to its supervisor, if it has one: when the supervisor dies, sessions fail, and
/// a process that has not ended soon after is ended. A participant calls it first thing, before any
/// long preparation; [`Session::join`](crate::Session::join) calls it in any case.
pub fn end_with_supervisor() {
    static ONCE: Once = Once::new();
    if std::env::var_os(SUPERVISED).is_some() {
        ONCE.call_once(|| drop(std::thread::spawn(wait_for_supervisors_end)));
    }
}

/// Set when the supervisor is gone.
static ORPHANED: AtomicBool = AtomicBool::new(false);

fn wait_for_supervisors_end() {
    let mut byte = [0];
    // The supervisor never writes: anything but waiting means that it is gone.
    loop {
        match std::io::stdin().read(&mut byte) {
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Ok(1) => {}
            Ok(_) | Err(_) => break,
        }
    }
    ORPHANED.store(true, Ordering::Release);
    std::thread::sleep(GRACE);
    std::process::exit(EXIT_DIED);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rounds(expected: &[Role]) -> Rounds {
        Rounds {
            expected: expected.to_vec(),
            stale: Vec::new(),
            verdict: Arc::default(),
            misses: [0; 4],
            stall_timeout: None,
            stopped: [None; 4],
        }
    }

    fn peer(role: Role, node: u128, alive: bool) -> Peer {
        Peer { role, node, alive }
    }

    #[test]
    fn a_peer_that_has_not_come_yet_has_not_left() {
        let mut rounds = rounds(&[Role::Golden]);
        for _ in 0..10 {
            rounds.judge(&[]);
        }
        assert_eq!(rounds.verdict.check(), Ok(()));
    }

    #[test]
    fn a_dead_node_is_named_at_once_and_before_those_that_left_because_of_it() {
        let mut rounds = rounds(&[Role::Emulated, Role::Golden]);
        rounds.judge(&[peer(Role::Emulated, 1, true), peer(Role::Golden, 2, true)]);
        rounds.judge(&[peer(Role::Golden, 2, false)]);
        let died = LinkError::PeerDied {
            role: Role::Golden,
            how: Death::Killed,
        };
        assert_eq!(rounds.verdict.check(), Err(died));
    }

    #[test]
    fn a_peer_that_vanishes_has_left_unless_it_had_finished() {
        for finished in [false, true] {
            let mut rounds = rounds(&[Role::Native]);
            rounds.judge(&[peer(Role::Native, 1, true)]);
            if finished {
                rounds.verdict.finish(Role::Native);
            }
            for _ in 0..MISSES {
                assert_eq!(rounds.verdict.check(), Ok(()));
                rounds.judge(&[]);
            }
            assert_eq!(rounds.verdict.failed(), !finished);
        }
    }

    #[test]
    fn a_dead_node_of_an_earlier_session_is_no_peer() {
        let mut rounds = rounds(&[Role::Native]);
        rounds.stale.push(peer(Role::Native, 9, false));
        rounds.judge(&[peer(Role::Native, 9, false)]);
        assert_eq!(rounds.verdict.check(), Ok(()));
        assert!(!rounds.verdict.has_seen(Role::Native));
    }
}
