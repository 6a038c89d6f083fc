//! What goes to standard output and standard error, for people and for programs.

use std::io::{self, IsTerminal, Write};

use cardan_page::text::Style;
use clap::Args;
use rustix::termios::tcgetwinsize;

/// Width of text that no terminal shows: every column has room.
const WIDE: usize = 200;

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
    pub(crate) fn document(self, document: &impl serde::Serialize) {
        let text = serde_json::to_string_pretty(document)
            .unwrap_or_else(|error| format!("{{\"error\":\"{error}\"}}"));
        self.write(&mut io::stdout(), &text);
    }

    /// The command's result for people: standard output, or standard error beside JSON.
    pub(crate) fn result(self, text: &str) {
        if self.json {
            if !self.quiet {
                self.write(&mut io::stderr(), text);
            }
        } else {
            self.write(&mut io::stdout(), text);
        }
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

    /// A closed pipe is the reader's choice, not an error.
    fn write(self, to: &mut dyn Write, text: &str) {
        let _ = writeln!(to, "{}", text.trim_end_matches('\n'));
    }
}
