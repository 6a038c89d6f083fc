//! Installs what the tests need, after saying what and why.
//!
//! `cardan doctor` knows which parts are missing; system packages need root, the Python oracles go
//! into an environment of their own under the target folder.

use std::path::PathBuf;

use serde_json::Value;

use crate::shell::{cardan, command, output, run, succeeds, target};

/// Names the Python of the oracles.
pub(crate) const PYTHON: &str = "CARDAN_PYTHON";
/// Python packages of the oracles.
const PACKAGES: [&str; 3] = ["numpy", "scipy", "apytypes"];

/// System packages that make environments.
const VENV: [&str; 2] = ["python3", "python3-venv"];

/// A part that is missing.
struct Missing {
    name: String,
    purpose: String,
    packages: Vec<String>,
    install: String,
}

/// Installs what is missing.
pub(crate) fn prepare() -> Result<bool, String> {
    let missing = missing()?;
    if missing.is_empty() {
        println!("everything that the tests need is there");
        return Ok(true);
    }
    println!("the tests need, and this machine lacks:");
    for part in &missing {
        println!("  {:<16} {}", part.name, part.purpose);
    }
    let (system, others): (Vec<_>, Vec<_>) =
        missing.iter().partition(|part| !part.packages.is_empty());
    let mut packages: Vec<&str> = system
        .iter()
        .flat_map(|part| &part.packages)
        .map(String::as_str)
        .collect();
    let wants_python = others.iter().any(|part| part.name == "python oracles");
    if wants_python && !has_venv() {
        packages.extend(VENV);
    }
    install(&packages)?;
    if wants_python {
        python()?;
    }
    let left = self::missing()?;
    for part in &left {
        eprintln!(
            "still missing: {} ({}); {}",
            part.name, part.purpose, part.install
        );
    }
    Ok(left.is_empty())
}

/// Makes sure that Python can make environments.
///
/// # Errors
/// It cannot, and what would let it cannot be installed.
pub(crate) fn install_venv() -> Result<(), String> {
    if has_venv() { Ok(()) } else { install(&VENV) }
}

fn has_venv() -> bool {
    succeeds(command("python3", &["-c", "import venv, ensurepip"]))
}

/// The Python for the oracles: the caller's, or ours if it has been made.
pub(crate) fn oracle_python() -> Option<PathBuf> {
    let ours = target().join("venv/bin/python");
    let named = std::env::var_os(PYTHON).map(PathBuf::from);
    named.or_else(|| ours.is_file().then_some(ours))
}

/// What `cardan doctor` misses.
fn missing() -> Result<Vec<Missing>, String> {
    let mut doctor = command(cardan(), &["doctor", "--json", "--quiet"]);
    if let Some(python) = oracle_python() {
        doctor.env(PYTHON, python);
    }
    let text = output(doctor)?;
    let document: Value =
        serde_json::from_str(&text).map_err(|error| format!("cardan doctor: {error}"))?;
    let parts = document["parts"]
        .as_array()
        .ok_or("cardan doctor names no parts")?;
    let string = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let absent = parts.iter().filter(|part| part["present"] == false);
    let described = absent.map(|part| Missing {
        name: string(&part["name"]),
        purpose: string(&part["purpose"]),
        packages: part["packages"]
            .as_array()
            .into_iter()
            .flatten()
            .map(string)
            .collect(),
        install: string(&part["install"]),
    });
    Ok(described.collect())
}

fn install(packages: &[&str]) -> Result<(), String> {
    if packages.is_empty() {
        return Ok(());
    }
    let list = packages.join(" ");
    let is_root = output(command("id", &["-u"])).is_ok_and(|id| id.trim() == "0");
    if !is_root {
        return Err(format!(
            "only root can install packages; ask for: apt-get install {list}"
        ));
    }
    println!("installing {list}");
    let apt = |arguments: &[&str]| {
        let mut apt = command("apt-get", arguments);
        apt.env("DEBIAN_FRONTEND", "noninteractive");
        run(apt)
    };
    let first = ["install", "--yes", "--no-install-recommends"];
    if apt(&["update"])? && apt(&[&first[..], packages].concat())? {
        return Ok(());
    }
    Err(format!(
        "apt-get could not install {list}; its message says why"
    ))
}

/// Makes an environment with the oracles.
fn python() -> Result<(), String> {
    let folder = target().join("venv");
    let shown = folder.display().to_string();
    println!(
        "making a Python environment with {} in {shown}",
        PACKAGES.join(", ")
    );
    let pip = folder.join("bin/pip");
    let wanted = [&["install", "--quiet"][..], &PACKAGES].concat();
    if run(command("python3", &["-m", "venv", &shown]))? && run(command(pip, &wanted))? {
        return Ok(());
    }
    Err(format!(
        "no Python environment could be made in {shown}; the message above says why"
    ))
}
