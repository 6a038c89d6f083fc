//! Translates the emulated chip's hot code to host code, bit- and cycle-exact.
//!
//! A [`Translator`] is an [`Engine`](cardan_emulator::engine::Engine) for
//! [`Machine::run_with`](cardan_emulator::Machine::run_with). It interprets and counts where the
//! program jumps to; a place that becomes hot is translated together with the code around it
//! ([`region`]), through Cranelift ([`lower`], [`compiler`]). Translated code leaves the core
//! between two instructions exactly as the interpreter would, so that events, interrupts and
//! everything behind the I/O bus stay the machine's business, and hands every unusual case, and
//! the last instructions before an event, to the interpreter.
//!
//! The machine stays a plain value: code belongs to the translator, which drops what was made
//! from program memory that has changed since.

mod arithmetic;
mod code;
mod compiler;
mod engine;
mod facts;
mod lower;
mod region;
mod state;

pub use engine::{Limits, Translator, Work};
