//! MEMS physics: acceleration and magnetic field to bridge signals.
