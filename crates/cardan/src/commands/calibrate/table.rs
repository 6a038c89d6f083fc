//! The result of a calibration for people.

use std::fmt::Write as _;

use cardan_bench::calibration::Accuracy;

use super::document::Document;

pub(super) fn render(document: &Document) -> String {
    let mut out = String::new();
    let attitudes = &document.attitudes;
    let _ = writeln!(
        out,
        "{}: {} attitudes, {} solutions; left out as saturated: {} attitudes, {} solutions",
        document.scenario,
        attitudes.used,
        attitudes.solutions_used,
        attitudes.left_out,
        attitudes.solutions_saturated
    );
    parameters(&mut out, document);
    residuals(&mut out, document);
    for pair in &document.pairs {
        let _ = writeln!(
            out,
            "{}: condition number {:.1}; sensitivity to body z: its mean is in the offset, {:.2} {} rms \
             remain",
            pair.name, pair.condition, pair.z_left_rms, pair.unit
        );
    }
    if let Some(left) = document.cross_left_rms_mg {
        let _ = writeln!(
            out,
            "tilt_z: sensitivity to body x and y: {left:.2} mg rms remain"
        );
    }
    held_out(&mut out, document);
    let eeprom = &document.eeprom;
    let _ = match (&eeprom.file, eeprom.form) {
        (Some(file), Some(form)) => write!(out, "{file}: {} bytes, {form}", eeprom.bytes),
        _ => write!(out, "not written; --out FILE writes the EEPROM's content"),
    };
    if let Some(sent) = &document.sent {
        let _ = write!(out, "\n{sent}");
    }
    out
}

fn parameters(out: &mut String, document: &Document) {
    let _ = writeln!(
        out,
        "{:<20} {:>11} {:>11} {:>11}  unit",
        "", "estimate", "std. error", "before"
    );
    for parameter in &document.parameters {
        let error = parameter
            .standard_error
            .map_or("given".to_owned(), |error| format!("{error:.6}"));
        let _ = writeln!(
            out,
            "{:<20} {:>11.6} {error:>11} {:>11.6}  {}",
            parameter.name, parameter.value, parameter.before, parameter.unit
        );
    }
}

fn residuals(out: &mut String, document: &Document) {
    let _ = writeln!(
        out,
        "{:<20} {:>11} {:>11} {:>11} {:>11}  {:>14}",
        "residuals", "rms, LSB", "max, LSB", "rms", "max", "LSB to body z"
    );
    for channel in &document.channels {
        let _ = writeln!(
            out,
            "{:<20} {:>11.3} {:>11.3} {:>8.3} {} {:>8.3} {}  {:>6.2} +- {:.2}",
            channel.name,
            channel.residual_rms_lsb,
            channel.residual_max_lsb,
            channel.residual_rms,
            channel.unit,
            channel.residual_max,
            channel.unit,
            channel.sensitivity_lsb[2],
            channel.z_standard_error_lsb
        );
    }
}

fn held_out(out: &mut String, document: &Document) {
    let held_out = &document.held_out;
    let _ = writeln!(
        out,
        "attitude error in {} other attitudes, tilts to {:.0} degrees, seed {}:",
        held_out.attitudes, held_out.tilt_deg, held_out.seed
    );
    for (name, accuracy) in [("before", &held_out.before), ("after", &held_out.after)] {
        let _ = writeln!(out, "  {name:<7}{}", errors(accuracy));
    }
}

fn errors(accuracy: &Accuracy) -> String {
    let degrees = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.3}"));
    format!(
        "rms {:>7} deg, max {:>7} deg, noise alone {} deg; {} solutions, {} flagged",
        degrees(accuracy.rms_deg),
        degrees(accuracy.max_deg),
        degrees(accuracy.noise_rms_deg),
        accuracy.samples,
        accuracy.flagged
    )
}
