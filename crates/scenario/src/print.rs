//! The scenario as a commented TOML file that reads back as the same scenario.

use std::fmt::Write;

use crate::field;
use crate::parameter::{Origin, Parameter, Parameters};
use crate::scenario::{BUNDLED, MOST_SECONDS, Scenario};

/// Documented text of `scenario`: every key with meaning, unit, range, default and origin.
#[must_use]
pub fn print_scenario(scenario: &Scenario) -> String {
    let mut out = Page::default();
    head(&mut out, scenario);
    motion(&mut out, scenario);
    out.table(
        "vibration",
        "A sine of specific force on top of the motion.",
    );
    out.parameters(&scenario.vibration.list());
    out.table("climate", "Ambient temperature: a ramp from reset on.");
    out.parameters(&scenario.climate.list());
    out.table(
        "disturbance",
        "A magnetic field that moves with the body for a time.",
    );
    out.parameters(&scenario.disturbance.list());
    out.table("clock", "The controller's oscillator.");
    out.parameters(&scenario.clock.list());
    field_table(&mut out, scenario);
    let s = &scenario.sensors;
    out.table("sensors", "Which sensors are fitted besides two of each.");
    out.key(
        "A third accelerometer, along body z: it tells upright from upside down, so that solutions hold in\n\
         every attitude. \"comparator\" (or true): one bit per solution, at the controller's analog\n\
         comparator. \"measured\": a fifth channel of the converter, at ADC4; rounds are longer then, a\n\
         solution comes every 10 ms at the earliest, instead of 8. \"absent\" (or false; default).",
        "third_tilt",
        s.third_tilt.name(),
    );
    out.table(
        "sensors.accelerometer",
        "Convective accelerometers along body x and y (and z where fitted).",
    );
    out.parameters(&s.accelerometer.list());
    out.table(
        "sensors.magnetometer",
        "Lorentz magnetometers along body x and y.",
    );
    out.parameters(&s.magnetometer.list());
    out.table(
        "frontend",
        "Amplifier, band-pass, track-and-hold, low-pass, output amplifier.",
    );
    out.parameters(&scenario.frontend.list());
    out.table("adc", "Errors of the converter.");
    out.parameters(&scenario.adc.list());
    out.table(
        "controller",
        "What the controller averages, as its EEPROM says.",
    );
    out.parameters(&scenario.controller.list());
    out.table("noise", "Noise of everything above at once.");
    out.key(
        "All noise on or off; with off the same run is free of chance.",
        "enabled",
        scenario.noise.enabled,
    );
    mounting(&mut out, scenario);
    calibration(&mut out, scenario);
    tolerance(&mut out, scenario);
    out.text
}

#[derive(Default)]
struct Page {
    text: String,
}

impl Page {
    fn line(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push('\n');
    }

    fn comment(&mut self, text: &str) {
        for line in text.lines() {
            self.line(&format!("# {line}"));
        }
    }

    fn table(&mut self, name: &str, about: &str) {
        self.line("");
        self.comment(about);
        self.line(&format!("[{name}]"));
    }

    fn key(&mut self, about: &str, key: &str, value: impl std::fmt::Debug) {
        self.comment(about);
        self.line(&format!("{key} = {value:?}"));
    }

    /// A key without default: set, or shown as a comment with an example.
    fn optional(&mut self, about: &str, key: &str, value: Option<impl std::fmt::Debug>, eg: &str) {
        self.comment(about);
        match value {
            Some(value) => self.line(&format!("{key} = {value:?}")),
            None => self.line(&format!("#{key} = {eg}")),
        }
    }

    fn parameters(&mut self, parameters: &[Parameter]) {
        for p in parameters {
            let origin = match p.origin {
                Origin::Published(source) => format!(" Published: {source}."),
                Origin::Assumed(reason) => format!(" Assumed: {reason}."),
                Origin::Setting => String::new(),
            };
            let Parameter {
                value,
                default,
                unit,
                least,
                most,
                meaning,
                ..
            } = p;
            self.comment(meaning);
            self.comment(&format!(
                "Unit {unit}, {least:?} to {most:?}, default {default:?}.{origin}"
            ));
            self.line(&format!("{} = {value:?}", p.key));
        }
    }
}

fn head(out: &mut Page, scenario: &Scenario) {
    out.comment("Cardan scenario. Keys left out take the default; unknown keys are errors.");
    out.comment(&format!(
        "Bundled scenarios: {}.",
        BUNDLED.map(|(name, _)| name).join(", ")
    ));
    out.comment("The seed (--seed) sets the tumble's phases and all noise.");
    out.line("");
    out.key(
        "Name in reports; default: the file's.",
        "name",
        &scenario.name,
    );
    out.key("One sentence for people.", "about", &scenario.about);
    let about = format!(
        "Simulated time after reset, unit s, more than 0 to {MOST_SECONDS:?}, default 12.0. The\n\
         first 0.096 s settle the filters (0.12 s with a measured third tilt axis). A recording may end the run earlier."
    );
    out.key(&about, "seconds", scenario.seconds);
}

fn motion(out: &mut Page, scenario: &Scenario) {
    let m = &scenario.motion;
    out.table("motion", "What moves the device.");
    out.key(
        "\"tumble\" (default), \"static\", \"sweep\", \"step\" or \"recording\".",
        "kind",
        m.kind.name(),
    );
    out.table(
        "motion.tumble",
        "Seeded synthetic tumble: smooth, endless, through all headings.",
    );
    out.parameters(&m.tumble.list());
    out.table(
        "motion.static",
        "Rests at a grid of attitudes, moving smoothly between them.",
    );
    out.parameters(&m.grid.list());
    out.table(
        "motion.sweep",
        "Sine sweep of the angles about one axis or several.",
    );
    out.parameters(&m.sweep.list());
    out.table("motion.step", "A step from one attitude to another.");
    out.parameters(&m.step.list());
    out.table(
        "motion.recording",
        "Recorded specific force and field (option --recording).",
    );
    let about = "CSV or CSV.gz with columns t_s, acc_{x,y,z}_m_s2 (specific force), mag_{x,y,z}_uT\n\
                 and, optional, ref_q{w,x,y,z} (sensor axes to east-north-up; may be empty).";
    out.optional(
        about,
        "file",
        m.recording.file.as_ref(),
        "\"recording.csv.gz\"",
    );
    let about = "Local gravity, unit m/s^2, 9.7 to 9.9; without it the recording's own at rest.";
    out.optional(about, "gravity_m_s2", m.recording.gravity_m_s2, "9.8048");
    let about = "A longer time without a sample is a gap, which no judged solution may see, unit s;\n\
                 without it, five typical sampling intervals.";
    out.optional(about, "longest_gap_s", m.recording.longest_gap_s, "0.1");
    let about =
        "Interpolates a magnetometer that is slower than the accelerometer (empty mag cells).";
    out.key(about, "interpolate_mag", m.recording.interpolate_mag);
    let about = "The acc columns hold gravity (down at rest) and not specific force; without it the\n\
                 recording must show that they do not.";
    out.optional(about, "acc_is_gravity", m.recording.acc_is_gravity, "true");
}

fn field_table(out: &mut Page, scenario: &Scenario) {
    let f = &scenario.field;
    out.table("field", "The Earth's field. For a recording only explicit components count; else\nthey are estimated from it and reported as assumed.");
    let mut about =
        String::from("Site, used where components are not explicit (IGRF, Bh and Bv in uT):");
    for (name, site) in field::SITES {
        let _ = write!(
            about,
            "\n  {name}: {:?}, {:?}",
            site.horizontal_ut, site.vertical_ut
        );
    }
    out.key(&about, "site", &f.site);
    let about = "Horizontal component, unit uT, 0.1 to 100; needs vertical_ut beside it.";
    out.optional(about, "horizontal_ut", f.horizontal_ut, "23.834");
    let about = "Downward component, unit uT, -100 to 100; needs horizontal_ut beside it.";
    out.optional(about, "vertical_ut", f.vertical_ut, "40.29");
}

fn mounting(out: &mut Page, scenario: &Scenario) {
    let m = &scenario.mounting;
    out.table("mounting", "Sensor axis of the recording along each body axis (x, y, z, -x, -y, -z); the\ndefault suits sensors whose z points up.");
    for (key, axis) in [
        ("x_body", m.x_body),
        ("y_body", m.y_body),
        ("z_body", m.z_body),
    ] {
        out.line(&format!("{key} = {:?}", axis.name()));
    }
}

fn calibration(out: &mut Page, scenario: &Scenario) {
    let c = &scenario.calibration;
    out.table("calibration", "What the device's EEPROM holds; each key left out is that of a nominal device in the\nfield of the run. Averages are fractions of full scale.");
    let eg = "[-0.0009765625, -0.0009765625]";
    out.optional(
        "Averages of both tilt channels at zero g, -1 to 1.",
        "tilt_offset",
        c.tilt_offset,
        eg,
    );
    let about = "Gravity along body x, y in g per full scale of both averages, -7.99 to 7.99.";
    out.optional(
        about,
        "tilt_matrix",
        c.tilt_matrix,
        "[[-1.2, 0.0], [0.0, -1.2]]",
    );
    out.optional(
        "Averages of both field channels at zero field, -1 to 1.",
        "field_offset",
        c.field_offset,
        eg,
    );
    let about = "Field along body x, y over |B| per full scale of both averages, -7.99 to 7.99.";
    out.optional(
        about,
        "field_matrix",
        c.field_matrix,
        "[[1.28, 0.0], [0.0, 1.28]]",
    );
    let about = "Average of a measured third tilt axis at zero g, -1 to 1.";
    out.optional(about, "tilt_z_offset", c.tilt_z_offset, "-0.0009765625");
    let about = "Gravity along body z in g per full scale of that average, -7.99 to 7.99.";
    out.optional(about, "tilt_z_gain", c.tilt_z_gain, "-1.2");
    let about = "Horizontal field as the device believes it, unit uT, 0.1 to 100.";
    out.optional(about, "horizontal_ut", c.horizontal_ut, "23.834");
    let about = "Downward field as the device believes it, unit uT, -100 to 100.";
    out.optional(about, "vertical_ut", c.vertical_ut, "40.29");
}

fn tolerance(out: &mut Page, scenario: &Scenario) {
    let t = &scenario.tolerance;
    out.table(
        "tolerance.nodes",
        "Largest difference between golden and native, node = limit in the node's unit.",
    );
    for (node, limit) in &t.nodes {
        out.line(&format!("{node} = {limit:?}"));
    }
    let sections = [
        (
            "truth",
            "Limits of the rotation between output and truth; without: reported, not judged.",
            &t.truth.reason,
        ),
        (
            "stages",
            "Limits of the rms rotation that a stage of the error budget brings.",
            &t.stages.reason,
        ),
        (
            "channels",
            "Limit of the mean by which a channel's voltage may be off ideal sensors.",
            &t.channels.reason,
        ),
        (
            "status",
            "Limit of the share of solutions with status bits.",
            &t.status.reason,
        ),
    ];
    for (section, about, reason) in sections {
        out.table(&format!("tolerance.{section}"), about);
        for (key, limit, _, unit) in t.checked() {
            let name = key
                .strip_prefix("tolerance.")
                .and_then(|key| key.split_once('.'));
            if let Some((of, key)) = name
                && of == section
            {
                out.optional(&format!("Unit and range: {unit}."), key, limit, "1.0");
            }
        }
        if !reason.is_empty() {
            out.line(&format!("reason = {reason:?}"));
        }
    }
}
