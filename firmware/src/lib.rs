//! The shared no_std firmware: averaging, calibration, attitude, frames.
