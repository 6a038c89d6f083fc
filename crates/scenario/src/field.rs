//! The Earth's magnetic field: sites with published models, or explicit components.

/// Horizontal and vertical (downward) flux density in microtesla.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthField {
    /// Component along magnetic north.
    pub horizontal_ut: f64,
    /// Downward component.
    pub vertical_ut: f64,
}

impl EarthField {
    /// Flux density in microtesla.
    #[must_use]
    pub fn total_ut(&self) -> f64 {
        (self.horizontal_ut * self.horizontal_ut + self.vertical_ut * self.vertical_ut).sqrt()
    }

    /// Cosine and sine of the inclination, the angle under the horizontal.
    #[must_use]
    pub fn inclination(&self) -> (f64, f64) {
        (
            self.horizontal_ut / self.total_ut(),
            self.vertical_ut / self.total_ut(),
        )
    }
}

/// Sites by name (docs/sensors.md, section 5: IGRF by ppigrf 2.1.0).
pub const SITES: [(&str, EarthField); 3] = [
    (
        "montpellier-2008",
        EarthField {
            horizontal_ut: 23.563,
            vertical_ut: 39.732,
        },
    ),
    (
        "montpellier-2025",
        EarthField {
            horizontal_ut: 23.824,
            vertical_ut: 40.253,
        },
    ),
    (
        "montpellier-2026",
        EarthField {
            horizontal_ut: 23.834,
            vertical_ut: 40.290,
        },
    ),
];

/// The field at a named site.
#[must_use]
pub fn site(name: &str) -> Option<EarthField> {
    SITES
        .iter()
        .find(|(known, _)| *known == name)
        .map(|(_, field)| *field)
}
