//! The verbs, one file each.

pub(crate) mod accuracy;
pub(crate) mod build;
pub(crate) mod calibrate;
pub(crate) mod doctor;
pub(crate) mod ranges;
pub(crate) mod run;
pub(crate) mod tune;

pub(crate) mod compare;
mod corners;
pub(crate) mod participants;
