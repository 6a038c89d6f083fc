//! The verbs, one file each.

pub(crate) mod run;

pub(crate) mod compare;
pub(crate) mod participants;
