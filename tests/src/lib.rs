//! Whole-system tests and their inputs.
