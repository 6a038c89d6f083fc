//! Shared by the tests of this crate: a watchdog, and a search for what a session left behind.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use cardan_link::SessionId;

/// Ends the process when a test hangs.
pub(crate) struct Watchdog(#[allow(dead_code, reason = "only its end matters")] Sender<()>);

impl Watchdog {
    /// Gives the test this many seconds.
    pub(crate) fn new(seconds: u64) -> Self {
        let (alive, end) = channel::<()>();
        let name = std::thread::current().name().unwrap_or("test").to_owned();
        std::thread::spawn(move || {
            use std::sync::mpsc::RecvTimeoutError::Timeout;
            if end.recv_timeout(Duration::from_secs(seconds)) == Err(Timeout) {
                eprintln!("{name} hangs");
                std::process::abort();
            }
        });
        Self(alive)
    }
}

/// One test with many processes at a time: this machine may be small.
#[allow(dead_code, reason = "not every test file needs it")]
pub(crate) fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Fails if anything in shared memory or in iceoryx2's folder was made by one of `pids`, or
/// describes a service or node of `session`. Independent of the code under test.
#[allow(dead_code, reason = "not every test file needs it")]
pub(crate) fn assert_no_traces(session: &SessionId, pids: &BTreeSet<u32>, when: &str) {
    assert_eq!(traces(session, pids), [] as [PathBuf; 0], "{when}");
}

/// What [`assert_no_traces`] looks for.
#[allow(dead_code, reason = "not every test file needs it")]
pub(crate) fn traces(session: &SessionId, pids: &BTreeSet<u32>) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in ["/dev/shm", "/tmp/iceoryx2"] {
        walk(Path::new(folder), &mut |path| {
            if is_trace(path, session, pids) {
                found.push(path.to_owned());
            }
        });
    }
    found
}

fn walk(folder: &Path, visit: &mut impl FnMut(&Path)) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for path in entries.flatten().map(|entry| entry.path()) {
        visit(&path);
        if path.is_dir() {
            walk(&path, visit);
        }
    }
}

fn is_trace(path: &Path, session: &SessionId, pids: &BTreeSet<u32>) -> bool {
    let name = path
        .file_name()
        .and_then(|name| name.to_str())
        .unwrap_or_default();
    // iceoryx2's ids hold the process id in their third 32 bits.
    let ids = name
        .split(['_', '.'])
        .filter_map(|part| part.parse::<u128>().ok());
    let made_by_us = ids
        .into_iter()
        .any(|id| pids.contains(&((id >> 64) as u32)));
    let text = fs::read_to_string(path).unwrap_or_default();
    let describes_us = text.contains(&format!("cardan/{session}/"));
    made_by_us || describes_us || is_torn_service(path)
}

/// A description that its writer never completed does not tell its session. One of another
/// session may be in the making, but not for long.
fn is_torn_service(path: &Path) -> bool {
    let is_empty = |path: &Path| fs::metadata(path).is_ok_and(|meta| meta.len() == 0);
    let is_service = path
        .extension()
        .is_some_and(|extension| extension == "service");
    is_service && is_empty(path) && {
        std::thread::sleep(Duration::from_millis(300));
        is_empty(path)
    }
}
