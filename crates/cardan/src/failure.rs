//! Why a command did not complete, and the exit code that says so.

use std::fmt;
use std::process::ExitCode;

/// Exit codes (contract): 0 pass, 1 fail, 2 bad input, 3 a participant died, 4 program crashed.
pub(crate) mod code {
    /// Done, verdict pass.
    pub(crate) const PASS: u8 = 0;
    /// Done, verdict fail.
    pub(crate) const FAIL: u8 = 1;
    /// Wrong usage or bad input.
    pub(crate) const INPUT: u8 = 2;
    /// A participant died, timed out or could not start.
    pub(crate) const PARTICIPANT: u8 = 3;
    /// The emulated program crashed.
    pub(crate) const CRASH: u8 = 4;
}

/// An error with its exit code. The message names file, place, expectation and mend.
#[derive(Debug)]
pub(crate) struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    /// Wrong usage or bad input.
    pub(crate) fn input(message: impl fmt::Display) -> Self {
        Self {
            code: code::INPUT,
            message: message.to_string(),
        }
    }

    /// A participant died, timed out or could not start.
    pub(crate) fn participant(message: impl fmt::Display) -> Self {
        Self {
            code: code::PARTICIPANT,
            message: message.to_string(),
        }
    }

    /// The emulated program crashed.
    pub(crate) fn crash(message: impl fmt::Display) -> Self {
        Self {
            code: code::CRASH,
            message: message.to_string(),
        }
    }

    /// Its exit code.
    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(self.code)
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

/// What a command returns.
pub(crate) type Done = Result<ExitCode, Failure>;
