//! Cardan: proves fixed-point sensor firmware against its golden model before silicon.

fn main() {}
