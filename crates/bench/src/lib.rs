//! The breadboard: wires scenario, sensors, front end, emulator, firmware and golden model.
//!
//! The only crate that sees the analog side, the emulator, the firmware and the golden model at
//! once. An [`App`] is an algorithm with its board, golden model and nodes; a [`Device`] makes the
//! conversions, an [`Engine`] runs the algorithm on them in one of its interpretations, and both show what
//! happens to a [`Sink`].

pub mod accuracy;
pub mod app;
pub mod attitude;
pub mod calibration;
mod engine;
pub mod image;

pub use app::App;
pub use engine::{
    Conversion, Conversions, Device, Engine, EngineError, Sink, SinkError, Summary, ThirdTilt,
    Truth,
};
