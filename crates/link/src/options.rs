//! How a participant takes part in a session.

use std::time::Duration;

use crate::port::Stamp;
use crate::role::Role;
use crate::session_id::SessionId;
use crate::stream::{Blobs, Notices, Stream};
use crate::supervisor::SUPERVISED;
use crate::transport::{Capacity, Transport};

/// Slices per reader that a participant's notices may occupy: it sends two.
const NOTICE_SLICES: usize = 4;

/// Bytes of a blob per slice.
const BLOB_BATCH: usize = 16 * 1024;

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
    /// How long a peer that is stopped by a signal may stay so.
    pub stall_timeout: Duration,
    /// Records per slice.
    pub batch_records: usize,
    /// Slices that wait per reader before the writer must wait.
    pub buffered_batches: usize,
    /// A [`Supervisor`](crate::Supervisor) started this process and cleans up; its children know
    /// from their environment.
    pub supervised: bool,
}

/// How long a participant may be stopped, unless said otherwise.
pub const STALL_TIMEOUT: Duration = Duration::from_secs(30);

impl Options {
    /// All four roles, 10 s to join, 30 s to be stopped, batches of 256 records, 16 of which are buffered per reader.
    #[must_use]
    pub fn new(role: Role, session: SessionId) -> Self {
        Self {
            role,
            session,
            expected: Role::ALL.to_vec(),
            transport: Transport::Processes,
            format_hash: 0,
            join_timeout: Duration::from_secs(10),
            stall_timeout: STALL_TIMEOUT,
            batch_records: 256,
            buffered_batches: 16,
            supervised: std::env::var_os(SUPERVISED).is_some(),
        }
    }

    pub(crate) fn stamp(&self) -> Stamp {
        Stamp {
            session: self.session.hash(),
            format: self.format_hash,
        }
    }

    pub(crate) fn peers(&self) -> Vec<Role> {
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

    pub(crate) fn capacity<S: Stream>(&self) -> Capacity {
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
