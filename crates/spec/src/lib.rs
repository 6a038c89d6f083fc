//! The reference design's constants with their reasons, node names, frame and calibration layouts.
