//! A recording as a motion: interpolated experience and reference attitude.
//!
//! Between samples specific force and field follow a cubic Hermite curve through the samples with
//! central-difference slopes (Catmull-Rom on uneven time), straight lines across gaps. Sampled at
//! 285.7 Hz, a tone of 29 Hz passes with -0.02 dB, 50 Hz with -0.14 dB, 71 Hz with -0.55 dB; the
//! image of a 50 Hz tone at 236 Hz lies at -34 dB, before the device's own low-pass of 50 Hz.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use crate::error::Error;
use crate::experience::{Experience, REFERENCE_K};
use crate::field::EarthField;
use crate::mounting::Mounting;
use crate::recording_file::{self, Row};
use crate::recording_gaps::{self as gaps, Gap};
use crate::recording_plausible as plausible;
use crate::rotation::{self, Quaternion};
use crate::scenario::RecordingChoice;

/// Longest bridged gap, in typical sampling intervals: of samples for the curve, of reference
/// orientations for slerp.
const LONGEST_GAP: f64 = 5.0;

/// Seconds over which rest is judged.
const REST_WINDOW_S: f64 = 0.5;

/// Rows with reference orientation needed for an estimate of the field from them.
const LEAST_REFERENCE_ROWS: usize = 100;

/// A recording in body axes, time from its first row.
#[derive(Clone, Debug)]
pub struct Recording {
    rows: Vec<Row>,
    typical_interval_s: f64,
    gravity_m_s2: f64,
    field: EarthField,
    /// Maps magnetic NED to the reference's ENU.
    ned_to_enu: Matrix3<f64>,
    mounting: Matrix3<f64>,
    has_reference: bool,
    /// Times without a sample, longer than is bridged.
    gaps: Vec<Gap>,
    longest_gap_s: f64,
    notes: Vec<(&'static str, String, String)>,
}

impl Recording {
    /// Reads `file` as `choice` says; gravity and `field` where known, else estimated.
    ///
    /// # Errors
    /// Everything in [`recording_file::read`]; no rest in the recording from which to estimate.
    pub fn open(
        file: &Path,
        mounting: &Mounting,
        choice: &RecordingChoice,
        field: Option<EarthField>,
    ) -> Result<Self, Error> {
        let rows = recording_file::read(file, choice)?;
        let mut intervals: Vec<f64> = rows.windows(2).map(|w| w[1].t_s - w[0].t_s).collect();
        let typical_interval_s = median(&mut intervals);
        plausible::check_rate(file, typical_interval_s)?;
        let longest_gap_s = choice
            .longest_gap_s
            .unwrap_or(LONGEST_GAP * typical_interval_s);
        let mut recording = Self {
            typical_interval_s,
            gaps: gaps::find(&rows, longest_gap_s),
            longest_gap_s,
            has_reference: rows.iter().any(|row| row.reference.is_some()),
            rows,
            gravity_m_s2: 0.0,
            field: EarthField {
                horizontal_ut: 0.0,
                vertical_ut: 0.0,
            },
            ned_to_enu: ned_to_enu(0.0),
            mounting: mounting.matrix(),
            notes: Vec::new(),
        };
        recording.settle_sign(file, choice.acc_is_gravity, field)?;
        recording.settle_gravity(file, choice.gravity_m_s2)?;
        recording.settle_field(file, field)?;
        recording
            .notes
            .extend(gaps::note(&recording.gaps, longest_gap_s));
        Ok(recording)
    }

    /// Seconds from the first to the last row.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.rows[self.rows.len() - 1].t_s
    }

    /// The Earth's field, as given or estimated.
    #[must_use]
    pub fn field(&self) -> EarthField {
        self.field
    }

    /// What was estimated: key, value, how.
    #[must_use]
    pub fn notes(&self) -> &[(&'static str, String, String)] {
        &self.notes
    }

    /// True if any row has a reference orientation.
    #[must_use]
    pub fn has_reference(&self) -> bool {
        self.has_reference
    }

    /// The experience at `t_s`; outside the recording that of its nearest end.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Experience {
        let (index, t_s) = self.locate(t_s);
        let slope_limits = self.neighbours(index);
        let force = self.interpolate(index, slope_limits, t_s, |row| row.force_m_s2);
        let field = self.interpolate(index, slope_limits, t_s, |row| row.field_ut);
        let to_body = |v: [f64; 3]| -> [f64; 3] { (self.mounting * Vector3::from(v)).into() };
        Experience {
            specific_force_g: to_body(force).map(|f| f / self.gravity_m_s2),
            field_ut: to_body(field),
            temperature_k: REFERENCE_K,
        }
    }

    /// The reference attitude (magnetic NED to body) at `t_s`; none outside or in longer gaps.
    #[must_use]
    pub fn truth_at(&self, t_s: f64) -> Option<Matrix3<f64>> {
        if !(0.0..=self.duration_s()).contains(&t_s) {
            return None;
        }
        let (index, _) = self.locate(t_s);
        let longest = LONGEST_GAP * self.typical_interval_s;
        let reach = LONGEST_GAP as usize;
        let before = self.rows[..=index]
            .iter()
            .rev()
            .take(reach)
            .find(|r| r.reference.is_some())?;
        let after = self.rows[index + 1..]
            .iter()
            .take(reach)
            .find(|r| r.reference.is_some())?;
        let span = after.t_s - before.t_s;
        if span > longest {
            return None;
        }
        let fraction = (t_s - before.t_s) / span;
        let orientation = rotation::between(before.reference?, after.reference?, fraction);
        Some(self.attitude(orientation))
    }

    /// Orientation (sensor to ENU) to attitude (magnetic NED to body).
    fn attitude(&self, orientation: Quaternion) -> Matrix3<f64> {
        self.mounting * rotation::from_quaternion(orientation).transpose() * self.ned_to_enu
    }

    /// Index of the row before `t_s`, never the last, and `t_s` inside the recording.
    fn locate(&self, t_s: f64) -> (usize, f64) {
        let t_s = t_s.clamp(0.0, self.duration_s());
        let after = self.rows.partition_point(|row| row.t_s <= t_s);
        (after.clamp(1, self.rows.len() - 1) - 1, t_s)
    }

    /// Rows whose differences give the slopes at both ends of an interval; the interval itself at
    /// the ends of the recording and beside gaps.
    fn neighbours(&self, index: usize) -> [(usize, usize); 2] {
        let longest = self.longest_gap_s;
        let close = |i: usize| self.rows[i + 1].t_s - self.rows[i].t_s <= longest;
        let before = index
            .checked_sub(1)
            .filter(|i| close(*i) && close(index))
            .unwrap_or(index);
        let after =
            Some(index + 2).filter(|i| *i < self.rows.len() && close(i - 1) && close(index));
        [(before, index + 1), (index, after.unwrap_or(index + 1))]
    }

    fn interpolate(
        &self,
        index: usize,
        slope_rows: [(usize, usize); 2],
        t_s: f64,
        value: impl Fn(&Row) -> [f64; 3],
    ) -> [f64; 3] {
        let (start, end) = (&self.rows[index], &self.rows[index + 1]);
        let span = end.t_s - start.t_s;
        let u = (t_s - start.t_s) / span;
        let (a, b) = (value(start), value(end));
        let slope = |(from, to): (usize, usize), axis: usize| {
            let (from, to) = (&self.rows[from], &self.rows[to]);
            (value(to)[axis] - value(from)[axis]) / (to.t_s - from.t_s) * span
        };
        std::array::from_fn(|axis| {
            let (p, q) = (slope(slope_rows[0], axis), slope(slope_rows[1], axis));
            let rise = b[axis] - a[axis];
            a[axis] + u * (p + u * ((3.0 * rise - 2.0 * p - q) + u * (p + q - 2.0 * rise)))
        })
    }

    fn settle_gravity(&mut self, file: &Path, given: Option<f64>) -> Result<(), Error> {
        if let Some(gravity) = given {
            self.gravity_m_s2 = gravity;
            return Ok(());
        }
        let mut lengths: Vec<f64> = self
            .resting_rows()
            .iter()
            .map(|row| norm(row.force_m_s2))
            .collect();
        let gravity = median(&mut lengths);
        if !(9.0..=10.6).contains(&gravity) {
            return Err(Error::Recording {
                file: file.into(),
                message: format!(
                    "specific force at rest is {gravity:.4} m/s^2, expected about 9.81: {}check the \
                     unit of acc_*_m_s2, or set motion.recording.gravity_m_s2",
                    plausible::force_hint(gravity)
                ),
            });
        }
        self.gravity_m_s2 = gravity;
        let how = "median specific force in the quietest tenth of the recording".to_string();
        self.notes.push((
            "motion.recording.gravity_m_s2",
            format!("{gravity:.5}"),
            how,
        ));
        Ok(())
    }

    /// Settles whether the acceleration is specific force (up at rest) or gravity, and makes it the
    /// former.
    fn settle_sign(
        &mut self,
        file: &Path,
        stated: Option<bool>,
        field: Option<EarthField>,
    ) -> Result<(), Error> {
        if stated == Some(true) {
            for row in &mut self.rows {
                row.force_m_s2 = row.force_m_s2.map(|force| -force);
            }
        }
        let fault = plausible::sign(self.upward_force(), self.field_at_rest(), field, stated);
        match fault {
            None => Ok(()),
            Some(message) => Err(Error::Recording {
                file: file.into(),
                message,
            }),
        }
    }

    /// Median of the specific force along the reference's up; none where nothing tells it.
    fn upward_force(&self) -> Option<f64> {
        let up = |row: &Row| {
            let turned = rotation::from_quaternion(row.reference?) * Vector3::from(row.force_m_s2);
            Some(turned.z)
        };
        let mut up: Vec<f64> = self.rows.iter().filter_map(up).collect();
        (up.len() >= LEAST_REFERENCE_ROWS).then(|| median(&mut up))
    }

    /// True if between these instants, or so shortly before that the device remembers, lies a gap.
    #[must_use]
    pub fn is_bridged(&self, from_s: f64, to_s: f64) -> bool {
        gaps::touch(&self.gaps, from_s, to_s)
    }

    /// The gaps in a line; none if there are none.
    #[must_use]
    pub fn remark(&self) -> Option<String> {
        gaps::remark(&self.gaps, self.longest_gap_s)
    }

    /// Settles field and magnetic north.
    fn settle_field(&mut self, file: &Path, given: Option<EarthField>) -> Result<(), Error> {
        let referenced = self
            .rows
            .iter()
            .filter(|row| row.reference.is_some())
            .count();
        let (field, how) = if referenced >= LEAST_REFERENCE_ROWS {
            let [east, north, up] = self.field_in_enu();
            let azimuth = libm::atan2(east, north);
            self.ned_to_enu = ned_to_enu(azimuth);
            let degrees = azimuth.to_degrees();
            let how = "direction of the horizontal field in the reference frame".to_string();
            self.notes.push((
                "magnetic north east of the reference's, deg",
                format!("{degrees:.3}"),
                how,
            ));
            let horizontal_ut = (east * east + north * north).sqrt();
            let field = EarthField {
                horizontal_ut,
                vertical_ut: -up,
            };
            (
                field,
                "median of the recorded field turned by the reference orientation",
            )
        } else {
            (
                self.field_at_rest(),
                "median |B| and median dip against gravity at rest",
            )
        };
        if let Some(given) = given {
            self.field = given;
            return Ok(());
        }
        if !(field.horizontal_ut > 1.0 && field.total_ut() < 200.0) {
            return Err(Error::Recording {
                file: file.into(),
                message: format!(
                    "the estimated field ({:.2} uT horizontal, {:.2} uT down) cannot give a \
                     heading: {}check mag_*_uT, or set field.horizontal_ut and field.vertical_ut",
                    field.horizontal_ut,
                    field.vertical_ut,
                    plausible::field_hint(field.total_ut())
                ),
            });
        }
        self.field = field;
        for (key, value) in [
            ("field.horizontal_ut", field.horizontal_ut),
            ("field.vertical_ut", field.vertical_ut),
        ] {
            self.notes
                .push((key, format!("{value:.4}"), how.to_string()));
        }
        Ok(())
    }

    /// Medians of the field's east, north and up components over rows with a reference.
    fn field_in_enu(&self) -> [f64; 3] {
        let turned: Vec<Vector3<f64>> = self
            .rows
            .iter()
            .filter_map(|row| {
                Some(rotation::from_quaternion(row.reference?) * Vector3::from(row.field_ut))
            })
            .collect();
        std::array::from_fn(|axis| {
            median(&mut turned.iter().map(|v| v[axis]).collect::<Vec<f64>>())
        })
    }

    fn field_at_rest(&self) -> EarthField {
        let total = median(
            &mut self
                .rows
                .iter()
                .map(|row| norm(row.field_ut))
                .collect::<Vec<_>>(),
        );
        let down = |row: &&Row| {
            let up: f64 = row
                .field_ut
                .iter()
                .zip(&row.force_m_s2)
                .map(|(b, f)| b * f)
                .sum();
            -up / norm(row.force_m_s2)
        };
        let resting = self.resting_rows();
        let vertical_ut = median(&mut resting.iter().map(down).collect::<Vec<_>>());
        let horizontal_ut = (total * total - vertical_ut * vertical_ut).max(0.0).sqrt();
        EarthField {
            horizontal_ut,
            vertical_ut,
        }
    }

    /// Rows of the tenth of half-second windows (at least one) in which specific force varies least.
    fn resting_rows(&self) -> Vec<&Row> {
        let length = ((REST_WINDOW_S / self.typical_interval_s) as usize).clamp(2, self.rows.len());
        let mut windows: Vec<(f64, &[Row])> = self
            .rows
            .chunks_exact(length)
            .map(|window| (variance(window, |r| r.force_m_s2), window))
            .collect();
        windows.sort_by(|a, b| a.0.total_cmp(&b.0));
        let quiet = windows.len().div_ceil(10);
        windows[..quiet]
            .iter()
            .flat_map(|(_, window)| window.iter())
            .collect()
    }
}

/// Maps magnetic NED to east-north-up when magnetic north is `azimuth` radians east of the frame's.
fn ned_to_enu(azimuth: f64) -> Matrix3<f64> {
    let (s, c) = libm::sincos(azimuth);
    Matrix3::new(s, c, 0.0, c, -s, 0.0, 0.0, 0.0, -1.0)
}

fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn variance(rows: &[Row], value: impl Fn(&Row) -> [f64; 3]) -> f64 {
    let n = rows.len() as f64;
    (0..3)
        .map(|axis| {
            let mean = rows.iter().map(|row| value(row)[axis]).sum::<f64>() / n;
            rows.iter()
                .map(|row| (value(row)[axis] - mean) * (value(row)[axis] - mean))
                .sum::<f64>()
                / n
        })
        .sum()
}

/// The middle value; reorders its argument, which must not be empty.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
