//! Translates the emulated chip's hot code to host code, bit- and cycle-exact.
//!
//! A [`Translator`] is an [`Engine`](cardan_emulator::engine::Engine) for
//! [`Machine::run_with`](cardan_emulator::Machine::run_with). It interprets and counts where the
//! program jumps to; a place that becomes hot is translated together with the code around it
//! (`region`), through Cranelift (`lower`, `compiler`). Translated code leaves the core
//! between two instructions exactly as the interpreter would, so that events, interrupts and
//! everything behind the I/O bus stay the machine's business, and hands every unusual case, and
//! the last instructions before an event, to the interpreter.
//!
//! The machine stays a plain value: code belongs to the translator, which drops what was made
//! from program memory that has changed since.
//!
//! Code is generated for x86-64 and AArch64 hosts; elsewhere [`Translator::new`] returns nothing,
//! and the interpreter does everything.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod arithmetic;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod code;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod compiler;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod engine;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod facts;
mod limits;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod lower;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod region;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod state;
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
mod unavailable;

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub use engine::Translator;
pub use limits::{Limits, Work};
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
pub use unavailable::Translator;
