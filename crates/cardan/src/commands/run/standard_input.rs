//! Standard input as the far end of the serial line.

use std::io::{self, IsTerminal, Read};
use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::{Duration, Instant};

/// A file or a finished pipe is read to its end before its first byte is sent on, so that the same
/// input gives the same run; a pipe that is held open is waited for only this long.
const PATIENCE: Duration = Duration::from_millis(500);

/// Reads in the background: nobody knows when a byte will come.
pub(super) struct StandardInput {
    chunks: Receiver<Vec<u8>>,
    /// Wait for the end of the input before the first byte is passed on.
    is_awaited: bool,
}

impl StandardInput {
    /// Begins to read.
    pub(super) fn open() -> Self {
        let (sender, chunks) = mpsc::channel();
        thread::spawn(move || {
            let mut buffer = [0; 4096];
            let mut input = io::stdin().lock();
            // The end of the input and an input that cannot be read are the same to a serial line:
            // no more bytes come.
            while let Ok(count @ 1..) = input.read(&mut buffer) {
                if sender.send(buffer[..count].to_vec()).is_err() {
                    return;
                }
            }
        });
        Self {
            chunks,
            is_awaited: !io::stdin().is_terminal(),
        }
    }

    /// What has come since the last call.
    pub(super) fn take(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        if std::mem::take(&mut self.is_awaited) {
            let end = Instant::now() + PATIENCE;
            let rest = || end.saturating_duration_since(Instant::now());
            while let Ok(chunk) = self.chunks.recv_timeout(rest()) {
                bytes.extend(chunk);
            }
        }
        bytes.extend(self.chunks.try_iter().flatten());
        bytes
    }
}
