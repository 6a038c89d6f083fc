//! `accuracy`: the attitude's error under converter noise, on the emulated chip and by models.

mod chopping;

use std::fmt::Write as _;
use std::process::ExitCode;

use cardan_bench::accuracy::{Accuracy, Case, Spread, codes_per_unit, measure};
use cardan_scenario::Scenario;
use clap::Args;
use serde::Serialize;

use crate::failure::{Done, Failure};
use crate::output::Output;

/// Noise of a conversion in codes.
const NOISE_LSB: f64 = 0.5;
/// Published noise of the sensors: g and microtesla (docs/sensors.md, section 7.6).
const PUBLISHED_NOISE: [f64; 2] = [0.030, 0.82];

/// How accurate the attitude is under converter noise: random attitudes through a 10-bit converter and
/// the firmware on the emulated chip, beside golden model, maximum likelihood and Cramer-Rao bound.
///
/// Every solution sees an attitude of its own, at rest; each conversion has noise of its own. Errors are
/// angles of rotation against the true attitude.
#[derive(Args)]
pub(crate) struct Arguments {
    /// Random attitudes per averaging length
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=1_000_000),
        allow_negative_numbers = true)]
    attitudes: u32,
    /// Seed of attitudes and noise
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        allow_negative_numbers = true
    )]
    seed: u64,
    /// Conversions averaged, powers of two from 1 to 4096, separated by commas
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [1, 64], value_parser = averaging,
        allow_negative_numbers = true)]
    averaging: Vec<usize>,
    /// Largest tilt in degrees, 0 to 75
    #[arg(long, value_name = "DEGREES", default_value_t = 60.0, value_parser = tilt,
        allow_negative_numbers = true)]
    tilt: f64,
    /// The sensors' published noise (30 mg, 0.82 uT, or both) in each conversion, beside the converter's
    #[arg(long, value_name = "CHANNELS", num_args = 0..=1, require_equals = true, default_missing_value = "both")]
    published_levels: Option<Published>,
    /// Instead: the tilt channels' noise if their bridges were chopped at these frequencies in hertz,
    /// and without chopping, by the front end's model
    #[arg(
        long, value_name = "LIST", value_delimiter = ',', num_args = 0.., require_equals = true, value_parser = frequency,
        default_missing_values = ["1000", "2000", "4000", "8000", "16000", "32000"],
        conflicts_with_all = ["attitudes", "seed", "averaging", "tilt", "published_levels"]
    )]
    chopping: Option<Vec<f64>>,
    /// Scenario whose sensors and front end are chopped (a bundled one or a file)
    #[arg(
        long,
        value_name = "NAME|FILE",
        help = "Scenario whose sensors and front end are chopped (a bundled one or a file) [default: tumble]"
    )]
    scenario: Option<String>,
}

/// Channels with the published noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Published {
    /// Of the accelerometers alone.
    Tilt,
    /// Of the magnetometers alone.
    Field,
    /// All.
    Both,
}

fn averaging(text: &str) -> Result<usize, String> {
    let length = text.parse().ok();
    length
        .filter(|length: &usize| length.is_power_of_two() && *length <= 4096)
        .ok_or_else(|| "expected a power of two from 1 to 4096".to_owned())
}

fn frequency(text: &str) -> Result<f64, String> {
    let value = text.parse().ok();
    value
        .filter(|hz| (100.0..=100e3).contains(hz))
        .ok_or_else(|| "expected hertz, 100 to 100000".to_owned())
}

fn tilt(text: &str) -> Result<f64, String> {
    let value: f64 = text
        .parse()
        .map_err(|_| "expected degrees, 0 to 75".to_owned())?;
    if (0.0..=75.0).contains(&value) {
        Ok(value)
    } else {
        Err("expected 0 to 75 degrees".to_owned())
    }
}

#[derive(Serialize)]
struct Document<'a> {
    attitudes: u32,
    seed: u64,
    most_tilt_deg: f64,
    noise_lsb: [f64; 2],
    rows: &'a [Accuracy],
}

/// Runs the command. Exit 1 if native and emulated frames differ.
pub(crate) fn execute(arguments: &Arguments, output: Output) -> Done {
    if let Some(frequencies) = &arguments.chopping {
        let name = arguments
            .scenario
            .as_deref()
            .unwrap_or(cardan_scenario::scenario::DEFAULT);
        let scenario = Scenario::load(name).map_err(Failure::input)?;
        scenario.check().map_err(Failure::input)?;
        let document = chopping::document(&scenario, frequencies)?;
        if output.is_json() {
            output.document(&document)?;
        }
        output.result(&document.table())?;
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(name) = &arguments.scenario {
        return Err(Failure::input(format!(
            "--scenario {name}: has no effect without --chopping; give that too, or leave it out"
        )));
    }
    let noise_lsb = noise(arguments.published_levels);
    let mut rows = Vec::new();
    for &averaging in &arguments.averaging {
        output.note(&format!(
            "{averaging} averaged: {} attitudes",
            arguments.attitudes
        ));
        let case = Case {
            attitudes: arguments.attitudes as usize,
            seed: arguments.seed,
            most_tilt_deg: arguments.tilt,
            averaging,
            noise_lsb,
        };
        rows.push(measure(&case).map_err(Failure::input)?);
    }
    if output.is_json() {
        output.document(&Document {
            attitudes: arguments.attitudes,
            seed: arguments.seed,
            most_tilt_deg: arguments.tilt,
            noise_lsb,
            rows: &rows,
        })?;
    }
    output.result(&table(&rows, noise_lsb))?;
    let same = rows.iter().all(|row| row.native_mismatches == 0);
    Ok(ExitCode::from(u8::from(!same)))
}

/// Noise of a conversion in codes, of tilt and field channels.
fn noise(published: Option<Published>) -> [f64; 2] {
    let codes = codes_per_unit();
    let with = |at: usize, channels: Published| {
        let is_noisy = published == Some(channels) || published == Some(Published::Both);
        let sensor = if is_noisy {
            PUBLISHED_NOISE[at] * codes[at]
        } else {
            0.0
        };
        (sensor * sensor + NOISE_LSB * NOISE_LSB).sqrt()
    };
    [with(0, Published::Tilt), with(1, Published::Field)]
}

fn table(rows: &[Accuracy], noise_lsb: [f64; 2]) -> String {
    let mut out = format!(
        "Degrees of rotation, rms / p99 / max; noise {:.2} (tilt) and {:.2} (field) codes per conversion\n\n\
         | averaged | emulated chip | its yaw, pitch (rms) | golden | set 1 alone | set 2 alone | maximum likelihood | \
         Cramer-Rao | rounding | native differs |\n|---|---|---|---|---|---|---|---|---|---|\n",
        noise_lsb[0], noise_lsb[1]
    );
    let spread = |s: &Spread| format!("{:.4} / {:.3} / {:.3}", s.rms, s.p99, s.max);
    for row in rows {
        let _ = writeln!(
            out,
            "| {} | {} | {:.3}, {:.3} | {} | {} | {} | {} | {:.4} | {} | {} |",
            row.averaging,
            spread(&row.emulated),
            row.yaw_rms,
            row.pitch_rms,
            spread(&row.golden),
            spread(&row.set_1),
            spread(&row.set_2),
            spread(&row.maximum_likelihood),
            row.cramer_rao_rms,
            spread(&row.rounding),
            row.native_mismatches,
        );
    }
    out
}
