//! Alignment, metrics, tolerances, error budget, verdict and report.
