//! What goes to standard output and standard error, for people and for programs.
//!
//! A result that cannot be written is an error, whatever it says; a note that cannot is none.

use std::io::{self, ErrorKind, IsTerminal, Write};

use cardan_page::text::Style;
use clap::Args;
use rustix::termios::tcgetwinsize;

/// Width of text that no terminal shows: every column has room.
const WIDE: usize = 200;

use crate::failure::Failure;

/// Options of every command.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct Options {
    /// One JSON document on standard output; all else on standard error.
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// Say nothing but results and errors.
    #[arg(long, global = true)]
    pub(crate) quiet: bool,
}

/// Where a command writes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Output {
    json: bool,
    quiet: bool,
}

impl Output {
    pub(crate) fn new(options: &Options) -> Self {
        Self {
            json: options.json,
            quiet: options.quiet,
        }
    }

    /// True if the result is wanted as JSON.
    pub(crate) fn is_json(self) -> bool {
        self.json
    }

    /// True if only results and errors are wanted.
    pub(crate) fn is_quiet(self) -> bool {
        self.quiet
    }

    /// Layout of text for people: colours on a terminal, unless NO_COLOR is set, or where CLICOLOR_FORCE asks
    /// for them (the environment's conventions); as wide as COLUMNS says or the terminal is. Beside JSON the
    /// text goes to standard error.
    pub(crate) fn style(self) -> Style {
        let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        let forced =
            is_set("CLICOLOR_FORCE") && std::env::var("CLICOLOR_FORCE").as_deref() != Ok("0");
        let (is_terminal, size) = if self.json {
            (io::stderr().is_terminal(), tcgetwinsize(io::stderr()))
        } else {
            (io::stdout().is_terminal(), tcgetwinsize(io::stdout()))
        };
        let columns = std::env::var("COLUMNS")
            .ok()
            .and_then(|text| text.parse().ok());
        let of_terminal = size
            .ok()
            .map(|size| usize::from(size.ws_col))
            .filter(|&width| width > 0);
        Style {
            color: !is_set("NO_COLOR") && (forced || is_terminal),
            width: columns.or(of_terminal).unwrap_or(WIDE),
        }
    }

    /// The command's JSON document.
    ///
    /// # Errors
    /// It cannot be written.
    pub(crate) fn document(self, document: &impl serde::Serialize) -> Result<(), Failure> {
        let text = serde_json::to_string_pretty(document)
            .map_err(|error| Failure::participant(format!("the document: {error}")))?;
        to_standard_output(text.trim_end_matches('\n').as_bytes(), true)
    }

    /// The command's result for people: standard output, or standard error beside JSON.
    ///
    /// # Errors
    /// It cannot be written to standard output.
    pub(crate) fn result(self, text: &str) -> Result<(), Failure> {
        if self.json {
            self.note(text);
            return Ok(());
        }
        to_standard_output(text.trim_end_matches('\n').as_bytes(), true)
    }

    /// What is going on, unless quiet; standard error.
    pub(crate) fn note(self, text: &str) {
        if !self.quiet {
            self.write(&mut io::stderr(), text);
        }
    }

    /// How far long work is: one line that is overwritten, on a terminal only; empty clears it.
    pub(crate) fn progress(self, text: &str) {
        let mut to = io::stderr();
        if !self.quiet && to.is_terminal() {
            let _ = write!(to, "\r\x1b[K{text}");
            let _ = to.flush();
        }
    }

    /// An error; standard error.
    pub(crate) fn error(self, error: &dyn std::fmt::Display) {
        self.write(&mut io::stderr(), &format!("cardan: {error}"));
    }

    /// Where even errors go nothing can be told of an error.
    fn write(self, to: &mut dyn Write, text: &str) {
        let _ = writeln!(to, "{}", text.trim_end_matches('\n'));
    }
}

/// Writes a result to standard output, to its last byte; with a line end if that is wanted.
///
/// # Errors
/// The system's: a full disk, a reader that is gone. (Where standard output was closed from the
/// beginning, the standard library has put `/dev/null`, as the user wanted.)
pub(crate) fn to_standard_output(text: &[u8], ends_line: bool) -> Result<(), Failure> {
    let mut to = io::stdout().lock();
    let end: &[u8] = if ends_line { b"\n" } else { b"" };
    let written = to
        .write_all(text)
        .and_then(|()| to.write_all(end))
        .and_then(|()| to.flush());
    written.map_err(|error| match error.kind() {
        ErrorKind::BrokenPipe => lost(&"its reader is gone"),
        _ => lost(&error),
    })
}

fn lost(why: &dyn std::fmt::Display) -> Failure {
    Failure::input(format!(
        "standard output: the result cannot be written: {why}"
    ))
}
