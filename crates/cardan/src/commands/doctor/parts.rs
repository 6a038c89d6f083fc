//! The parts of the system that some command or test uses.

use std::fmt;
use std::path::Path;

use serde::Serialize;

use super::shared_memory;
use crate::toolchain::{self, BOARDS, Candidate, Runs, first_line, runs};

/// What a part is needed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Need {
    /// The main job.
    Compare,
    /// Cross-compiling: `build`, and `--wordlengths`.
    Build,
    /// The repository's own tests.
    Tests,
}

impl Need {
    /// The heading of its section.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Compare => "Needed to compare:",
            Self::Build => "Optional, to cross-compile (cardan build, --wordlengths):",
            Self::Tests => "Optional, for this repository's tests (cargo xtask test):",
        }
    }
}

/// A part of the system.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Part {
    name: &'static str,
    pub(super) needed_for: Need,
    present: bool,
    /// Version, or what was found.
    version: Option<String>,
    /// What is wrong if it is not present.
    problem: Option<String>,
    purpose: &'static str,
    /// The command that installs it if it is not present.
    install: Option<String>,
    /// Debian packages of that command.
    pub(super) packages: Vec<&'static str>,
}

impl Part {
    /// A part that was looked for: its version, or what is wrong.
    fn new(
        name: &'static str,
        needed_for: Need,
        purpose: &'static str,
        found: Result<String, String>,
        install: Install,
    ) -> Self {
        let (version, problem) = match found {
            Ok(version) => (Some(version), None),
            Err(problem) => (None, Some(problem)),
        };
        let present = problem.is_none();
        let (install, packages) = match install {
            _ if present => (None, Vec::new()),
            Install::Packages(packages) => {
                let command = format!("sudo apt-get install {}", packages.join(" "));
                (Some(command), packages.to_vec())
            }
            Install::Command(command) => (Some(command.to_owned()), Vec::new()),
        };
        Self {
            name,
            needed_for,
            present,
            version,
            problem,
            purpose,
            install,
            packages,
        }
    }

    /// Whether it is there.
    pub(super) fn is_present(&self) -> bool {
        self.present
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (mark, found) = match &self.problem {
            None => ("  ok     ", self.version.as_deref().unwrap_or_default()),
            Some(problem) => ("  MISSING", problem.as_str()),
        };
        write!(
            f,
            "{mark} {:<17} {found}\n{:28}{}",
            self.name, "", self.purpose
        )?;
        match &self.install {
            Some(install) => write!(f, "\n{:28}install: {install}", ""),
            None => Ok(()),
        }
    }
}

/// How a part is installed.
enum Install {
    Packages(&'static [&'static str]),
    Command(&'static str),
}

/// Looks for every part.
pub(super) fn all() -> Vec<Part> {
    let mut parts = vec![
        Part::new(
            "shared memory",
            Need::Compare,
            "golden model, native firmware and emulator meet in it (iceoryx2)",
            shared_memory::examine(),
            Install::Command("mount -t tmpfs tmpfs /dev/shm   (in a container: --shm-size=256m)"),
        ),
        Part::new(
            "rust",
            Need::Build,
            "builds Cardan itself, and runs cross builds",
            program("cargo", &["--version"]),
            Install::Command("rustup toolchain install stable"),
        ),
        avr_rust(),
    ];
    parts.extend(avr_tools());
    parts.extend(other_boards());
    parts.extend(test_tools());
    parts
}

fn avr_rust() -> Part {
    Part::new(
        "rust for AVR",
        Need::Build,
        "compiles the firmware: a compiler with its library's sources. Debian's, or a nightly: \
         rustup toolchain install nightly --component rust-src",
        compiler(BOARDS[0].triple),
        Install::Packages(&["rustc-web", "rust-web-src"]),
    )
}

/// The compiler for a target, or what is wrong with each.
fn compiler(triple: &str) -> Result<String, String> {
    let candidates = toolchain::compilers(triple);
    let found = candidates.iter().find_map(|candidate| {
        let rust = candidate.found.as_ref().ok()?;
        Some(format!("{} ({})", rust.version, candidate.origin))
    });
    found.ok_or_else(|| {
        let problems = candidates.iter().filter_map(|Candidate { origin, found }| {
            let problem = found.as_ref().err()?;
            Some(format!("{origin}: {problem}"))
        });
        problems.collect::<Vec<_>>().join("; ")
    })
}

/// What the boards with ARM and RISC-V need.
fn other_boards() -> [Part; 4] {
    let boards = BOARDS.iter().filter(|board| board.runs_in == Runs::Qemu);
    let compilers: Result<Vec<String>, String> =
        boards.map(|board| compiler(board.triple)).collect();
    [
        Part::new(
            "rust ARM, RISC-V",
            Need::Build,
            "compiles the firmware for cortex-m0plus, cortex-m4, rv32imc: as for AVR, or `rustup \
             target add`",
            compilers.map(|mut versions| versions.swap_remove(0)),
            Install::Packages(&["rustc-web", "rust-web-src"]),
        ),
        Part::new(
            "lld",
            Need::Build,
            "links programs for ARM and RISC-V",
            toolchain::lld().map(|lld| lld.version),
            Install::Packages(&["lld"]),
        ),
        Part::new(
            "qemu for ARM",
            Need::Build,
            "runs programs for ARM (QEMU has no Cortex-M0+: a Cortex-M0)",
            program("qemu-system-arm", &["--version"]),
            Install::Packages(&["qemu-system-arm"]),
        ),
        Part::new(
            "qemu for RISC-V",
            Need::Build,
            "runs programs for RISC-V",
            program("qemu-system-riscv32", &["--version"]),
            Install::Packages(&["qemu-system-misc"]),
        ),
    ]
}

fn avr_tools() -> [Part; 3] {
    let start = "-print-file-name=crtatmega328p.o";
    let start = first_line("avr-gcc", &["-mmcu=atmega328p", start]);
    let libc = start.filter(|file| Path::new(file).is_absolute());
    [
        Part::new(
            "avr-gcc",
            Need::Build,
            "links the firmware; compiles C test programs",
            program("avr-gcc", &["--version"]),
            Install::Packages(&["gcc-avr"]),
        ),
        Part::new(
            "avr binutils",
            Need::Build,
            "links the firmware and strips images",
            program("avr-objcopy", &["--version"]),
            Install::Packages(&["binutils-avr"]),
        ),
        Part::new(
            "avr-libc",
            Need::Build,
            "start-up code and interrupt vectors of images",
            libc.ok_or_else(|| "not there".to_owned()),
            Install::Packages(&["avr-libc"]),
        ),
    ]
}

fn test_tools() -> [Part; 10] {
    [
        Part::new(
            "gcc",
            Need::Tests,
            "compiles simavr's side of the lockstep tests",
            program("gcc", &["--version"]),
            Install::Packages(&["gcc"]),
        ),
        Part::new(
            "simavr",
            Need::Tests,
            "another AVR simulator, an oracle for the emulator",
            match runs("sh", &["-c", "command -v simavr"]) {
                true => Ok(package_version("simavr").unwrap_or("found".to_owned())),
                false => Err("not there".to_owned()),
            },
            Install::Packages(&["simavr"]),
        ),
        Part::new(
            "libsimavr",
            Need::Tests,
            "the same as a library, run in lockstep",
            header("simavr/sim_avr.h", "libsimavr-dev"),
            Install::Packages(&["libsimavr-dev"]),
        ),
        Part::new(
            "libelf",
            Need::Tests,
            "libsimavr's headers need it",
            header("libelf.h", "libelf-dev"),
            Install::Packages(&["libelf-dev"]),
        ),
        Part::new(
            "avr-gdb",
            Need::Tests,
            "debugs programs in the emulator (run --gdb)",
            program("avr-gdb", &["--version"]),
            Install::Packages(&["gdb-avr"]),
        ),
        Part::new(
            "python oracles",
            Need::Tests,
            "scipy checks the analog models, apytypes the arithmetic (CARDAN_PYTHON names another \
             interpreter)",
            python(),
            Install::Command(
                "python3 -m venv target/venv && target/venv/bin/pip install numpy scipy apytypes \
                 && export CARDAN_PYTHON=$PWD/target/venv/bin/python",
            ),
        ),
        Part::new(
            "lcov",
            Need::Tests,
            "opens the coverage that `run --profile-out` writes",
            program("genhtml", &["--version"]),
            Install::Packages(&["lcov"]),
        ),
        Part::new(
            "gtkwave",
            Need::Tests,
            "reads the waveforms that `run --vcd` writes",
            match runs("sh", &["-c", "command -v vcd2fst && command -v fst2vcd"]) {
                true => Ok(package_version("gtkwave").unwrap_or("found".to_owned())),
                false => Err("not there".to_owned()),
            },
            Install::Packages(&["gtkwave"]),
        ),
        Part::new(
            "icarus verilog",
            Need::Tests,
            "writes waveforms that `run --stimulus` reads",
            program("iverilog", &["-V"]),
            Install::Packages(&["iverilog"]),
        ),
        Part::new(
            "chromium",
            Need::Tests,
            "opens report pages as a reader would",
            program("chromium", &["--version"]),
            Install::Packages(&["chromium"]),
        ),
    ]
}

fn program(name: &str, arguments: &[&str]) -> Result<String, String> {
    first_line(name, arguments).ok_or_else(|| "not there".to_owned())
}

/// A C header that `gcc` finds.
fn header(name: &str, package: &str) -> Result<String, String> {
    let found = runs("gcc", &["-E", "-include", name, "-x", "c", "/dev/null"]);
    match found {
        true => Ok(package_version(package).unwrap_or("found".to_owned())),
        false => Err(format!("gcc does not find {name}")),
    }
}

fn package_version(package: &str) -> Option<String> {
    first_line("dpkg-query", &["-W", "-f=${Version}", package])
}

fn python() -> Result<String, String> {
    let python = std::env::var_os("CARDAN_PYTHON").unwrap_or("python3".into());
    let shown = Path::new(&python).display().to_string();
    let script = "import sys, numpy, scipy, apytypes; print(sys.version.split()[0], 'numpy', \
                  numpy.__version__, 'scipy', scipy.__version__, 'apytypes', apytypes.__version__)";
    if !runs(&python, &["--version"]) {
        return Err(format!("{shown} is not there"));
    }
    first_line(&python, &["-c", script])
        .ok_or_else(|| format!("{shown} lacks numpy, scipy or apytypes"))
}
