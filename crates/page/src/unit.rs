//! Units as people read them: the units of word-length files are those of the arithmetic.

/// How a unit is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<'a> {
    /// In tables.
    pub short: &'a str,
    /// In sentences.
    pub long: &'a str,
    /// Shown value over the node's.
    pub scale: f64,
}

impl Reading<'_> {
    /// What follows a value in a sentence: a space and the unit; nothing for pure numbers.
    #[must_use]
    pub fn suffix(&self) -> String {
        match self.short {
            "1" => String::new(),
            unit => format!(" {unit}"),
        }
    }
}

/// How values in `unit` are shown: angles in degrees, everything else as it is. Units that are not known here
/// are shown as they are.
#[must_use]
pub fn reading(unit: &str) -> Reading<'_> {
    let (short, long, scale) = match unit {
        "half_turn" => ("°", "degrees", 180.0),
        "fs" => ("FS", "fractions of full scale", 1.0),
        "lsb" => ("LSB", "steps of the converter", 1.0),
        "B" => ("|B|", "fractions of the field strength |B|", 1.0),
        "g2" => ("g²", "g²", 1.0),
        "1" => ("1", "a pure number", 1.0),
        other => (other, other, 1.0),
    };
    Reading { short, long, scale }
}

#[cfg(test)]
mod tests {
    use super::reading;

    #[test]
    fn angles_are_degrees_and_unknown_units_stay() {
        assert_eq!(
            (reading("half_turn").short, reading("half_turn").scale),
            ("°", 180.0)
        );
        assert_eq!((reading("V").long, reading("V").scale), ("V", 1.0));
    }
}
