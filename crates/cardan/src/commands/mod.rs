//! The verbs, one file each.

pub(crate) mod accuracy;
pub(crate) mod build;
pub(crate) mod calibrate;
pub(crate) mod doctor;
pub(crate) mod manual;
pub(crate) mod ranges;
pub(crate) mod run;
pub(crate) mod tune;

pub(crate) mod compare;
mod corners;
mod explain;
pub(crate) mod help;
pub(crate) mod participants;
