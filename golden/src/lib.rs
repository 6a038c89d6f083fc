//! The f64 golden model of the attitude sensor; knows nothing of fixed point.
//!
//! Written from the equations alone (docs/sensors.md, section 7), never from the firmware: the
//! two meet in `cardan-spec`, so that one mistake cannot hide in both. [`Golden`] is fed the
//! conversions of the device, averages them, and [`solve()`] turns averages into an attitude. Each
//! write of a node of [`cardan_spec::nodes::SHARED`] is reported to the caller in signal order.
//!
//! An attitude is a matrix M with v_body = M v_reference; the reference frame is magnetic north,
//! east, down. Tilt readings are in g (the gravity component along body x and y), field readings
//! over |B|. Transcendental functions come from `libm`, so that results are the same bits on every
//! host; every operation is total.

mod domain;
pub mod frame;
pub mod half_space;
pub mod likelihood;
mod model;
pub mod node;
pub mod orders;
pub mod rotation;
pub mod solve;
mod unrest;

pub use likelihood::{Estimate, Noise, cramer_rao, maximum_likelihood};
pub use model::Golden;
pub use rotation::{
    Angles, Attitude, EarthField, Readings, angles_of, code_of_tilt_z, codes_of, ideal_readings,
    rotation_angle, set_1_matrix, set_2_matrix,
};
pub use solve::{Memory, Solution, Third, solve};
