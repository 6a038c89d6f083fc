//! The shared no_std firmware: averaging, calibration, attitude, frames.
//!
//! Everything here is the same source on the controller and on the host. Hardware is reached only
//! through `embedded-hal` and the traits of [`hal`]; arithmetic only through
//! [`cardan_datapath::Arithmetic`].
#![no_std]

pub mod attitude;
pub mod averaging;
pub mod calibration;
pub mod device;
pub mod exchange;
pub mod frame;
pub mod hal;
mod inverse;

/// Node types of the datapath, generated from `wordlengths.toml`.
pub mod nodes {
    include!(concat!(env!("OUT_DIR"), "/nodes.rs"));
}

/// Hash of the deployed formats: equal hashes compute in equal formats.
pub const FORMATS_HASH: u64 = cardan_datapath::table_hash(&nodes::NODES);
