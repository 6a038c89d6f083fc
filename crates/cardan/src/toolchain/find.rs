//! Finds a Rust compiler that can build for a board, and the linker (and, for AVR, C library) it
//! needs.
//!
//! AVR has no precompiled core library, so the compiler's own sources must be there; for the others
//! either will do. Looked for in this order: what `CARDAN_AVR_RUSTC` names (for every board),
//! Debian's `rustc-web` with `rust-web-src`, a rustup nightly with `rust-src`, a rustup stable with
//! the target's library.

use std::fmt;
use std::path::{Path, PathBuf};

use super::probe::{first_line, output};
use super::record::Versions;
use super::{Board, Runs};

/// Names another compiler.
const OVERRIDE: &str = "CARDAN_AVR_RUSTC";
/// Debian's compiler.
const DEBIAN: &str = "/usr/bin/rustc";
/// Installs what cross builds need on Debian.
const INSTALL_RUST: &str = "apt-get install rustc-web rust-web-src";
const INSTALL_GCC: &str = "apt-get install gcc-avr binutils-avr avr-libc";
const INSTALL_LLD: &str = "apt-get install lld";

/// A compiler for a board with all that it needs.
#[derive(Clone, Debug)]
pub(crate) struct Compiler {
    /// `rustc`.
    pub(super) rustc: PathBuf,
    /// `cargo`.
    pub(super) cargo: PathBuf,
    /// Sources of the core library.
    pub(super) library: PathBuf,
    /// Whether they are there; else the target's core library is, compiled.
    pub(super) has_sources: bool,
    /// The linker, where the target's own choice is not it.
    pub(super) linker: Option<PathBuf>,
    /// Versions of all parts.
    pub(crate) versions: Versions,
}

/// Why there is no toolchain for a board.
#[derive(Debug)]
pub(crate) struct Missing {
    board: &'static str,
    /// What is not there, each part with what installs it.
    pub(crate) parts: Vec<String>,
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "cross-compiling for {} needs a toolchain that is not there:",
            self.board
        )?;
        for line in &self.parts {
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
    /// The compiler, or why it cannot build for the target.
    pub(crate) found: Result<Rust, String>,
}

/// A Rust compiler that can build for the target.
#[derive(Clone, Debug)]
pub(crate) struct Rust {
    rustc: PathBuf,
    cargo: PathBuf,
    library: PathBuf,
    has_sources: bool,
    /// Version line.
    pub(crate) version: String,
    llvm: String,
}

/// The first compiler that can build for `board`, with what links its programs.
pub(crate) fn find(board: &Board) -> Result<Compiler, Missing> {
    let mut missing = Vec::new();
    let candidates = compilers(board.triple);
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
    let (link, install) = match board.runs_in {
        Runs::Emulator => (Gcc::find().map(Link::Gcc), INSTALL_GCC),
        Runs::Qemu => (lld().map(Link::Lld), INSTALL_LLD),
    };
    if let Err(problem) = &link {
        missing.push(format!("{problem}; install it: {install}"));
    }
    match (rust, link) {
        (Some(rust), Ok(link)) => Ok(rust.with(link)),
        _ => Err(Missing {
            board: board.name,
            parts: missing,
        }),
    }
}

/// Every place where a compiler may be, in the order of preference.
pub(crate) fn compilers(triple: &str) -> Vec<Candidate> {
    if let Some(rustc) = std::env::var_os(OVERRIDE) {
        let found = Rust::examine(Path::new(&rustc), None, triple);
        return vec![Candidate {
            origin: OVERRIDE,
            found,
        }];
    }
    let rustup = |toolchain: &str| {
        let rustc = first_line("rustup", &["which", "--toolchain", toolchain, "rustc"])
            .ok_or("not installed")?;
        let cargo = Path::new(&rustc).with_file_name("cargo");
        Rust::examine(Path::new(&rustc), Some(cargo), triple)
    };
    vec![
        Candidate {
            origin: "Debian's rustc-web",
            found: Rust::examine(Path::new(DEBIAN), None, triple),
        },
        Candidate {
            origin: "rustup's nightly",
            found: rustup("nightly"),
        },
        Candidate {
            origin: "rustup's stable",
            found: rustup("stable"),
        },
    ]
}

impl Rust {
    /// Checks that `rustc` knows the target and has its library, or the library's sources.
    fn examine(rustc: &Path, cargo: Option<PathBuf>, triple: &str) -> Result<Self, String> {
        let shown = rustc.display();
        let verbose = output(rustc.as_os_str(), &["-vV"])
            .ok_or_else(|| format!("{shown} is not there or does not run"))?;
        let targets = output(rustc.as_os_str(), &["--print", "target-list"]).unwrap_or_default();
        if !targets.lines().any(|target| target == triple) {
            return Err(format!(
                "{shown} does not know the target {triple}; needs Rust 1.88"
            ));
        }
        let sysroot = first_line(rustc, &["--print", "sysroot"]).unwrap_or_default();
        let library = Path::new(&sysroot).join("lib/rustlib/src/rust");
        let has_sources = library.join("library/Cargo.lock").is_file();
        let compiled = Path::new(&sysroot)
            .join("lib/rustlib")
            .join(triple)
            .join("lib");
        if !has_sources && !compiled.is_dir() {
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
            has_sources,
            version: verbose.lines().next().unwrap_or_default().to_owned(),
            llvm: field(&verbose, "LLVM version: "),
        })
    }

    fn with(self, link: Link) -> Compiler {
        let mut versions = Versions {
            rustc: self.version,
            llvm: self.llvm,
            cargo: first_line(&self.cargo, &["--version"]).unwrap_or_default(),
            avr_gcc: None,
            binutils: None,
            avr_libc: None,
            lld: None,
        };
        let linker = match link {
            Link::Gcc(gcc) => {
                versions.avr_gcc = Some(gcc.version);
                versions.binutils = Some(gcc.binutils);
                versions.avr_libc = Some(gcc.libc);
                None
            }
            Link::Lld(lld) => {
                versions.lld = Some(lld.version);
                Some(lld.program)
            }
        };
        Compiler {
            rustc: self.rustc,
            cargo: self.cargo,
            library: self.library,
            has_sources: self.has_sources,
            linker,
            versions,
        }
    }
}

/// What links a program.
enum Link {
    Gcc(Gcc),
    Lld(Lld),
}

/// LLVM's linker.
pub(crate) struct Lld {
    program: PathBuf,
    /// Version line.
    pub(crate) version: String,
}

/// The linker of ARM and RISC-V programs.
pub(crate) fn lld() -> Result<Lld, String> {
    const PROGRAM: &str = "ld.lld";
    let version = first_line(PROGRAM, &["--version"]).ok_or("ld.lld is not there")?;
    Ok(Lld {
        program: PROGRAM.into(),
        version,
    })
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
