//! What a comparison runs: the options that its participants share, and their resolution.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hasher as _};
use std::path::{Path, PathBuf};

use cardan_bench::App;
use cardan_bench::app::by_name;
use cardan_bench::image::Firmware;
use cardan_datapath::wordlengths::{self, Tuned};
use cardan_datapath::{Format, table_hash};
use cardan_scenario::scenario::MotionKind;
use cardan_scenario::third_tilt;
use cardan_scenario::tolerance::Tolerance;
use cardan_scenario::{Scenario, Trajectory, print_scenario};
use clap::Args;

mod stale;

use crate::arguments::Arguments;
use crate::eeprom_file;
use crate::failure::Failure;
use crate::files::{self, Plan};
use crate::output::Output;
use crate::toolchain::{self, BOARDS, Checkout};

/// Name of the image that is part of this program.
pub(crate) const BUNDLED_IMAGE: &str = "bundled image";

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
    /// Build the image from the checkout that this is run in, and emulate that
    #[arg(long, conflicts_with = "firmware")]
    pub(crate) build: bool,
    /// Checkout of Cardan's repository whose firmware is built and, by `tune --apply`, changed, instead of the
    /// one around the current folder
    #[arg(long, value_name = "DIR")]
    pub(crate) checkout: Option<PathBuf>,
    /// Content of the device's EEPROM (.hex, .eep or .bin, as `calibrate --out` writes it) instead of
    /// the scenario's calibration
    #[arg(long, value_name = "FILE")]
    pub(crate) eeprom: Option<PathBuf>,
    /// Other formats: native runs in them, and the image is cross-compiled with them
    #[arg(long, value_name = "FILE")]
    pub(crate) wordlengths: Option<PathBuf>,
    /// Simulated seconds (a recording may end the run earlier)
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub(crate) seconds: Option<f64>,
    /// Gives a number of the scenario another value (any numeric key of --print-scenario with its table,
    /// limits as tolerance.truth.rms_deg or tolerance.nodes.NODE too), turns the switch noise.enabled to
    /// true or false, or sensors.third_tilt to measured, comparator or absent; may be repeated
    #[arg(long, value_name = "KEY=VALUE", value_parser = setting)]
    pub(crate) set: Vec<(String, f64)>,
    /// Seed of every random number
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        allow_negative_numbers = true
    )]
    pub(crate) seed: u64,
}

/// An application, the formats that replace the deployed ones, and the hash of those in use.
pub(crate) type AppAndFormats = (&'static dyn App, Option<Vec<Format>>, u64);

/// The resolved run.
#[derive(Clone)]
pub(crate) struct Setup {
    pub(crate) app: &'static dyn App,
    pub(crate) scenario: Scenario,
    pub(crate) firmware: Firmware,
    /// Formats of the native run when they are not the deployed ones.
    pub(crate) formats: Option<Vec<Format>>,
    /// What the checkout says of image and program, where its firmware is another.
    pub(crate) stale: Option<String>,
    /// Whether each node's share of the rounding is computed.
    pub(crate) shares: bool,
    /// Why the limits of the bundled scenario do not apply.
    pub(crate) not_judged: Option<String>,
    /// Keys of the limits that were stated for this run, which stay as they are however long it is.
    pub(crate) stated: Vec<String>,
    /// What the formats were tuned to, as their file says.
    pub(crate) tuned: Option<Tuned>,
    /// Hash of the formats in use.
    pub(crate) formats_hash: u64,
    pub(crate) seconds: f64,
    pub(crate) seed: u64,
}

impl RunOptions {
    /// The files that are read.
    pub(crate) fn inputs(&self) -> Plan {
        Plan::default()
            .input("--scenario", Some(Path::new(&self.scenario)))
            .input("--recording", self.recording.as_deref())
            .input("--firmware", self.firmware.as_deref())
            .input("--eeprom", self.eeprom.as_deref())
            .input("--wordlengths", self.wordlengths.as_deref())
    }

    /// Everything but the image: what a participant without hardware needs.
    pub(crate) fn app_and_formats(&self) -> Result<AppAndFormats, Failure> {
        let app = by_name(&self.app).map_err(Failure::input)?;
        let Some(file) = &self.wordlengths else {
            return Ok((app, None, app.formats_hash()));
        };
        let (formats, _) = read_wordlengths(file, app)?;
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

    /// Reads and checks all inputs; the image has taps.
    pub(crate) fn resolve(&self) -> Result<Setup, Failure> {
        self.resolve_with(true)
    }

    /// The same with the image that is delivered: it tells what its frames say.
    pub(crate) fn resolve_plain(&self) -> Result<Setup, Failure> {
        self.resolve_with(false)
    }

    fn resolve_with(&self, tapped: bool) -> Result<Setup, Failure> {
        let (app, formats, formats_hash) = self.app_and_formats()?;
        let tuned = match &self.wordlengths {
            Some(file) => read_wordlengths(file, app)?.1,
            None => None,
        };
        let (scenario, changed) = self.changed_scenario()?;
        check_nodes(&scenario, app)?;
        let seconds = self.seconds_of(&scenario)?;
        let mut firmware = self.firmware(app, formats.as_deref(), tapped)?;
        firmware.eeprom = self.eeprom.as_deref().map(eeprom_file::read).transpose()?;
        let mut table = app.nodes().to_vec();
        for (node, format) in table.iter_mut().zip(formats.iter().flatten()) {
            node.format = *format;
        }
        let stale = stale::told(self, &firmware)?;
        firmware
            .check_formats(&table, formats_hash)
            .map_err(|error| match &stale {
                Some(what) => Failure::input(format!("{error}\n{what}")),
                None => Failure::input(error),
            })?;
        Ok(Setup {
            shares: true,
            stale,
            app,
            scenario,
            firmware,
            formats,
            tuned,
            not_judged: changed,
            stated: self.set.iter().map(|(key, _)| key.clone()).collect(),
            formats_hash,
            seconds,
            seed: self.seed,
        })
    }

    /// How long the run is.
    ///
    /// # Errors
    /// No admissible length.
    pub(crate) fn seconds_of(&self, scenario: &Scenario) -> Result<f64, Failure> {
        let seconds = self.seconds.unwrap_or(scenario.seconds);
        if seconds.is_finite() && seconds > 0.0 && seconds <= MOST_SECONDS {
            return Ok(seconds);
        }
        Err(Failure::input(format!(
            "--seconds {seconds:?}: expected a number above 0 and at most {MOST_SECONDS:e}"
        )))
    }

    /// Files that are named and not there are told also where nothing is read from them.
    pub(crate) fn check_files(&self) -> Result<(), Failure> {
        let files = [
            ("--recording", &self.recording),
            ("--firmware", &self.firmware),
            ("--eeprom", &self.eeprom),
            ("--wordlengths", &self.wordlengths),
        ];
        for (option, file) in files {
            if let Some(file) = file.as_ref().filter(|file| !file.exists()) {
                let file = file.display();
                return Err(Failure::input(format!(
                    "{option} {file}: there is no such file"
                )));
            }
        }
        Ok(())
    }

    /// The scenario as the other options make it; and why the limits of the bundled one do not apply.
    pub(crate) fn changed_scenario(&self) -> Result<(Scenario, Option<String>), Failure> {
        let mut scenario = Scenario::load(&self.scenario).map_err(Failure::input)?;
        let changed = self.changed_limits(&scenario);
        if self.is_changed(&scenario) {
            scenario.tolerance = Tolerance::default();
        }
        if let Some(file) = &self.recording {
            scenario = scenario.with_recording(file);
            if let Some(name) = file.file_name() {
                scenario.name = name.to_string_lossy().into_owned();
            }
        }
        for (key, value) in &self.set {
            scenario.set(key, *value).map_err(Failure::input)?;
        }
        scenario.check().map_err(Failure::input)?;
        Ok((scenario, changed))
    }

    /// What of a bundled scenario is replaced.
    fn changes(&self, scenario: &Scenario) -> Vec<&str> {
        if !scenario.is_bundled() {
            return Vec::new();
        }
        let set = self.set.iter().map(|(key, _)| key.as_str());
        let set = set.filter(|key| !Scenario::keeps_limits(key));
        let recording = self.recording.iter().map(|_| "--recording");
        recording.chain(set).collect()
    }

    /// Whether the limits of the bundled scenario hold no longer.
    fn is_changed(&self, scenario: &Scenario) -> bool {
        !self.changes(scenario).is_empty()
    }

    /// Which limits are not applied, since the bundled scenario to which they belong is changed.
    fn changed_limits(&self, scenario: &Scenario) -> Option<String> {
        let changed = self.changes(scenario);
        // What is stated for this very run is judged all the same.
        let is_stated = |table: &str| self.set.iter().any(|(key, _)| key.starts_with(table));
        let groups = [
            ("truth", "tolerance.truth."),
            ("stages", "tolerance.stages."),
            ("channels", "tolerance.channels."),
            ("flagged share", "tolerance.status."),
        ];
        let open = groups.iter().filter(|(_, table)| !is_stated(table));
        let open: Vec<&str> = open.map(|(name, _)| *name).collect();
        (!changed.is_empty() && !open.is_empty()).then(|| {
            format!(
                "{}, whose limits belong to the bundled scenario without {}; state limits with --set \
                 tolerance.truth.rms_deg=... or a scenario file",
                open.join(", "),
                changed.join(", ")
            )
        })
    }

    /// The image to emulate; one that has to be built for other formats is cached by their hash.
    fn firmware(
        &self,
        app: &'static dyn App,
        formats: Option<&[Format]>,
        tapped: bool,
    ) -> Result<Firmware, Failure> {
        let parse = |name: &str, bytes: &[u8]| Firmware::parse(name, bytes).map_err(Failure::input);
        match (&self.firmware, formats) {
            (Some(file), _) => parse(&file.display().to_string(), &read(file)?),
            (None, formats) if formats.is_some() || self.build => {
                let declared = formats.map(|formats| toolchain::declared(app.nodes(), formats));
                let checkout = self.sources()?;
                let declared = declared.as_deref();
                let built = toolchain::build_board(&checkout, &BOARDS[0], tapped, declared, true)?;
                parse(&built.file.display().to_string(), &built.elf)
            }
            (None, _) => {
                let bytes = app.bundled(tapped).ok_or_else(|| {
                    let name = app.name();
                    Failure::input(format!("application {name} has no image; give --firmware"))
                })?;
                parse(BUNDLED_IMAGE, bytes)
            }
        }
    }

    /// The firmware sources that an image is built from.
    fn sources(&self) -> Result<Checkout, Failure> {
        let named = self.checkout.as_deref();
        if self.build {
            Checkout::to_write(named, "--build")
        } else {
            Checkout::to_read(named)
        }
    }

    /// Says from which sources an image is built, and into which folder, where one is.
    pub(crate) fn announce_build(&self, output: Output) -> Result<(), Failure> {
        let is_built =
            self.firmware.is_none() && (self.build || self.app_and_formats()?.1.is_some());
        if is_built {
            output.note(&self.sources()?.told()?);
        }
        Ok(())
    }

    /// The same options with the image that was resolved, so that no child builds it again.
    pub(crate) fn with_image_of(&self, setup: &Setup) -> Self {
        // The name is for people; a file keeps the one that it has.
        let built = (setup.firmware.name != BUNDLED_IMAGE).then(|| (&setup.firmware.name).into());
        let firmware = self.firmware.clone().or(built);
        Self {
            firmware,
            build: false,
            ..self.clone()
        }
    }

    /// The options as arguments with the checkout, for children and for commands on this machine.
    pub(crate) fn arguments_here(&self) -> Arguments {
        let mut arguments = self.arguments();
        arguments.give_some("--checkout", self.checkout.as_ref());
        arguments
    }

    /// The options as arguments: all that the result depends on.
    pub(crate) fn arguments(&self) -> Arguments {
        let mut arguments = Arguments::default();
        arguments.give("--app", &self.app);
        arguments.give("--scenario", &self.scenario);
        arguments.give("--seed", self.seed.to_string());
        let files = [
            ("--recording", &self.recording),
            ("--firmware", &self.firmware),
            ("--eeprom", &self.eeprom),
            ("--wordlengths", &self.wordlengths),
        ];
        for (name, file) in files {
            arguments.give_some(name, file.as_ref());
        }
        arguments.give_some("--seconds", self.seconds.map(|seconds| seconds.to_string()));
        for (key, value) in &self.set {
            arguments.give("--set", format!("{key}={value}"));
        }
        arguments
    }
}

/// Limits of single nodes are of nodes that there are.
fn check_nodes(scenario: &Scenario, app: &dyn App) -> Result<(), Failure> {
    let names = || app.nodes().iter().map(|node| node.name);
    let mut stated = scenario.tolerance.nodes.keys();
    let Some(node) = stated.find(|node| !names().any(|name| name == node.as_str())) else {
        return Ok(());
    };
    let near = names()
        .map(|name| (strsim::jaro_winkler(name, node), name))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or("", |(_, name)| name);
    Err(Failure::input(format!(
        "tolerance.nodes.{node}: the application {} has no such node; did you mean '{near}'? (all: \
         cardan compare --explain all)",
        app.name()
    )))
}

/// How fast a comparison runs against the simulated time, roughly (docs/measured.md).
const SPEED: f64 = 20.0;
/// Runs that take longer, in seconds, say so before they begin.
const LONG_S: f64 = 120.0;

impl Setup {
    /// What is to be run, by option: participants that are started by hand must agree in it.
    pub(crate) fn request(&self) -> BTreeMap<String, String> {
        let digest = |bytes: &[u8]| {
            let mut hasher = DefaultHasher::new();
            hasher.write(bytes);
            format!("{:016x}", hasher.finish())
        };
        let image = &self.firmware.image;
        let eeprom = self.firmware.eeprom.as_ref();
        let eeprom = eeprom.map_or_else(|| "none".to_owned(), |given| digest(&given.bytes));
        let recording = self.scenario.motion.recording.file.as_deref();
        let recording = recording.map(|file| std::fs::read(file).unwrap_or_default());
        let recording = recording.map_or_else(|| "none".to_owned(), |bytes| digest(&bytes));
        BTreeMap::from([
            ("--recording".to_owned(), recording),
            ("--scenario".to_owned(), print_scenario(&self.scenario)),
            ("--seed".to_owned(), self.seed.to_string()),
            ("--seconds".to_owned(), self.seconds.to_string()),
            ("--firmware".to_owned(), digest(&image.flash)),
            ("--eeprom".to_owned(), eeprom),
        ])
    }

    /// The emulated participant runs what this one judges.
    ///
    /// # Errors
    /// It was asked for something else.
    pub(crate) fn check_request(&self, theirs: &BTreeMap<String, String>) -> Result<(), Failure> {
        for (option, ours) in self.request() {
            let theirs = theirs.get(&option).map_or("", String::as_str);
            if ours == theirs {
                continue;
            }
            let mut lines = theirs.lines().zip(ours.lines());
            let (theirs, ours) = lines.find(|(a, b)| a != b).unwrap_or((theirs, &ours));
            return Err(Failure::input(format!(
                "{option}: 'emulate' and 'diff' were asked for different runs: emulate {theirs}, diff \
                 {ours}; give both the same options"
            )));
        }
        Ok(())
    }

    /// Says what the user should know before a long wait: gaps of a recording, and how long it takes.
    pub(crate) fn announce(&self, output: Output) -> Result<(), Failure> {
        let mut seconds = self.seconds;
        if self.scenario.motion.kind == MotionKind::Recording {
            let trajectory = Trajectory::new(&self.scenario, self.seed).map_err(Failure::input)?;
            if let Some(remark) = trajectory.remark() {
                output.note(&format!("warning: {remark}"));
            }
            seconds = trajectory
                .duration_s()
                .map_or(seconds, |end| end.min(seconds));
        }
        if seconds / SPEED > LONG_S {
            let minutes = (seconds / SPEED / 60.0).ceil();
            output.note(&format!(
                "this run simulates {seconds:.0} s: about {minutes} minutes (at {SPEED} times real time); \
                 --seconds S makes it shorter"
            ));
        }
        Ok(())
    }
}

/// `KEY=VALUE` of `--set`; whether there is such a parameter shows when the scenario is read.
fn setting(text: &str) -> Result<(String, f64), String> {
    let expected = || {
        "expected KEY=VALUE with a finite number, for example climate.start_k=358.15; what is a text \
         (motion.kind, field.site) is set in a scenario file: --print-scenario > mine.toml, --scenario mine.toml"
            .to_owned()
    };
    let (key, value) = text.split_once('=').ok_or_else(expected)?;
    let (key, value) = (key.trim(), value.trim());
    if key.is_empty() {
        return Err(expected());
    }
    let word = || third_tilt::named(value).map(|kind| f64::from(kind as u8));
    let value = match value {
        "true" => Some(1.0),
        "false" => Some(0.0),
        number => number.parse().ok().filter(|value: &f64| value.is_finite()),
    };
    if key == third_tilt::KEY {
        let expected = || format!("expected {}", third_tilt::EXPECTED);
        return Ok((key.to_owned(), value.or_else(word).ok_or_else(expected)?));
    }
    Ok((key.to_owned(), value.ok_or_else(expected)?))
}

fn read(file: &Path) -> Result<Vec<u8>, Failure> {
    files::read(file)
}

fn read_wordlengths(
    file: &Path,
    app: &'static dyn App,
) -> Result<(Vec<Format>, Option<Tuned>), Failure> {
    let name = file.display().to_string();
    let text = String::from_utf8(read(file)?)
        .map_err(|_| Failure::input(format!("{name}: expected TOML in UTF-8")))?;
    let declared = wordlengths::parse_all(&text, &name).map_err(Failure::input)?;
    let formats =
        wordlengths::align(&declared.nodes, app.nodes(), &name).map_err(Failure::input)?;
    Ok((formats, declared.tuned))
}
