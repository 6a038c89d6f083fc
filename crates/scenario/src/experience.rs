//! What the device feels at an instant, and the seam through which the analog side asks for it.

/// Reference temperature of all temperature coefficients, in kelvin (20 degrees Celsius).
pub const REFERENCE_K: f64 = 293.15;

/// Specific force, magnetic field and temperature at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Experience {
    /// Specific force along body x, y, z in units of local gravity; level and at rest (0, 0, -1).
    pub specific_force_g: [f64; 3],
    /// Magnetic flux density along body x, y, z in microtesla.
    pub field_ut: [f64; 3],
    /// Ambient temperature in kelvin.
    pub temperature_k: f64,
}

impl Default for Experience {
    /// Level, at rest, without field, at the reference temperature.
    fn default() -> Self {
        Self {
            specific_force_g: [0.0, 0.0, -1.0],
            field_ut: [0.0; 3],
            temperature_k: REFERENCE_K,
        }
    }
}

/// Anything that says what the device experiences when.
pub trait Stimulus {
    /// The experience `t_s` seconds after reset; defined for every finite `t_s` of at least zero.
    fn at(&self, t_s: f64) -> Experience;
}

impl<S: Stimulus + ?Sized> Stimulus for std::sync::Arc<S> {
    fn at(&self, t_s: f64) -> Experience {
        (**self).at(t_s)
    }
}

impl<S: Stimulus + ?Sized> Stimulus for Box<S> {
    fn at(&self, t_s: f64) -> Experience {
        (**self).at(t_s)
    }
}
