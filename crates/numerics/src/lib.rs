//! The other arithmetics over the same algorithm: real and tunable.
