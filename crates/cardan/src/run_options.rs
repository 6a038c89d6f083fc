//! What a comparison runs: the options that its participants share, and their resolution.

use std::path::{Path, PathBuf};

use cardan_bench::App;
use cardan_bench::app::by_name;
use cardan_bench::image::Firmware;
use cardan_datapath::{Format, table_hash, wordlengths};
use cardan_scenario::Scenario;
use clap::Args;

use crate::failure::Failure;

/// Longest run in simulated seconds.
const MOST_SECONDS: f64 = 1e6;

/// The run: application, scenario, firmware, length, seed.
#[derive(Args, Clone, Debug)]
pub(crate) struct RunOptions {
    /// Application: the algorithm with its golden model, board and sensors
    #[arg(long, value_name = "NAME", default_value = "attitude")]
    pub(crate) app: String,
    /// Bundled scenario or scenario file (TOML; see --print-scenario)
    #[arg(long, value_name = "NAME|FILE", default_value = "tumble")]
    pub(crate) scenario: String,
    /// Recorded motion instead of the scenario's
    #[arg(long, value_name = "CSV[.gz]")]
    pub(crate) recording: Option<PathBuf>,
    /// Firmware to emulate instead of the bundled ATmega328P image
    #[arg(long, value_name = "ELF")]
    pub(crate) firmware: Option<PathBuf>,
    /// Other formats: native runs in them, and the image is cross-compiled with them
    #[arg(long, value_name = "FILE")]
    pub(crate) wordlengths: Option<PathBuf>,
    /// Simulated seconds (a recording may end the run earlier)
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub(crate) seconds: Option<f64>,
    /// Seed of every random number
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(crate) seed: u64,
}

/// The resolved run.
pub(crate) struct Setup {
    pub(crate) app: &'static dyn App,
    pub(crate) scenario: Scenario,
    pub(crate) firmware: Firmware,
    /// Formats of the native run when they are not the deployed ones.
    pub(crate) formats: Option<Vec<Format>>,
    /// Hash of the formats in use.
    pub(crate) formats_hash: u64,
    pub(crate) seconds: f64,
    pub(crate) seed: u64,
}

impl RunOptions {
    /// Everything but the image: what a participant without hardware needs.
    pub(crate) fn app_and_formats(
        &self,
    ) -> Result<(&'static dyn App, Option<Vec<Format>>, u64), Failure> {
        let app = by_name(&self.app).map_err(Failure::input)?;
        let Some(file) = &self.wordlengths else {
            return Ok((app, None, app.formats_hash()));
        };
        let formats = read_wordlengths(file, app)?;
        let mut table = app.nodes().to_vec();
        for (node, format) in table.iter_mut().zip(&formats) {
            node.format = *format;
        }
        let hash = table_hash(&table);
        if hash == app.formats_hash() {
            return Ok((app, None, hash));
        }
        Ok((app, Some(formats), hash))
    }

    /// Reads and checks all inputs.
    pub(crate) fn resolve(&self) -> Result<Setup, Failure> {
        let (app, formats, formats_hash) = self.app_and_formats()?;
        let mut scenario = Scenario::load(&self.scenario).map_err(Failure::input)?;
        if let Some(file) = &self.recording {
            scenario = scenario.with_recording(file);
        }
        let seconds = self.seconds.unwrap_or(scenario.seconds);
        if !(seconds.is_finite() && seconds > 0.0 && seconds <= MOST_SECONDS) {
            return Err(Failure::input(format!(
                "--seconds {seconds}: expected a number above 0 and at most {MOST_SECONDS:e}"
            )));
        }
        let firmware = self.firmware(app, formats.is_some())?;
        let mut table = app.nodes().to_vec();
        for (node, format) in table.iter_mut().zip(formats.iter().flatten()) {
            node.format = *format;
        }
        firmware
            .check_formats(&table, formats_hash)
            .map_err(Failure::input)?;
        Ok(Setup {
            app,
            scenario,
            firmware,
            formats,
            formats_hash,
            seconds,
            seed: self.seed,
        })
    }

    fn firmware(&self, app: &'static dyn App, other_formats: bool) -> Result<Firmware, Failure> {
        let parse = |name: &str, bytes: &[u8]| Firmware::parse(name, bytes).map_err(Failure::input);
        match (&self.firmware, &self.wordlengths) {
            (Some(file), _) => parse(&file.display().to_string(), &read(file)?),
            (None, Some(wordlengths)) if other_formats => Err(Failure::input(format!(
                "{}: the bundled image has other formats; give --firmware with an image that \
                     was built with this file",
                wordlengths.display()
            ))),
            (None, _) => {
                let bytes = app.bundled(true).ok_or_else(|| {
                    Failure::input(format!(
                        "application {} has no image; give --firmware",
                        app.name()
                    ))
                })?;
                parse("bundled image", bytes)
            }
        }
    }

    /// The options as arguments for a child process.
    pub(crate) fn arguments(&self) -> Vec<std::ffi::OsString> {
        let mut arguments: Vec<std::ffi::OsString> = Vec::new();
        let mut give = |name: &str, value: std::ffi::OsString| {
            arguments.extend([name.into(), value]);
        };
        give("--app", (&self.app).into());
        give("--scenario", (&self.scenario).into());
        give("--seed", self.seed.to_string().into());
        let files = [
            ("--recording", &self.recording),
            ("--firmware", &self.firmware),
            ("--wordlengths", &self.wordlengths),
        ];
        for (name, file) in files {
            if let Some(file) = file {
                give(name, file.into());
            }
        }
        if let Some(seconds) = self.seconds {
            give("--seconds", seconds.to_string().into());
        }
        arguments
    }
}

fn read(file: &Path) -> Result<Vec<u8>, Failure> {
    std::fs::read(file)
        .map_err(|error| Failure::input(format!("{}: cannot be read: {error}", file.display())))
}

fn read_wordlengths(file: &Path, app: &'static dyn App) -> Result<Vec<Format>, Failure> {
    let name = file.display().to_string();
    let text = String::from_utf8(read(file)?)
        .map_err(|_| Failure::input(format!("{name}: expected TOML in UTF-8")))?;
    let declared = wordlengths::parse(&text, &name).map_err(Failure::input)?;
    wordlengths::align(&declared, app.nodes(), &name).map_err(Failure::input)
}
