//! `--gdb`: a debugger such as `avr-gdb` steers the run, over TCP.

use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::str::FromStr;

use cardan_emulator::{Debugger, Machine, SessionError, State, Stop};

use super::desk::Desk;
use super::serial::Line;
use super::slice_end;
use crate::failure::Failure;

/// Where a debugger connects if it names no host: this machine only.
const HOST: &str = "127.0.0.1";

/// The value of `--gdb`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Address {
    host: String,
    port: u16,
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (host, port) = text.rsplit_once(':').unwrap_or(("", text));
        let host = host.trim_start_matches('[').trim_end_matches(']');
        let expected = || {
            "expected HOST:PORT or a port alone (0 to 65535; 0 picks a free one), for example 1234"
                .to_owned()
        };
        Ok(Self {
            host: if host.is_empty() { HOST } else { host }.to_owned(),
            port: port.parse().map_err(|_| expected())?,
        })
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

/// What a session leaves.
pub(super) struct Left {
    pub(super) machine: Machine,
    pub(super) desk: Desk,
    /// How the run has ended; `None`: the debugger has detached, and the program goes on.
    pub(super) stop: Option<Stop>,
    /// The debugger went away without a word.
    pub(super) is_lost: bool,
}

/// A port that waits for a debugger.
pub(super) struct Port {
    listener: TcpListener,
    address: Address,
}

impl Port {
    /// Opens the port and says where it is.
    pub(super) fn open(address: &Address) -> Result<Self, Failure> {
        let host = (address.host.as_str(), address.port);
        let opened = TcpListener::bind(host).and_then(|listener| {
            let place = listener.local_addr()?;
            Ok((listener, place))
        });
        let (listener, place) = opened.map_err(|error| {
            Failure::input(format!(
                "--gdb {address}: cannot listen there: {error}; expected an address of this \
                 machine and a free port (0 picks one)"
            ))
        })?;
        // Whoever is to connect must know the port, however quiet we are.
        eprintln!("gdb: waiting at {place}; in avr-gdb: target remote {place}");
        Ok(Self {
            listener,
            address: address.clone(),
        })
    }

    /// Waits for a debugger and serves it to the end of its session. `limit` ends the program.
    pub(super) fn serve(
        self,
        machine: Machine,
        desk: Desk,
        line: &mut Line,
        limit: u64,
    ) -> Result<Left, Failure> {
        let (stream, _) = self
            .listener
            .accept()
            .map_err(|error| self.broken(&error))?;
        stream
            .set_nodelay(true)
            .map_err(|error| self.broken(&error))?;
        let mut debugger = Debugger::new(machine, desk).map_err(|error| self.gave_up(&error))?;
        let is_lost = self.converse(&mut debugger, stream, line, limit)?;
        let is_detached = debugger.state() == State::Detached;
        let (machine, mut desk, end) = debugger.into_parts();
        line.exchange(&mut desk, machine.cycle())?;
        let stop = if is_detached {
            // BREAK ends no program that has been halted there and left to itself.
            end.filter(|end| *end != Stop::Break)
        } else {
            Some(end.unwrap_or(Stop::Requested))
        };
        Ok(Left {
            machine,
            desk,
            stop,
            is_lost,
        })
    }

    /// Passes bytes to and fro, and lets the chip run in between. Returns whether the debugger went
    /// away without a word.
    fn converse(
        &self,
        debugger: &mut Debugger<Desk>,
        mut stream: TcpStream,
        line: &mut Line,
        limit: u64,
    ) -> Result<bool, Failure> {
        let mut buffer = [0; 4096];
        loop {
            let is_running = match debugger.state() {
                State::Halted => false,
                State::Running => true,
                State::Detached | State::Killed => return Ok(false),
            };
            let set = stream.set_nonblocking(is_running);
            match set.and_then(|()| stream.read(&mut buffer)) {
                Ok(0) => return Ok(true),
                Ok(count) => debugger.receive(&buffer[..count]),
                Err(error) if is_transient(&error) => Ok(()),
                Err(_) => return Ok(true),
            }
            .map_err(|error| self.gave_up(&error))?;
            if debugger.state() == State::Running {
                self.run(debugger, line, limit)?;
            }
            let said = debugger.take_output();
            let sent = stream
                .set_nonblocking(false)
                .and_then(|()| stream.write_all(&said));
            if sent.is_err() {
                let is_over = matches!(debugger.state(), State::Detached | State::Killed);
                return Ok(!is_over);
            }
        }
    }

    /// One slice of the run.
    fn run(
        &self,
        debugger: &mut Debugger<Desk>,
        line: &mut Line,
        limit: u64,
    ) -> Result<(), Failure> {
        let until = slice_end(debugger.machine(), limit);
        let ran = debugger.run(until, limit);
        ran.map_err(|error| self.gave_up(&error))?;
        let cycle = debugger.machine().cycle();
        let desk = debugger.environment_mut();
        line.exchange(desk, cycle)?;
        if desk.is_closed {
            debugger
                .end(Stop::Requested)
                .map_err(|error| self.gave_up(&error))?;
        }
        Ok(())
    }

    fn broken(&self, error: &io::Error) -> Failure {
        Failure::participant(format!(
            "--gdb {}: {error}; start the run again",
            self.address
        ))
    }

    fn gave_up(&self, error: &SessionError) -> Failure {
        Failure::participant(format!("--gdb {}: {error}", self.address))
    }
}

fn is_transient(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_port_or_a_host_and_a_port() {
        let shown = |text: &str| text.parse().map(|address: Address| address.to_string());
        assert_eq!(shown("1234"), Ok("127.0.0.1:1234".to_owned()));
        assert_eq!(shown(":0"), Ok("127.0.0.1:0".to_owned()));
        assert_eq!(shown("localhost:99"), Ok("localhost:99".to_owned()));
        assert_eq!(shown("[::1]:99"), Ok("::1:99".to_owned()));
        for wrong in ["", "localhost", "1:2:x", "65536", "-1", "host:"] {
            let error = wrong.parse::<Address>().expect_err(wrong);
            assert!(error.contains("HOST:PORT"), "{error}");
        }
    }
}
