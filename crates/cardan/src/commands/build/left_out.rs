//! Targets that `build --target all` could not build, and why.

use std::fmt;

use serde::Serialize;

use crate::failure::Failure;
use crate::toolchain::{Board, Missing};

/// Targets that were not built for the same reason.
#[derive(Serialize)]
pub(super) struct LeftOut {
    /// Their names.
    pub(super) targets: Vec<&'static str>,
    /// What of their toolchain is not there, each part with what installs it.
    pub(super) parts: Vec<String>,
    /// Why the build failed, where the toolchain is there.
    error: Option<String>,
}

impl LeftOut {
    /// A board without a toolchain.
    pub(super) fn missing(board: &Board, missing: &Missing) -> Self {
        Self {
            targets: vec![board.name],
            parts: missing.parts.clone(),
            error: None,
        }
    }

    /// A board whose build failed.
    pub(super) fn failed(board: &Board, failure: &Failure) -> Self {
        Self {
            targets: vec![board.name],
            parts: Vec::new(),
            error: Some(failure.to_string()),
        }
    }
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.targets.join(", "))?;
        for part in self.parts.iter().chain(&self.error) {
            write!(f, "\n  {}", part.trim_end().replace('\n', "\n  "))?;
        }
        Ok(())
    }
}

/// All of them, one below the other.
pub(super) fn listed(left_out: &[LeftOut]) -> String {
    let lines: Vec<String> = left_out
        .iter()
        .map(|one| format!("not built: {one}"))
        .collect();
    lines.join("\n")
}
