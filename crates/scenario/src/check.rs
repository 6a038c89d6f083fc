//! What values a scenario may have.

use crate::error::Error;
use crate::field;
use crate::hardware::Controller;
use crate::scenario::{Field, MOST_SECONDS, MotionKind, Scenario};

impl Scenario {
    /// Checks every value; `place` in the error is left for the caller to fill.
    ///
    /// # Errors
    /// The first inadmissible value, with its key and range.
    pub fn check(&self) -> Result<(), Error> {
        for p in self.parameters() {
            if !p.is_admissible() {
                let key = format!("{}.{}", p.section, p.key);
                let expected = format!("{} to {} {}", p.least, p.most, p.unit);
                return Err(range(&key, p.value, &expected));
            }
        }
        let seconds_expected = format!("more than 0 and at most {MOST_SECONDS} s");
        within(
            "seconds",
            Some(self.seconds),
            f64::MIN_POSITIVE,
            MOST_SECONDS,
            &seconds_expected,
        )?;
        let aperture = self.frontend.aperture_cycles;
        if aperture.fract() != 0.0 {
            return Err(range(
                "frontend.aperture_cycles",
                aperture,
                "a whole number of cycles",
            ));
        }
        self.check_averaging()?;
        self.check_field()?;
        self.check_calibration()?;
        self.check_tolerance()?;
        let gravity = self.motion.recording.gravity_m_s2;
        within(
            "motion.recording.gravity_m_s2",
            gravity,
            9.7,
            9.9,
            "9.7 to 9.9 m/s^2",
        )?;
        within(
            "motion.recording.longest_gap_s",
            self.motion.recording.longest_gap_s,
            1e-6,
            1e6,
            "1e-6 to 1e6 s",
        )?;
        if !self.mounting.is_rotation() {
            let axes = [
                self.mounting.x_body,
                self.mounting.y_body,
                self.mounting.z_body,
            ];
            let found = axes.map(|axis| axis.name()).join(", ");
            return Err(range(
                "mounting",
                found,
                "a right-handed set of three different axes",
            ));
        }
        if self.motion.kind == MotionKind::Recording && self.motion.recording.file.is_none() {
            let expected = "motion.recording.file, or the option --recording";
            return Err(range("motion.kind", "recording", expected));
        }
        Ok(())
    }

    fn check_averaging(&self) -> Result<(), Error> {
        let Controller { averaging, period } = self.controller;
        let is_power = |value: f64| value.fract() == 0.0 && (value as u32).is_power_of_two();
        if !is_power(period) {
            let expected = "a power of two from 16 to 4096";
            return Err(range("controller.period", period, expected));
        }
        if !is_power(averaging) || averaging > period {
            let expected = format!("a power of two from 1 to controller.period = {period}");
            return Err(range("controller.averaging", averaging, &expected));
        }
        Ok(())
    }

    fn check_field(&self) -> Result<(), Error> {
        let Field {
            site,
            horizontal_ut,
            vertical_ut,
        } = &self.field;
        within(
            "field.horizontal_ut",
            *horizontal_ut,
            0.1,
            100.0,
            "0.1 to 100 uT",
        )?;
        within(
            "field.vertical_ut",
            *vertical_ut,
            -100.0,
            100.0,
            "-100 to 100 uT",
        )?;
        if horizontal_ut.is_some() != vertical_ut.is_some() {
            let (given, other) = match horizontal_ut {
                Some(_) => ("field.horizontal_ut", "field.vertical_ut"),
                None => ("field.vertical_ut", "field.horizontal_ut"),
            };
            return Err(range(given, "given alone", &format!("{other} beside it")));
        }
        if field::site(site).is_none() {
            let sites = field::SITES.map(|(name, _)| name).join(", ");
            return Err(range("field.site", site, &format!("one of {sites}")));
        }
        Ok(())
    }

    fn check_calibration(&self) -> Result<(), Error> {
        let c = &self.calibration;
        let pair = |key: &str, values: Option<[f64; 2]>, most: f64| {
            let expected = format!("-{most} to {most}");
            values
                .iter()
                .flatten()
                .try_for_each(|v| within(key, Some(*v), -most, most, &expected))
        };
        pair("calibration.tilt_offset", c.tilt_offset, 1.0)?;
        pair("calibration.field_offset", c.field_offset, 1.0)?;
        let third = |value: Option<f64>| value.map(|value| [value, 0.0]);
        pair("calibration.tilt_z_offset", third(c.tilt_z_offset), 1.0)?;
        pair("calibration.tilt_z_gain", third(c.tilt_z_gain), 7.99)?;
        for row in c.tilt_matrix.iter().flatten() {
            pair("calibration.tilt_matrix", Some(*row), 7.99)?;
        }
        for row in c.field_matrix.iter().flatten() {
            pair("calibration.field_matrix", Some(*row), 7.99)?;
        }
        within(
            "calibration.horizontal_ut",
            c.horizontal_ut,
            0.1,
            100.0,
            "0.1 to 100 uT",
        )?;
        within(
            "calibration.vertical_ut",
            c.vertical_ut,
            -100.0,
            100.0,
            "-100 to 100 uT",
        )
    }

    fn check_tolerance(&self) -> Result<(), Error> {
        for (node, limit) in &self.tolerance.nodes {
            let key = format!("tolerance.nodes.{node}");
            within(
                &key,
                Some(*limit),
                0.0,
                f64::MAX,
                "0 or more, in the node's unit",
            )?;
        }
        for (key, limit, most, expected) in self.tolerance.checked() {
            within(key, limit, 0.0, most, expected)?;
        }
        Ok(())
    }
}

fn within(
    key: &str,
    value: Option<f64>,
    least: f64,
    most: f64,
    expected: &str,
) -> Result<(), Error> {
    match value {
        Some(v) if !(least <= v && v <= most) => Err(range(key, v, expected)),
        _ => Ok(()),
    }
}

pub(crate) fn range(key: &str, value: impl std::fmt::Display, expected: &str) -> Error {
    Error::Range {
        place: "scenario".into(),
        key: key.into(),
        value: value.to_string(),
        expected: expected.into(),
    }
}
