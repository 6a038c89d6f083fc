//! `cargo xtask dist`: a release as a Debian package and as a tar archive. The same sources and toolchain give
//! the same bytes: paths are remapped in the program, and times, owners, modes and order are set here.

mod program;
mod staged;

use std::fs;
use std::path::{Path, PathBuf};

use crate::shell::{command, first_line, output, root, run, target};
use staged::Tree;

/// Version of the workspace.
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Who answers for the package.
const MAINTAINER: &str = "Cardan <cardan@example.org>";

/// What is asked for.
struct Options {
    out: PathBuf,
    /// Packed instead of a release build.
    program: Option<PathBuf>,
}

/// Makes both files.
///
/// # Errors
/// A tool that is missing or fails; the message names it.
pub(crate) fn dist(arguments: &[&str]) -> Result<bool, String> {
    let options = options(arguments)?;
    let epoch = epoch()?;
    let program = match options.program {
        Some(program) => program,
        None => program::build()?,
    };
    let absolute = |path: &Path| std::path::absolute(path).map_err(|error| error.to_string());
    let (program, out) = (absolute(&program)?, absolute(&options.out)?);
    make(&out)?;
    let work = tempfile(&out)?;
    let result = packed(&program, &out, &work, epoch);
    // Its content is ours alone.
    let _ = fs::remove_dir_all(&work);
    for file in result? {
        println!("written: {}", file.display());
    }
    Ok(true)
}

fn options(arguments: &[&str]) -> Result<Options, String> {
    let mut options = Options {
        out: target().join("dist"),
        program: None,
    };
    let mut rest = arguments.iter();
    while let Some(name) = rest.next() {
        let value = rest.next().map(PathBuf::from);
        match (*name, value) {
            ("--out", Some(folder)) => options.out = folder,
            ("--program", Some(file)) => options.program = Some(file),
            _ => return Err(format!("dist {name}: expected --out DIR or --program FILE")),
        }
    }
    Ok(options)
}

/// The time that all files get, in seconds since 1970: `SOURCE_DATE_EPOCH`, or that of the last commit.
fn epoch() -> Result<u64, String> {
    let expected =
        "expected seconds since 1970 in SOURCE_DATE_EPOCH, or a Git checkout with a commit";
    let given = std::env::var("SOURCE_DATE_EPOCH").ok();
    let text = match given {
        Some(text) => text,
        None => output(command("git", &["log", "-1", "--format=%ct"]))
            .map_err(|error| format!("{error}; {expected}"))?,
    };
    let seconds = text.trim().parse();
    seconds.map_err(|_| format!("'{}': {expected}", text.trim()))
}

/// An empty folder for the work.
fn tempfile(out: &Path) -> Result<PathBuf, String> {
    let folder = out.join(format!(".work-{}", std::process::id()));
    make(&folder)?;
    Ok(folder)
}

fn make(folder: &Path) -> Result<(), String> {
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))
}

/// Packs `program` in `work`, and moves the finished files to `out`.
fn packed(program: &Path, out: &Path, work: &Path, epoch: u64) -> Result<Vec<PathBuf>, String> {
    let tree = Tree::new(work.join("tree"), epoch);
    staged::fill(&tree, program)?;
    let archive = archive(&tree, work, epoch)?;
    let package = package(&tree, work, epoch)?;
    let mut files = Vec::new();
    for made in [archive, package] {
        let file = out.join(made.file_name().unwrap_or_default());
        fs::rename(&made, &file).map_err(|error| format!("{}: {error}", file.display()))?;
        files.push(file);
    }
    Ok(files)
}

/// `cardan-VERSION-ARCH-linux.tar.gz`: one folder with `bin` and `share`.
fn archive(tree: &Tree, work: &Path, epoch: u64) -> Result<PathBuf, String> {
    let name = format!("cardan-{VERSION}-{}-linux", std::env::consts::ARCH);
    let plain = work.join(format!("{name}.tar"));
    tree.finish()?;
    let usr = tree.path("usr");
    let time = format!("--mtime=@{epoch}");
    let rename = format!("--transform=s,^\\.,{name},");
    let arguments = [
        "--create",
        "--format=ustar",
        "--sort=name",
        "--owner=0",
        "--group=0",
        "--numeric-owner",
        &time,
        &rename,
        "--file",
        &plain.display().to_string(),
        "--directory",
        &usr.display().to_string(),
        ".",
    ];
    done(run(command("tar", &arguments))?, "tar")?;
    let shown = plain.display().to_string();
    done(
        run(command("gzip", &["--no-name", "--best", &shown]))?,
        "gzip",
    )?;
    Ok(work.join(format!("{name}.tar.gz")))
}

/// `cardan_VERSION_ARCH.deb`.
fn package(tree: &Tree, work: &Path, epoch: u64) -> Result<PathBuf, String> {
    let debian = first_line("dpkg".as_ref(), &["--print-architecture"], "").ok_or(
        "a Debian package needs dpkg and dpkg-deb; on Debian they are there, elsewhere the system's package \
         `dpkg` has them",
    )?;
    let mut needed = program::needed(&tree.path("usr/bin/cardan"))?;
    needed.sort();
    let control = format!(
        "Package: cardan\nVersion: {VERSION}\nArchitecture: {debian}\nMaintainer: {MAINTAINER}\n\
         Installed-Size: {}\nDepends: {}\nSuggests: gcc-avr, binutils-avr, avr-libc, lld\nSection: electronics\n\
         Priority: optional\nHomepage: https://example.org/cardan\n\
         Description: proves fixed-point sensor firmware before silicon\n \
         Golden model, native run and cycle-accurate emulation (ATmega328P) of the same\n \
         algorithm, compared bit by bit; word lengths that meet a budget.\n",
        tree.kibibytes("usr")?,
        needed.join(", "),
    );
    tree.write("DEBIAN/control", control)?;
    tree.write("DEBIAN/md5sums", tree.md5sums()?)?;
    tree.finish()?;
    let file = work.join(format!("cardan_{VERSION}_{debian}.deb"));
    let arguments = [
        "--root-owner-group",
        "-Zxz",
        "--threads-max=1",
        "--build",
        &tree.path("").display().to_string(),
        &file.display().to_string(),
    ];
    let mut build = command("dpkg-deb", &arguments);
    build.env("SOURCE_DATE_EPOCH", epoch.to_string());
    done(run(build)?, "dpkg-deb")?;
    Ok(file)
}

fn done(is_good: bool, program: &str) -> Result<(), String> {
    let failed = || format!("{program} failed; its message above says why");
    is_good.then_some(()).ok_or_else(failed)
}

/// A file of the workspace.
fn read(name: &str) -> Result<Vec<u8>, String> {
    fs::read(root().join(name)).map_err(|error| format!("{name}: {error}"))
}
