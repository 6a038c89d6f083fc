//! The program of a release, and what it needs of the system.

use std::path::{Path, PathBuf};

use crate::shell::{cargo, command, output, root, run, target};

/// Builds the program. Its own target folder keeps the remapped paths apart from everyday builds.
pub(super) fn build() -> Result<PathBuf, String> {
    let folder = target().join("dist-build");
    let mut remapped = vec![(root(), "/cardan"), (folder.clone(), "/target")];
    let home = |name: &str, default: &str| {
        let home = std::env::var_os("HOME").map(|home| PathBuf::from(home).join(default));
        std::env::var_os(name).map(PathBuf::from).or(home)
    };
    remapped.extend(home("CARGO_HOME", ".cargo").map(|folder| (folder, "/cargo")));
    remapped.extend(home("RUSTUP_HOME", ".rustup").map(|folder| (folder, "/rustup")));
    let flags: Vec<String> = remapped
        .iter()
        .map(|(from, to)| format!("--remap-path-prefix={}={to}", from.display()))
        .collect();
    let mut build = cargo(&["build", "--release", "--locked", "--package", "cardan"]);
    build
        .env("CARGO_TARGET_DIR", &folder)
        .env("CARGO_INCREMENTAL", "0")
        .env("CARGO_ENCODED_RUSTFLAGS", flags.join("\u{1f}"))
        .env_remove("RUSTFLAGS");
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("CARGO_PROFILE_") {
            build.env_remove(name);
        }
    }
    if !run(build)? {
        return Err("the program does not build; the compiler's message says where".to_owned());
    }
    Ok(folder.join("release/cardan"))
}

/// The Debian packages that `program` needs, by the libraries that it names and the symbols' versions.
pub(super) fn needed(program: &Path) -> Result<Vec<String>, String> {
    let shown = program.display().to_string();
    let dynamic = output(command("readelf", &["--wide", "--dynamic", &shown]))?;
    let versions = output(command("readelf", &["--wide", "--version-info", &shown]))?;
    let mut packages = Vec::new();
    for line in dynamic.lines().filter(|line| line.contains("(NEEDED)")) {
        let library = line
            .split(['[', ']'])
            .nth(1)
            .ok_or("readelf names no library")?;
        match library {
            "libc.so.6" => {
                let least = newest(&versions, "GLIBC_").ok_or("no version of libc is named")?;
                packages.push(format!("libc6 (>= {}.{})", least.0, least.1));
            }
            "libgcc_s.so.1" => packages.push("libgcc-s1 (>= 3.4)".to_owned()),
            // Parts of libc6.
            "libm.so.6" | "libdl.so.2" | "libpthread.so.0" | "librt.so.1" => {}
            loader if loader.starts_with("ld-linux") => {}
            other => {
                return Err(format!(
                    "the program needs {other}, of which the packaging does not know the package; add it to \
                     crates/xtask/src/dist/program.rs"
                ));
            }
        }
    }
    Ok(packages)
}

/// The newest `PREFIXmajor.minor` in the text.
fn newest(text: &str, prefix: &str) -> Option<(u32, u32)> {
    let versions = text.split(prefix).skip(1).filter_map(|rest| {
        let number = rest
            .split(|c: char| !(c.is_ascii_digit() || c == '.'))
            .next()?;
        let mut parts = number.split('.');
        Some((parts.next()?.parse().ok()?, parts.next()?.parse().ok()?))
    });
    versions.max()
}

#[cfg(test)]
mod tests {
    use super::newest;

    #[test]
    fn versions_are_numbers() {
        let text = "Name: GLIBC_2.9  Flags: none\nName: GLIBC_2.34\nName: GLIBC_2.2.5\nName: GLIBC_PRIVATE";
        assert_eq!(newest(text, "GLIBC_"), Some((2, 34)));
        assert_eq!(newest("", "GLIBC_"), None);
    }
}
