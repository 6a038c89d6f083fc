//! What the device experiences: trajectories, recordings and the Earth field.
