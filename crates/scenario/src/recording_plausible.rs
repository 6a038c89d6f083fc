//! What a recording cannot be, and what it most likely is instead.

use std::path::Path;

use crate::error::Error;
use crate::field::EarthField;

/// Typical sampling intervals in seconds beyond which the unit of time is in doubt: a device with a
/// bandwidth of 50 Hz learns nothing from one sample per second.
const INTERVALS_S: std::ops::Range<f64> = 1e-5..0.9;

/// Inclinations in radians beyond which the field tells gravity's direction.
const CLEAR_DIP: f64 = 0.35;

/// Refuses times in another unit than the column says.
pub(crate) fn check_rate(file: &Path, interval_s: f64) -> Result<(), Error> {
    if INTERVALS_S.contains(&interval_s) {
        return Ok(());
    }
    let mend = if interval_s < INTERVALS_S.start {
        "if its times are in seconds, name the column t_s"
    } else {
        "if its times are in milliseconds or microseconds, name the column t_ms or t_us"
    };
    Err(Error::Recording {
        file: file.into(),
        message: format!(
            "the samples are {} s apart by the time column, expected {} to {} s: {mend}",
            rounded(interval_s),
            INTERVALS_S.start,
            INTERVALS_S.end
        ),
    })
}

/// Four digits of a number.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// The unit that specific force at rest most likely has.
pub(crate) fn force_hint(at_rest: f64) -> &'static str {
    match at_rest {
        0.0..0.3 => {
            "gravity has been taken out, or the unit is another; give the raw acceleration; "
        }
        0.9..1.1 => "it looks like g, so name the columns acc_x_g, acc_y_g, acc_z_g; ",
        900.0..1100.0 => "it looks like mg, so name the columns acc_x_mg, acc_y_mg, acc_z_mg; ",
        _ => "",
    }
}

/// The unit that a field of this length most likely has.
pub(crate) fn field_hint(total: f64) -> &'static str {
    match total {
        0.015..0.1 => "it looks like mT, so name the columns mag_x_mT, mag_y_mT, mag_z_mT; ",
        0.15..1.0 => "it looks like gauss, so name the columns mag_x_gauss and so on; ",
        200.0..1000.0 => "it looks like milligauss, so name the columns mag_x_mgauss and so on; ",
        15e3..100e3 => "it looks like nT, so name the columns mag_x_nT, mag_y_nT, mag_z_nT; ",
        _ => "",
    }
}

/// What is wrong with the sign of the acceleration, if anything: `upward` is its median along the
/// reference's up, `at_rest` the field by it, `given` the field as stated, `stated` whether it was said
/// to be gravity.
pub(crate) fn sign(
    upward: Option<f64>,
    at_rest: EarthField,
    given: Option<EarthField>,
    stated: Option<bool>,
) -> Option<String> {
    let dip = |field: &EarthField| libm::atan2(field.vertical_ut, field.horizontal_ut);
    let mend = match stated {
        Some(true) => "leave out motion.recording.acc_is_gravity",
        _ => "--set motion.recording.acc_is_gravity=true",
    };
    let seen = dip(&at_rest);
    match (upward, given) {
        (Some(up), _) if up < 0.0 => Some(format!(
            "the acceleration points down at rest by the reference orientation: it is gravity, and \
             expected is specific force, which points up; mend: {mend}"
        )),
        (None, Some(field)) if dip(&field) * seen < 0.0 && seen.abs() > CLEAR_DIP => Some(format!(
            "the acceleration points down at rest by the field that was given: it is gravity, and \
             expected is specific force, which points up; mend: {mend}"
        )),
        (None, None) if seen < -CLEAR_DIP && stated.is_none() => Some(format!(
            "by the acceleration the field points {:.0} degrees up, as in the southern hemisphere: \
             if the acceleration is gravity (down at rest) and not specific force, mend: {mend}; if it \
             was recorded there, =false",
            -seen.to_degrees()
        )),
        _ => None,
    }
}
