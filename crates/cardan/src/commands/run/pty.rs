//! A pseudo terminal as the far end of the serial line: any serial program opens it by its name.
//!
//! As on a real line, the chip does not wait: the run keeps real time, and what nobody reads is
//! lost, after a buffer, and counted.

use std::collections::VecDeque;
use std::io;
use std::os::fd::OwnedFd;
use std::thread;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, ioctl_tiocgptpeer, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// Bytes kept for a reader that is late.
const BUFFER: usize = 64 * 1024;
/// How long the end of the run waits for a reader to fetch the last bytes: one that has read
/// before, and one that may yet come.
const FAREWELL: Duration = Duration::from_secs(10);
const WELCOME: Duration = Duration::from_secs(1);
/// Between two looks while waiting.
const PAUSE: Duration = Duration::from_millis(5);

/// Our end, and the other end's device.
pub(super) struct Terminal {
    ours: OwnedFd,
    /// Kept open so that readers may come and go without hanging up the line.
    theirs: OwnedFd,
    name: String,
    pending: VecDeque<u8>,
    /// Somebody has read everything at least once.
    has_reader: bool,
    has_sent: bool,
    lost: u64,
    hz: u64,
    /// Host time at which cycle 0 lies.
    begin: Instant,
}

impl Terminal {
    /// Opens a new pseudo terminal in raw mode for a chip clocked at `hz`.
    pub(super) fn open(hz: u64) -> io::Result<Self> {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let ours = openpt(flags)?;
        grantpt(&ours)?;
        unlockpt(&ours)?;
        let name = ptsname(&ours, Vec::new())?.to_string_lossy().into_owned();
        let theirs = ioctl_tiocgptpeer(&ours, flags)?;
        let mut attributes = tcgetattr(&theirs)?;
        attributes.make_raw();
        tcsetattr(&theirs, OptionalActions::Now, &attributes)?;
        rustix::io::ioctl_fionbio(&ours, true)?;
        Ok(Self {
            ours,
            theirs,
            name,
            pending: VecDeque::new(),
            has_reader: false,
            has_sent: false,
            lost: 0,
            hz,
            begin: Instant::now(),
        })
    }

    /// Path of the device that a serial program opens.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Sends `bytes` after those that still wait.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        self.has_reader |= self.has_sent && self.is_drained();
        self.has_sent |= !bytes.is_empty();
        self.pending.extend(bytes);
        self.push();
        let surplus = self.pending.len().saturating_sub(BUFFER);
        self.pending.drain(..surplus);
        self.lost += surplus as u64;
    }

    /// Writes what the terminal takes at once.
    fn push(&mut self) {
        while !self.pending.is_empty() {
            match rustix::io::write(&self.ours, self.pending.as_slices().0) {
                Ok(count @ 1..) => drop(self.pending.drain(..count)),
                Err(Errno::INTR) => {}
                _ => return,
            }
        }
    }

    /// What has been typed since the last call.
    pub(super) fn take(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut buffer = [0; 4096];
        while let Ok(count @ 1..) = rustix::io::read(&self.ours, &mut buffer) {
            bytes.extend_from_slice(&buffer[..count]);
        }
        bytes
    }

    /// Waits until host time has come to `cycle`. An emulator that is late does not hurry.
    pub(super) fn keep_pace(&mut self, cycle: u64) {
        let due = Duration::from_secs_f64(cycle as f64 / self.hz as f64);
        let elapsed = self.begin.elapsed();
        if let Some(rest) = due.checked_sub(elapsed) {
            thread::sleep(rest);
        }
    }

    /// Gives a reader time to fetch the last bytes, and says what was lost.
    pub(super) fn close(mut self) {
        let patience = if self.has_reader { FAREWELL } else { WELCOME };
        let end = Instant::now() + patience;
        while !self.is_drained() && Instant::now() < end {
            thread::sleep(PAUSE);
            self.push();
        }
        let unread = self.lost + self.pending.len() as u64 + self.unfetched();
        if unread > 0 {
            eprintln!(
                "serial line: {unread} bytes were not read from {}",
                self.name
            );
        }
    }

    /// Whether the reader has everything. The count of bytes alone does not know those that the
    /// system is still carrying to the device; to poll it makes them arrive.
    fn is_drained(&self) -> bool {
        let mut device = [PollFd::new(&self.theirs, PollFlags::IN)];
        let at_once = Timespec {
            tv_sec: 0,
            tv_nsec: 0,
        };
        let is_readable = poll(&mut device, Some(&at_once)).is_ok_and(|ready| ready > 0);
        self.pending.is_empty() && !is_readable && self.unfetched() == 0
    }

    /// Bytes that lie in the device, where its reader has not fetched them.
    fn unfetched(&self) -> u64 {
        rustix::io::ioctl_fionread(&self.theirs).unwrap_or(0)
    }
}
