//! The analog chain with track-and-hold, stepped exactly between controller events.
