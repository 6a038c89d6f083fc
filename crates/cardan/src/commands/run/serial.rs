//! The host's side of the serial line: where sent bytes go, and where received ones come from.

use std::convert::Infallible;
use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::path::PathBuf;
use std::str::FromStr;

use super::desk::Desk;
use super::pty::Terminal;
use super::standard_input::StandardInput;
use crate::failure::Failure;
use crate::output::Output;

/// The value of `--uart`.
#[derive(Clone, Debug)]
pub(super) enum Choice {
    /// Standard output and standard input.
    Stdio,
    /// A pseudo terminal.
    Pty,
    /// Not connected.
    Nothing,
    /// A file for what is sent.
    File(PathBuf),
}

impl FromStr for Choice {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(match text {
            "stdio" => Self::Stdio,
            "pty" => Self::Pty,
            "none" => Self::Nothing,
            file => Self::File(file.into()),
        })
    }
}

/// An open line.
pub(super) struct Line(End);

enum End {
    /// Standard output, or standard error beside JSON.
    Standard {
        to_error: bool,
        input: Option<StandardInput>,
    },
    Terminal(Terminal),
    File {
        file: File,
        name: PathBuf,
    },
    Nowhere,
}

impl Line {
    /// Opens what `--uart` asks for; `hz` is the clock.
    pub(super) fn open(choice: Option<&Choice>, hz: u64, output: Output) -> Result<Self, Failure> {
        let to_error = output.is_json();
        let end = match choice {
            None => End::Standard {
                to_error,
                input: None,
            },
            Some(Choice::Stdio) => {
                let input = Some(StandardInput::open());
                End::Standard { to_error, input }
            }
            Some(Choice::Pty) => {
                let terminal = Terminal::open(hz).map_err(|error| {
                    Failure::input(format!("--uart pty: no pseudo terminal to be had: {error}"))
                })?;
                // Whoever is to open it must know the name, however quiet we are.
                eprintln!("serial line: {}", terminal.name());
                End::Terminal(terminal)
            }
            Some(Choice::Nothing) => End::Nowhere,
            Some(Choice::File(name)) => {
                let file = File::create(name).map_err(|error| {
                    Failure::input(format!(
                        "--uart {}: cannot be written: {error}; expected stdio, pty, none or a \
                         file in a folder that exists",
                        name.display()
                    ))
                })?;
                End::File {
                    file,
                    name: name.clone(),
                }
            }
        };
        Ok(Self(end))
    }

    /// Passes on what the chip has sent by `cycle`, and takes in what has come for it.
    pub(super) fn exchange(&mut self, desk: &mut Desk, cycle: u64) -> Result<(), Failure> {
        self.pass_on(desk)?;
        match &mut self.0 {
            End::Standard {
                input: Some(input), ..
            } => {
                desk.received.extend(input.take());
            }
            End::Terminal(terminal) => {
                desk.received.extend(terminal.take());
                terminal.keep_pace(cycle);
            }
            _ => {}
        }
        Ok(())
    }

    fn pass_on(&mut self, desk: &mut Desk) -> Result<(), Failure> {
        let sent = std::mem::take(&mut desk.sent);
        if sent.is_empty() && !matches!(self.0, End::Terminal(_)) {
            return Ok(());
        }
        let written = match &mut self.0 {
            End::Standard {
                to_error: false, ..
            } => write(&mut io::stdout().lock(), &sent),
            End::Standard { to_error: true, .. } => write(&mut io::stderr().lock(), &sent),
            End::Terminal(terminal) => {
                terminal.send(&sent);
                Ok(())
            }
            End::File { file, .. } => file.write_all(&sent),
            End::Nowhere => Ok(()),
        };
        match written {
            Err(error) if error.kind() == ErrorKind::BrokenPipe => desk.is_closed = true,
            Err(error) => return Err(self.unwritten(&error)),
            Ok(()) => {}
        }
        Ok(())
    }

    fn unwritten(&self, error: &io::Error) -> Failure {
        let name = match &self.0 {
            End::File { name, .. } => name.display().to_string(),
            _ => "the serial line's output".to_owned(),
        };
        Failure::input(format!("{name}: cannot be written: {error}"))
    }

    /// Passes on the rest.
    pub(super) fn close(mut self, desk: &mut Desk) -> Result<(), Failure> {
        self.pass_on(desk)?;
        if let End::Terminal(terminal) = self.0 {
            terminal.close();
        }
        Ok(())
    }
}

fn write(to: &mut dyn Write, bytes: &[u8]) -> io::Result<()> {
    to.write_all(bytes)?;
    to.flush()
}
