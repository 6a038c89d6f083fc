//! Which engine executes the program.

use cardan_emulator::engine::Interpreter;
use cardan_emulator::{Machine, Stop};
use cardan_translator::Translator;
use clap::ValueEnum;

use super::desk::Desk;
use crate::failure::Failure;

/// Names on the command line and in the document.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum EngineName {
    /// The interpreter.
    Interp,
    /// The translator to host code.
    Jit,
}

/// The engine of a run.
pub(super) enum Chosen {
    Interpreter,
    Translator(Box<Translator>),
}

impl Chosen {
    /// The engine asked for, or the best of this host; the interpreter if each instruction is to be
    /// observed, which only that can show.
    pub(super) fn new(name: Option<EngineName>, is_observed: bool) -> Result<Chosen, Failure> {
        if name == Some(EngineName::Interp) || is_observed {
            return Ok(Chosen::Interpreter);
        }
        match (Translator::new(), name) {
            (Some(translator), _) => Ok(Chosen::Translator(Box::new(translator))),
            (None, None) => Ok(Chosen::Interpreter),
            (None, Some(_)) => Err(Failure::input(
                "--engine jit: there is no translator for this host (x86-64 and AArch64 have \
                 one); leave the option out, or give --engine interp",
            )),
        }
    }

    /// Its name in the document.
    pub(super) fn name(&self) -> &'static str {
        match self {
            Chosen::Interpreter => "interp",
            Chosen::Translator(_) => "jit",
        }
    }

    /// [`Machine::run`] with this engine.
    pub(super) fn run(&mut self, machine: &mut Machine, desk: &mut Desk, until: u64) -> Stop {
        match self {
            Chosen::Interpreter => machine.run_with(&mut Interpreter, desk, until),
            Chosen::Translator(translator) => machine.run_with(&mut **translator, desk, until),
        }
    }
}
