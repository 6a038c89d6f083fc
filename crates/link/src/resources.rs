//! What a session needs of the system, looked at before it begins: without, processes would end by a
//! signal in the middle of a write, or with words that nobody understands.

use std::fs;

use crate::error::LinkError;

/// Where Linux keeps POSIX shared memory.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";
/// Bytes that must be free there: a session was seen to take 1 MB at its peak.
const LEAST_BYTES: u64 = 8 << 20;
/// Files that a process must be allowed to have open: a participant was seen to have 106.
const LEAST_FILES: u64 = 128;

/// Fails with the name of what is missing, and with what to do about it. What cannot be looked at is
/// taken to be there.
pub(crate) fn check() -> Result<(), LinkError> {
    if let Some(files) = most_files()
        && files < LEAST_FILES
    {
        return Err(LinkError::TooFewFiles {
            allowed: files,
            needed: LEAST_FILES,
        });
    }
    if let Ok(space) = rustix::fs::statvfs(SHARED_MEMORY) {
        let free = space.f_bavail.saturating_mul(space.f_frsize);
        let has_entries = space.f_files == 0 || space.f_favail > 0;
        if free < LEAST_BYTES || !has_entries {
            return Err(LinkError::NoSharedMemory {
                folder: SHARED_MEMORY,
                free_kb: free >> 10,
                needed_kb: LEAST_BYTES >> 10,
            });
        }
    }
    Ok(())
}

/// The process's limit on open files, where the system tells it.
fn most_files() -> Option<u64> {
    let limits = fs::read_to_string("/proc/self/limits").ok()?;
    soft_limit(&limits)
}

/// The first number of that line; none if unlimited.
fn soft_limit(limits: &str) -> Option<u64> {
    let line = limits
        .lines()
        .find_map(|line| line.strip_prefix("Max open files"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// Whether a process is stopped, by a signal and not by a debugger, where the system tells it.
pub(crate) fn is_stopped(pid: u32) -> bool {
    // `PID (NAME) STATE ...`; a name may hold anything but ends at the last parenthesis.
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let state = stat.rsplit_once(')').map(|(_, rest)| rest.trim_start());
    state.is_some_and(|state| state.starts_with('T'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};

    #[test]
    fn the_limit_is_the_soft_one() {
        let text = "Limit                     Soft Limit           Hard Limit           Units     \n\
                    Max open files            20                   1048576              files     \n";
        assert_eq!(soft_limit(text), Some(20));
        assert_eq!(soft_limit(&text.replace("20 ", "unlimited ")), None);
    }

    #[test]
    fn a_stopped_process_is_told_from_a_running_one() {
        let mut child = Command::new("sleep")
            .arg("60")
            .stdout(Stdio::null())
            .spawn()
            .expect("starts");
        let signal = |name: &str| {
            let pid = child.id().to_string();
            let sent = Command::new("kill").args([name, &pid]).status();
            assert!(sent.expect("kill runs").success());
        };
        let becomes = |stopped: bool| {
            (0..500).any(|_| {
                std::thread::sleep(std::time::Duration::from_millis(2));
                is_stopped(child.id()) == stopped
            })
        };
        assert!(becomes(false));
        signal("-STOP");
        assert!(becomes(true));
        signal("-CONT");
        assert!(becomes(false));
        child.kill().expect("ours");
        child.wait().expect("ours");
    }
}
