//! The f64 golden model of the attitude sensor; knows nothing of fixed point.
