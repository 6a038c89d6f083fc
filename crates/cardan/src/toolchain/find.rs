//! Finds a Rust compiler that can build for AVR, and the linker and C library it needs.
//!
//! AVR has no precompiled core library, so the compiler's own sources must be there. Looked for in
//! this order: `CARDAN_AVR_RUSTC`, Debian's `rustc-web` with `rust-web-src`, a rustup nightly with
//! `rust-src`.

use std::fmt;
use std::path::{Path, PathBuf};

use super::probe::{first_line, output};
use super::record::Versions;

/// Names another compiler.
const OVERRIDE: &str = "CARDAN_AVR_RUSTC";
/// Debian's compiler.
const DEBIAN: &str = "/usr/bin/rustc";
/// Installs what AVR builds need on Debian.
const INSTALL_RUST: &str = "apt-get install rustc-web rust-web-src";
const INSTALL_GCC: &str = "apt-get install gcc-avr binutils-avr avr-libc";

/// A compiler for AVR with all that it needs.
#[derive(Clone, Debug)]
pub(crate) struct Compiler {
    /// `rustc`.
    pub(super) rustc: PathBuf,
    /// `cargo`.
    pub(super) cargo: PathBuf,
    /// Sources of the core library.
    pub(super) library: PathBuf,
    /// Versions of all parts.
    pub(crate) versions: Versions,
}

/// Why there is no AVR toolchain.
#[derive(Debug)]
pub(crate) struct Missing(Vec<String>);

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "cross-compiling for AVR needs a toolchain that is not there:"
        )?;
        for line in &self.0 {
            writeln!(f, "  {line}")?;
        }
        write!(
            f,
            "`cardan doctor` shows what is installed and what each part is for"
        )
    }
}

/// A place where a compiler was looked for.
#[derive(Clone, Debug)]
pub(crate) struct Candidate {
    /// Where it comes from.
    pub(crate) origin: &'static str,
    /// The compiler, and whether it can build for AVR.
    pub(crate) found: Result<Rust, String>,
}

/// A Rust compiler that can build for AVR.
#[derive(Clone, Debug)]
pub(crate) struct Rust {
    rustc: PathBuf,
    cargo: PathBuf,
    library: PathBuf,
    /// Version line.
    pub(crate) version: String,
    llvm: String,
}

/// The first compiler that can build for AVR, with linker and C library.
pub(crate) fn find() -> Result<Compiler, Missing> {
    let mut missing = Vec::new();
    let candidates = compilers();
    let rust = candidates.iter().find_map(|candidate| {
        let rust = candidate.found.as_ref().ok()?;
        Some(rust.clone())
    });
    if rust.is_none() {
        for Candidate { origin, found } in &candidates {
            if let Err(problem) = found {
                missing.push(format!("{origin}: {problem}"));
            }
        }
        missing.push(format!("install one, for example: {INSTALL_RUST}"));
    }
    let gcc = Gcc::find();
    if let Err(problem) = &gcc {
        missing.push(format!("{problem}; install it: {INSTALL_GCC}"));
    }
    match (rust, gcc) {
        (Some(rust), Ok(gcc)) => Ok(rust.with(gcc)),
        _ => Err(Missing(missing)),
    }
}

/// Every place where a compiler may be, in the order of preference.
pub(crate) fn compilers() -> Vec<Candidate> {
    if let Some(rustc) = std::env::var_os(OVERRIDE) {
        let found = Rust::examine(Path::new(&rustc), None);
        return vec![Candidate {
            origin: OVERRIDE,
            found,
        }];
    }
    let nightly = first_line("rustup", &["which", "--toolchain", "nightly", "rustc"]);
    let nightly = match nightly {
        Some(rustc) => {
            let cargo = Path::new(&rustc).with_file_name("cargo");
            Rust::examine(Path::new(&rustc), Some(cargo))
        }
        None => Err("not installed".to_owned()),
    };
    vec![
        Candidate {
            origin: "Debian's rustc-web",
            found: Rust::examine(Path::new(DEBIAN), None),
        },
        Candidate {
            origin: "rustup's nightly",
            found: nightly,
        },
    ]
}

impl Rust {
    /// Checks that `rustc` knows the target and has its library's sources.
    fn examine(rustc: &Path, cargo: Option<PathBuf>) -> Result<Self, String> {
        let shown = rustc.display();
        let verbose = output(rustc.as_os_str(), &["-vV"])
            .ok_or_else(|| format!("{shown} is not there or does not run"))?;
        let targets = output(rustc.as_os_str(), &["--print", "target-list"]).unwrap_or_default();
        if !targets.lines().any(|target| target == "avr-none") {
            return Err(format!(
                "{shown} does not know the target avr-none; needs Rust 1.88"
            ));
        }
        let sysroot = first_line(rustc, &["--print", "sysroot"]).unwrap_or_default();
        let library = Path::new(&sysroot).join("lib/rustlib/src/rust");
        if !library.join("library/Cargo.lock").is_file() {
            return Err(format!(
                "{shown} has no library sources (rust-web-src, or `rustup component add rust-src \
                 --toolchain nightly`)"
            ));
        }
        Ok(Self {
            rustc: rustc.to_owned(),
            cargo: cargo
                .filter(|cargo| cargo.is_file())
                .unwrap_or_else(default_cargo),
            library,
            version: verbose.lines().next().unwrap_or_default().to_owned(),
            llvm: field(&verbose, "LLVM version: "),
        })
    }

    fn with(self, gcc: Gcc) -> Compiler {
        let versions = Versions {
            rustc: self.version,
            llvm: self.llvm,
            cargo: first_line(&self.cargo, &["--version"]).unwrap_or_default(),
            avr_gcc: gcc.version,
            binutils: gcc.binutils,
            avr_libc: gcc.libc,
        };
        Compiler {
            rustc: self.rustc,
            cargo: self.cargo,
            library: self.library,
            versions,
        }
    }
}

/// The cargo that runs us, or the one on the path.
fn default_cargo() -> PathBuf {
    std::env::var_os("CARGO").map_or_else(|| "cargo".into(), PathBuf::from)
}

fn field(text: &str, name: &str) -> String {
    let line = text.lines().find_map(|line| line.strip_prefix(name));
    line.unwrap_or_default().trim().to_owned()
}

/// The linker driver with assembler, linker and C library.
struct Gcc {
    version: String,
    binutils: String,
    libc: String,
}

impl Gcc {
    fn find() -> Result<Self, String> {
        let version = first_line("avr-gcc", &["--version"]).ok_or("avr-gcc is not there")?;
        let binutils = first_line("avr-ld", &["--version"]).ok_or("avr-ld is not there")?;
        if first_line("avr-objcopy", &["--version"]).is_none() {
            return Err("avr-objcopy is not there".to_owned());
        }
        let start = "-print-file-name=crtatmega328p.o";
        let start = first_line("avr-gcc", &["-mmcu=atmega328p", start]).unwrap_or_default();
        if !Path::new(&start).is_absolute() {
            return Err("avr-libc is not there (no start-up code for the atmega328p)".to_owned());
        }
        Ok(Self {
            version,
            binutils,
            libc: libc_version(),
        })
    }
}

/// The version that avr-libc's own header gives.
fn libc_version() -> String {
    let arguments = [
        "-E",
        "-dM",
        "-include",
        "avr/version.h",
        "-x",
        "c",
        "/dev/null",
    ];
    let defined = output("avr-gcc".as_ref(), &arguments).unwrap_or_default();
    let version = field(&defined, "#define __AVR_LIBC_VERSION_STRING__ ");
    version.trim_matches('"').to_owned()
}
