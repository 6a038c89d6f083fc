//! Runs Cargo for a board.
//!
//! The same sources and toolchain give the same bytes, wherever the checkout, Cargo's home and the
//! target folder lie: paths are remapped, symbol names do not depend on them
//! (`stable-metadata.sh`), flags and profiles of the caller's environment are kept out, debug
//! information is stripped.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use cardan_datapath::wordlengths::DeclaredNode;
use cardan_spec::taps;

use super::find::Compiler;
use super::metadata::{self, Metadata};
use super::record::hex_digest;
use super::{Board, Built, Checkout, Runs, kept, sources, unusable};
use crate::failure::Failure;
use crate::files::write_whole;

/// The wrapper script.
const WRAPPER: &str = include_str!("stable-metadata.sh");
/// Begins the names of environment variables that change what Cargo builds.
const FOREIGN: [&str; 8] = [
    "CARGO_BUILD_",
    "CARGO_ENCODED_RUSTFLAGS",
    "CARGO_INCREMENTAL",
    "CARGO_PROFILE_",
    "CARGO_TARGET_",
    "CARGO_UNSTABLE_",
    "RUSTC",
    "RUSTFLAGS",
];

/// Builds an image, or takes it from the cache of images in other formats.
pub(super) fn image(
    compiler: &Compiler,
    checkout: &Checkout,
    board: &Board,
    is_tapped: bool,
    wordlengths: Option<&[DeclaredNode]>,
    is_quiet: bool,
) -> Result<Built, Failure> {
    let workspace = checkout.root();
    let folder = board_folder(checkout, board)?;
    let images = folder.join("images");
    let variant = if is_tapped { "tapped" } else { "plain" };
    let sources = sources::digest(workspace, board)?;
    let build = Build {
        compiler,
        workspace,
        board,
        folder: &folder,
        sources: &sources,
        is_quiet,
    };
    let Some(nodes) = wordlengths else {
        let elf = build.run(is_tapped, None, &images.join(format!("{variant}.elf")))?;
        return Ok(elf);
    };
    let text = toml(nodes);
    let key = [sources.clone(), compiler.versions.to_string(), text.clone()];
    let key = hex_digest(key.join("\n").as_bytes());
    let kept = images.join(format!("{variant}-{}.elf", &key[..32]));
    if let Some(elf) = kept::read(&kept) {
        return Ok(Built { elf, file: kept });
    }
    let formats = images.join(format!("{}.toml", &key[..32]));
    write_whole("formats", &formats, text)?;
    let built = build.run(is_tapped, Some(&formats), &kept)?;
    kept::seal(&kept, &built.elf)?;
    Ok(built)
}

/// Builds the board's on-target tests and runs them in the emulator, which is this program. Their
/// report goes to standard output, or to standard error if `is_reported_aside`. Returns whether
/// all passed.
pub(super) fn tests(
    compiler: &Compiler,
    checkout: &Checkout,
    board: &Board,
    is_quiet: bool,
    is_reported_aside: bool,
) -> Result<bool, Failure> {
    let workspace = checkout.root();
    let folder = board_folder(checkout, board)?;
    let sources = sources::digest(workspace, board)?;
    let build = Build {
        compiler,
        workspace,
        board,
        folder: &folder,
        sources: &sources,
        is_quiet,
    };
    let emulator = std::env::current_exe()
        .map_err(|error| Failure::participant(format!("this program has no path: {error}")))?;
    let mut cargo = build.cargo();
    cargo
        .args(["test", "--release", "--locked", "--config"])
        // As for images, so that what both are made of is compiled once.
        .arg(build.flags()?)
        .env("RUSTC_WRAPPER", build.wrapper()?)
        .env("CARDAN", emulator);
    if is_quiet {
        cargo.arg("--quiet");
    }
    if is_reported_aside {
        cargo.stdout(io::stderr());
    }
    let status = cargo.status().map_err(|error| {
        let cargo = compiler.cargo.display();
        Failure::input(format!(
            "{cargo} cannot be run: {error}; see `cardan doctor`"
        ))
    })?;
    Ok(status.success())
}

/// Cargo's target folder for the board, with room for its images.
fn board_folder(checkout: &Checkout, board: &Board) -> Result<PathBuf, Failure> {
    let folder = checkout.build_folder()?.join("boards").join(board.name);
    let make = |folder: &Path| {
        let mend = "check its permissions, or name another place with CARGO_TARGET_DIR";
        unusable(folder, "cannot be made", &mend)
    };
    let images = folder.join("images");
    fs::create_dir_all(&images).map_err(|_| make(&images))?;
    folder.canonicalize().map_err(|_| make(&folder))
}

/// The formats in the order of the firmware's nodes: one text per set of formats.
fn toml(nodes: &[DeclaredNode]) -> String {
    let tables = nodes.iter().map(|node| {
        let format = node.format;
        format!(
            "[[node]]\nname = \"{}\"\nunit = \"{}\"\nword = {}\nfrac = {}\nrounding = \"{}\"\n\
             overflow = \"{}\"\n",
            node.name,
            node.unit,
            format.word,
            format.frac,
            format.rounding.name(),
            format.overflow.name()
        )
    });
    tables.collect::<Vec<_>>().join("\n")
}

struct Build<'a> {
    compiler: &'a Compiler,
    workspace: &'a Path,
    board: &'a Board,
    /// Cargo's target folder for this board.
    folder: &'a Path,
    /// Digest of the sources.
    sources: &'a str,
    is_quiet: bool,
}

impl Build<'_> {
    /// Builds into `file`.
    fn run(
        &self,
        is_tapped: bool,
        wordlengths: Option<&Path>,
        file: &Path,
    ) -> Result<Built, Failure> {
        // Plain and tapped executables have one name: another process must not build in between.
        let lock = self.lock()?;
        let mut cargo = self.cargo();
        cargo.args([
            "build",
            "--release",
            "--locked",
            "--message-format=json-render-diagnostics",
        ]);
        cargo.arg("--config").arg(self.flags()?);
        if let Some(linker) = &self.compiler.linker {
            let triple = self.board.triple;
            let linker = linker.to_string_lossy();
            cargo
                .arg("--config")
                .arg(format!("target.{triple}.linker={linker:?}"));
            if self.compiler.has_sources {
                cargo.arg("-Zbuild-std=core");
            }
        }
        if is_tapped {
            cargo.args(["--features", "taps"]);
        }
        if let Some(wordlengths) = wordlengths {
            cargo.env("CARDAN_WORDLENGTHS", wordlengths);
        }
        let messages = self.output(&mut cargo)?;
        let executable = metadata::executable(&messages).ok_or_else(|| {
            Failure::input(format!("cargo built no executable for {}", self.board.name))
        })?;
        let stripped = executable.with_extension("stripped");
        match self.board.runs_in {
            Runs::Emulator => strip(&executable, &stripped)?,
            // Its profile leaves no debug information.
            Runs::Qemu => copy(&executable, &stripped)?,
        }
        let elf =
            fs::read(&stripped).map_err(|error| unusable(&stripped, "cannot be read", &error))?;
        // Others may be reading the image that is there.
        write_whole("image", file, &elf)?;
        drop(lock);
        Ok(Built {
            elf,
            file: file.to_owned(),
        })
    }

    fn lock(&self) -> Result<File, Failure> {
        let name = self.folder.join("images/lock");
        let failed = |error| unusable(&name, "cannot be locked", &error);
        let file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(&name)
            .map_err(failed)?;
        file.lock().map_err(failed)?;
        Ok(file)
    }

    /// Cargo in the board's folder, with nothing of the caller's settings.
    fn cargo(&self) -> Command {
        let mut cargo = Command::new(&self.compiler.cargo);
        for (name, _) in std::env::vars_os() {
            let text = name.to_string_lossy();
            if FOREIGN.iter().any(|start| text.starts_with(start)) {
                cargo.env_remove(&name);
            }
        }
        cargo
            .current_dir(self.workspace.join(self.board.folder))
            .env_remove("RUSTUP_TOOLCHAIN")
            .env_remove("CARDAN_WORDLENGTHS")
            // The image tells what it was made of.
            .env("CARDAN_SOURCES", self.sources)
            .env("CARGO_TARGET_DIR", self.folder)
            .env("RUSTC", &self.compiler.rustc)
            .env("RUSTC_BOOTSTRAP", "1")
            .stdin(Stdio::null());
        cargo
    }

    /// Runs Cargo and returns its standard output; its messages pass through, or stand in the
    /// error if it fails quietly.
    fn output(&self, cargo: &mut Command) -> Result<String, Failure> {
        cargo.env("RUSTC_WRAPPER", self.wrapper()?);
        if self.is_quiet {
            cargo.stderr(Stdio::piped());
        } else {
            cargo.stderr(Stdio::inherit());
        }
        let output = cargo.stdout(Stdio::piped()).output().map_err(|error| {
            let cargo = self.compiler.cargo.display();
            Failure::input(format!(
                "{cargo} cannot be run: {error}; see `cardan doctor`"
            ))
        })?;
        if output.status.success() {
            return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
        }
        let messages = String::from_utf8_lossy(&output.stderr);
        Err(Failure::input(format!(
            "building {} with {} failed; the compiler's message says where\n{messages}",
            self.board.folder, self.compiler.versions.rustc
        )))
    }

    fn wrapper(&self) -> Result<PathBuf, Failure> {
        use std::os::unix::fs::PermissionsExt;
        let file = self.folder.join("images/stable-metadata.sh");
        let failed = |error| unusable(&file, "cannot be written", &error);
        if fs::read(&file).ok().as_deref() != Some(WRAPPER.as_bytes()) {
            write_whole("wrapper", &file, WRAPPER)?;
        }
        fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).map_err(failed)?;
        Ok(file)
    }

    /// Compiler flags: they replace every path of this machine (of two that match the later wins),
    /// and keep the format table, which nothing in the program refers to.
    fn flags(&self) -> Result<String, Failure> {
        let mut remapped = vec![
            (self.compiler.library.clone(), "/rust"),
            (self.workspace.to_owned(), "/cardan"),
            (self.folder.to_owned(), "/target"),
        ];
        for folder in self.metadata()?.registries() {
            remapped.push((folder, "/registry"));
        }
        let remapped = remapped
            .iter()
            .map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display()));
        // (The others' build scripts say so.)
        let kept = (self.board.runs_in == Runs::Emulator)
            .then(|| format!("-Clink-arg=-Wl,--undefined={}", taps::FORMATS_SYMBOL));
        let flags: Vec<String> = remapped
            .chain(kept)
            .map(|flag| format!("{flag:?}"))
            .collect();
        Ok(format!(
            "target.{}.rustflags=[{}]",
            self.board.triple,
            flags.join(",")
        ))
    }

    fn metadata(&self) -> Result<Metadata, Failure> {
        let mut cargo = self.cargo();
        cargo.args(["metadata", "--locked", "--format-version", "1"]);
        let text = self.output(&mut cargo)?;
        serde_json::from_str(&text).map_err(|error| {
            Failure::input(format!("cargo metadata of {}: {error}", self.board.folder))
        })
    }
}

fn copy(from: &Path, to: &Path) -> Result<(), Failure> {
    match fs::copy(from, to) {
        Ok(_) => Ok(()),
        Err(error) => Err(unusable(to, "cannot be written", &error)),
    }
}

/// Keeps the symbols, by which taps and formats are found, and drops debug information.
fn strip(from: &Path, to: &Path) -> Result<(), Failure> {
    let status = Command::new("avr-objcopy")
        .arg("--strip-debug")
        .args([from, to])
        .status();
    match status {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(unusable(from, "avr-objcopy failed", &status)),
        Err(error) => Err(unusable(from, "avr-objcopy cannot be run", &error)),
    }
}
