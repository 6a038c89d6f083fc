//! What crosses process borders: nodes, codes and frames over iceoryx2 shared memory.
//!
//! Participants ([`Role`]) join a [`Session`] by its id, publish typed streams ([`stream`]) and
//! read those of the others. Nothing is ever dropped: buffers do not overflow, a writer waits for
//! its slowest reader; nothing is sent before everyone is there; every slice has a number and every
//! stream an explicit end with its count. A participant that dies is noticed by all others and
//! named. A [`Supervisor`] starts participants as child processes and removes what a killed one
//! leaves behind.
//!
//! ```
//! use cardan_link::stream::Events;
//! use cardan_link::{Event, LinkError, Options, Role, Session, SessionId, Transport};
//!
//! fn options(role: Role, session: &SessionId) -> Options {
//!     let expected = vec![Role::Emulated, Role::Native];
//!     Options { expected, transport: Transport::InProcess, ..Options::new(role, session.clone()) }
//! }
//!
//! fn emulate(session: SessionId) -> Result<(), LinkError> {
//!     let session = Session::join(options(Role::Emulated, &session))?;
//!     let mut events = session.writer(Events)?;
//!     for sequence in 0..1000 {
//!         let cycle = 1000 * sequence;
//!         let (channel, value, ideal, expected) = (0, 512, 2.5, -0.5);
//!         let kind = Event::CONVERSION;
//!         events.push(Event { sequence, cycle, ideal, expected, value, kind, channel, flags: 0 })?;
//!     }
//!     events.finish()?;
//!     session.close().map(drop)
//! }
//!
//! # fn main() -> Result<(), LinkError> {
//! let id = SessionId::fresh();
//! let session = id.clone();
//! let emulated = std::thread::spawn(move || emulate(session));
//! let native = Session::join(options(Role::Native, &id))?;
//! let codes = native.reader(Role::Emulated, Events)?.collect()?;
//! assert_eq!(codes.len(), 1000);
//! native.close()?;
//! emulated.join().expect("does not panic")
//! # }
//! ```

mod blob;
mod cleanup;
mod error;
mod handle;
mod opening;
mod options;
mod place;
mod port;
mod record;
mod resources;
mod role;
mod session;
mod session_id;
mod shared;
pub mod stream;
mod supervisor;
mod transport;
mod watch;

pub use blob::{Blob, BlobReader, BlobWriter};
pub use cleanup::cleanup;
pub use error::{Death, LinkError};
pub use handle::{Reader, Writer};
pub use options::{Options, STALL_TIMEOUT};
pub use port::Traffic;
pub use record::{
    Event, Frame, Instant, NodeReal, NodeWord, Notice, Record, SignalValue, StageValue, Status,
};
pub use role::Role;
pub use session::{Counters, Session};
pub use session_id::SessionId;
pub use supervisor::{Ending, Finished, Participant, Supervisor, SupervisorError, supervise};
pub use transport::Transport;
pub use watch::end_with_supervisor;

/// Keeps iceoryx2 silent, also about the deaths that this crate reports itself. Its own variable
/// `IOX2_LOG_LEVEL` (`error`, `warn`, `debug`, ...) makes it speak, on standard error.
fn quieten() {
    use iceoryx2::prelude::{LogLevel, set_log_level_from_env_or};
    set_log_level_from_env_or(LogLevel::Fatal);
}
