//! What the tests need beside Rust's stable toolchain and gcc, and how to get it on Debian.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A Debian package and what it is for.
struct Package {
    name: &'static str,
    what_for: &'static str,
}

const PACKAGES: [Package; 9] = [
    Package {
        name: "rustc-web",
        what_for: "a compiler that can build for AVR",
    },
    Package {
        name: "rust-web-src",
        what_for: "the library sources for it",
    },
    Package {
        name: "gcc-avr",
        what_for: "links firmware, compiles test programs",
    },
    Package {
        name: "binutils-avr",
        what_for: "assembles test programs",
    },
    Package {
        name: "avr-libc",
        what_for: "start-up code and headers of test programs",
    },
    Package {
        name: "simavr",
        what_for: "a peer of the emulator",
    },
    Package {
        name: "libsimavr-dev",
        what_for: "the same, in lockstep",
    },
    Package {
        name: "chromium",
        what_for: "opens the HTML report",
    },
    Package {
        name: "python3-venv",
        what_for: "a place for the numeric oracles",
    },
];

/// Python packages that are oracles: linear systems, and fixed-point arithmetic.
const ORACLES: [&str; 3] = ["numpy", "scipy", "apytypes"];

/// Installs what is missing. Returns the Python that has the oracles.
///
/// # Errors
/// A missing package that cannot be installed: says what to ask for.
pub(crate) fn install(root: &Path) -> Result<PathBuf, String> {
    let missing: Vec<&Package> = PACKAGES
        .iter()
        .filter(|package| !is_installed(package.name))
        .collect();
    if !missing.is_empty() {
        println!("Debian packages that the tests need and this machine lacks:");
        for Package { name, what_for } in &missing {
            println!("  {name}: {what_for}");
        }
        let names: Vec<&str> = missing.iter().map(|package| package.name).collect();
        install_packages(&names)?;
    }
    python(root)
}

fn is_installed(package: &str) -> bool {
    let query = Command::new("dpkg-query")
        .args(["--show", "--showformat", "${db:Status-Status}", package])
        .stderr(Stdio::null())
        .output();
    query.is_ok_and(|output| output.stdout == b"installed")
}

fn install_packages(names: &[&str]) -> Result<(), String> {
    let list = names.join(" ");
    let is_root = Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|id| id.stdout == b"0\n");
    if !is_root {
        return Err(format!(
            "not root, so nothing is installed; ask an administrator for: apt-get install {list}"
        ));
    }
    let apt = |arguments: &[&str]| {
        Command::new("apt-get")
            .args(arguments)
            .env("DEBIAN_FRONTEND", "noninteractive")
            .status()
            .is_ok_and(|status| status.success())
    };
    if !apt(&["update", "-qq"]) {
        return Err("apt-get update failed: is this Debian, and is its archive reachable?".into());
    }
    let install = ["install", "-y", "-qq", "--no-install-recommends"];
    if apt(&[&install[..], names].concat()) {
        Ok(())
    } else {
        Err(format!("apt-get install {list} failed"))
    }
}

/// A virtual environment under the target folder, unless CARDAN_PYTHON names an interpreter.
fn python(root: &Path) -> Result<PathBuf, String> {
    if let Some(given) = std::env::var_os("CARDAN_PYTHON") {
        return Ok(given.into());
    }
    let folder = root.join("target").join("oracles");
    let python = folder.join("bin").join("python");
    let imports = format!("import {}", ORACLES.join(", "));
    let works = || {
        let quiet = |command: &mut Command| {
            command
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .status()
                .is_ok_and(|s| s.success())
        };
        quiet(Command::new(&python).args(["-c", &imports]))
    };
    if works() {
        return Ok(python);
    }
    println!(
        "Python packages {}: oracles for analog models and arithmetic",
        ORACLES.join(", ")
    );
    let _ = fs::remove_dir_all(&folder);
    let made = ["/usr/bin/python3", "python3"].iter().any(|interpreter| {
        let status = Command::new(interpreter)
            .args(["-m", "venv"])
            .arg(&folder)
            .status();
        status.is_ok_and(|status| status.success())
    });
    if !made {
        return Err("python3 -m venv failed; install python3-venv".into());
    }
    let pip = Command::new(&python)
        .args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
        ])
        .args(ORACLES)
        .status();
    if pip.is_ok_and(|status| status.success()) && works() {
        Ok(python)
    } else {
        Err(format!("pip install {} failed", ORACLES.join(" ")))
    }
}
