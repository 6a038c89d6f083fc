//! Recordings as loggers write them.

mod forms;
mod mended;
mod refused;
mod swing;
