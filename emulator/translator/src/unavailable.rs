//! The translator on hosts for which there is no code generator: there is none.

use cardan_emulator::engine::{Core, Engine, Exit};

use crate::limits::{Limits, Work};

/// An engine that translates. This host has none.
#[derive(Debug)]
pub enum Translator {}

impl Translator {
    /// Nothing: there is no code generator for this host.
    pub fn new() -> Option<Translator> {
        None
    }

    /// Nothing: there is no code generator for this host.
    pub fn with_limits(_: Limits) -> Option<Translator> {
        None
    }

    /// What it has done so far.
    pub fn work(&self) -> Work {
        match *self {}
    }
}

impl Engine for Translator {
    fn run(&mut self, _: &mut Core) -> Exit {
        match *self {}
    }
}
