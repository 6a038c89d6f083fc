//! What can go wrong on the link, each with the participant's name and the way out.

use std::time::Duration;

use crate::role::{Role, list};

/// How a peer went before the session was complete.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Death {
    /// Its process is gone and left its resources behind.
    #[error("was killed or crashed")]
    Killed,
    /// It ended before its streams did, without a word.
    #[error("ended too early")]
    Left,
    /// It said that it gives up.
    #[error("gave up; its own message says why")]
    Aborted,
    /// It is stopped by a signal and did not go on.
    #[error(
        "is stopped (SIGSTOP or Ctrl-Z) and did not go on; mend: kill -CONT it in time, or raise \
         --stall-timeout"
    )]
    Stopped,
}

impl Death {
    pub(crate) const fn code(self) -> u8 {
        match self {
            Self::Killed => 0,
            Self::Left => 1,
            Self::Aborted => 2,
            Self::Stopped => 3,
        }
    }

    pub(crate) const fn from_code(code: u8) -> Self {
        match code {
            0 => Self::Killed,
            1 => Self::Left,
            3 => Self::Stopped,
            _ => Self::Aborted,
        }
    }
}

/// A failure of the link. All of them end the session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LinkError {
    /// The session id cannot be used.
    #[error(
        "session id '{id}': expected 1 to {max} letters, digits, '-' or '_'; \
         mend: --session with such a name, or leave it out",
        max = crate::SessionId::MAX
    )]
    BadSessionId {
        /// What was given.
        id: String,
    },
    /// Not everyone came.
    #[error(
        "session '{session}': {who} did not join within {waited:?}; \
         mend: start {who} with --session {session}, or raise --join-timeout",
        who = list(missing)
    )]
    JoinTimeout {
        /// The session.
        session: String,
        /// Who was expected and did not come.
        missing: Vec<Role>,
        /// How long this participant waited.
        waited: Duration,
    },
    /// Two participants claim the same part.
    #[error(
        "session '{session}' already has a participant '{role}'; \
         mend: end that one, or choose another --session"
    )]
    RoleTaken {
        /// The part.
        role: Role,
        /// The session.
        session: String,
    },
    /// A peer went before the session was complete.
    #[error("participant '{role}' {how}")]
    PeerDied {
        /// Who.
        role: Role,
        /// How it went.
        how: Death,
    },
    /// The supervising process is gone.
    #[error("the supervising process ended")]
    SupervisorDied,
    /// A peer was built for other number formats.
    #[error(
        "'{role}' uses format table {found:016x}, this participant {expected:016x}; \
         mend: rebuild both from the same wordlengths"
    )]
    FormatMismatch {
        /// The peer.
        role: Role,
        /// This participant's table hash.
        expected: u64,
        /// The peer's table hash.
        found: u64,
    },
    /// A slice of another session turned up.
    #[error("'{role}' sent {stream} of another session")]
    ForeignSession {
        /// The peer.
        role: Role,
        /// The stream.
        stream: &'static str,
    },
    /// A slice is missing or came twice.
    #[error("{stream} of '{role}': expected slice {expected}, found {found}")]
    SequenceGap {
        /// The writer.
        role: Role,
        /// The stream.
        stream: &'static str,
        /// Number of the next slice.
        expected: u64,
        /// Number it had.
        found: u64,
    },
    /// The record count in a header disagrees with what was received.
    #[error("{stream} of '{role}': {announced} records announced, {received} received")]
    CountMismatch {
        /// The writer.
        role: Role,
        /// The stream.
        stream: &'static str,
        /// Count in the header.
        announced: u64,
        /// Count that arrived.
        received: u64,
    },
    /// A programming error: this participant asked for a stream that is not its own.
    #[error("{stream} does not flow from '{from}' to '{to}', or is already taken")]
    NotRouted {
        /// The stream.
        stream: &'static str,
        /// The writer.
        from: Role,
        /// The reader.
        to: Role,
    },
    /// A programming error: the session was closed with an open stream.
    #[error("'{role}' closed the session without finishing {stream}")]
    Unfinished {
        /// This participant.
        role: Role,
        /// The stream.
        stream: &'static str,
    },
    /// A blob was cut off or is not framed as it should be.
    #[error("blobs of '{role}' end in the middle of one, or hold a malformed one")]
    BrokenBlob {
        /// The writer.
        role: Role,
    },
    /// Shared memory is full.
    #[error(
        "shared memory: {folder} has {free_kb} kB free, a session needs {needed_kb} kB; mend: remove what \
         fills it, or enlarge it: mount -o remount,size=64M {folder}"
    )]
    NoSharedMemory {
        /// Where it is.
        folder: &'static str,
        /// Free kilobytes.
        free_kb: u64,
        /// Kilobytes that are needed.
        needed_kb: u64,
    },
    /// The process may not open as many files as a session has.
    #[error(
        "file handles: this process may have {allowed} files open, a session needs {needed}; mend: \
         ulimit -n {needed}"
    )]
    TooFewFiles {
        /// How many are allowed.
        allowed: u64,
        /// How many are needed.
        needed: u64,
    },
    /// iceoryx2 refused.
    #[error(
        "{doing}: {cause}; mend: see that /dev/shm and the temporary folder are writable and not full (`cardan doctor`)"
    )]
    Transport {
        /// What was being done.
        doing: String,
        /// iceoryx2's word for the cause.
        cause: String,
    },
}

impl LinkError {
    /// Exit code of the command line's contract: 2 for wrong usage, 3 for everything else.
    #[must_use]
    pub const fn exit_code(&self) -> i32 {
        match self {
            Self::BadSessionId { .. } | Self::FormatMismatch { .. } => 2,
            _ => 3,
        }
    }

    pub(crate) fn transport(doing: impl Into<String>, cause: impl std::fmt::Debug) -> Self {
        Self::Transport {
            doing: doing.into(),
            cause: format!("{cause:?}"),
        }
    }
}
