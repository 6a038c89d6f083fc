//! `calibrate`: a unit's calibration from what it sends in known attitudes, as an EEPROM image, and
//! on its way into a device.

mod document;
mod send;
mod table;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use cardan_bench::app::by_name;
use cardan_bench::calibration::{CalibrateError, Request};
use cardan_scenario::scenario::MotionKind;
use clap::Args;

use self::document::Document;
use crate::eeprom_file;
use crate::failure::{Done, Failure};
use crate::output::Output;
use crate::run_options::RunOptions;

/// Attitudes unless the user says otherwise.
const ATTITUDES: usize = 24;

/// Estimates a unit's calibration and writes the content of its EEPROM.
///
/// The emulated device, with the scenario's sensors and deviations, rests in attitudes all over the
/// sphere (or moves with a recording, whose slow parts are used), and its frames are fitted by
/// least squares: offsets, sensitivities, misalignment and cross-sensitivity of tilt and field. Then
/// it is checked in other attitudes, with the calibration it had and with the new one.
///
/// With --send the calibration goes to a device on a serial port, which stores it and restarts; with
/// --image as well, that of a file, and nothing is estimated.
#[derive(Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    run: RunOptions,
    /// Attitudes to rest in, for the estimate and again for the check [default: 24]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(6..=10_000))]
    attitudes: Option<u64>,
    /// Solutions that are averaged in each attitude
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u64).range(2..=10_000))]
    solutions: u64,
    /// Writes the EEPROM's content: .hex or .eep for Intel HEX, .bin for raw bytes
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Sends the calibration to the device on this serial port (115200 baud) and checks what it stored
    #[arg(long, value_name = "PORT")]
    send: Option<String>,
    /// Sends the EEPROM content of this file (as written by --out) instead of estimating one
    #[arg(
        long,
        value_name = "FILE",
        requires = "send",
        conflicts_with_all = ["out", "build", "checkout", "attitudes", "solutions", "scenario", "recording", "firmware", "wordlengths", "seconds", "seed", "set", "eeprom"]
    )]
    image: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn execute(arguments: &Arguments, output: Output) -> Done {
    if let Some(file) = &arguments.out {
        eeprom_file::check_name(file)?;
    }
    let files = arguments.run.inputs();
    files.output("--out", arguments.out.as_deref()).check()?;
    if let (Some(file), Some(port)) = (&arguments.image, &arguments.send) {
        return send_file(&arguments.run.app, file, port, output);
    }
    let setup = arguments.run.resolve_plain()?;
    let recorded = setup.scenario.motion.kind == MotionKind::Recording;
    check_options(arguments, recorded)?;
    setup.announce(output)?;
    let request = Request {
        scenario: &setup.scenario,
        seed: setup.seed,
        seconds: setup.seconds,
        firmware: &setup.firmware,
        attitudes: arguments
            .attitudes
            .map_or(ATTITUDES, |count| count as usize),
        solutions: arguments.solutions as usize,
    };
    output.note(if recorded {
        "reading the unit along the recording, then in other attitudes"
    } else {
        "reading the unit in its attitudes, then in others"
    });
    let calibrated = match setup.app.calibrate(&request) {
        Ok(calibrated) => calibrated,
        Err(error @ CalibrateError::Crash(_)) => {
            return Err(Failure::crash(format!("{}: {error}", setup.firmware.name)));
        }
        Err(CalibrateError::Estimate(error)) => {
            return Err(Failure::input(format!("{}: {error}", setup.scenario.name)));
        }
        Err(error) => return Err(Failure::input(error)),
    };
    for remark in &calibrated.remarks {
        output.note(&format!("remark: {remark}"));
    }
    if let Some(file) = &arguments.out {
        eeprom_file::write(file, &calibrated.image)?;
    }
    let sent = match &arguments.send {
        Some(port) => Some(send::send(setup.app, port, &calibrated.image, output)?),
        None => None,
    };
    let document = Document::new(
        &setup,
        recorded,
        arguments.out.as_deref(),
        &calibrated,
        sent,
    );
    if output.is_json() {
        output.document(&document)?;
    }
    output.result(&table::render(&document))?;
    Ok(ExitCode::SUCCESS)
}

/// Sends what a file holds.
fn send_file(app: &str, file: &Path, port: &str, output: Output) -> Done {
    let app = by_name(app).map_err(Failure::input)?;
    let content = eeprom_file::read(file)?;
    let image = app.settings_image(&content).map_err(Failure::input)?;
    let sent = send::send(app, port, &image, output)?;
    if output.is_json() {
        output.document(&sent)?;
    }
    output.result(&sent.to_string())?;
    Ok(ExitCode::SUCCESS)
}

/// Refuses options that would do nothing.
fn check_options(arguments: &Arguments, recorded: bool) -> Result<(), Failure> {
    if recorded && arguments.attitudes.is_some() {
        return Err(Failure::input(
            "--attitudes: the recording decides which attitudes there are; leave it out",
        ));
    }
    if !recorded && arguments.run.seconds.is_some() {
        return Err(Failure::input(
            "--seconds: without a recording the attitudes decide how long the run is; use \
             --attitudes and --solutions",
        ));
    }
    Ok(())
}
